"""The rolling-shutter renderer: (scene, seed, frame number) → picture and truth, in whatever order.

Linear light of a pixel in row y = what is behind × (1 − opacity) + Σ over classes of picture × w(y),
surface by surface from far to near (`exposure`), then noise and codes (`sensor`). Each panel has its own
oscillator for each class; all run from t = 0 of the camera's clock, from a phase that the seed decides. A panel
whose cells were traced shows what the trace says.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulate.exposure import Exposed, add_to, expose_moving, expose_still
from ledpi.camera.simulate.optics import Blur, PoseAt, node_pixels, rays_of, seen_at, shows_front, spread, whole_picture
from ledpi.camera.simulate.scene import Panel, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.sensor import SensorReadout
from ledpi.camera.simulate.surface import Image, Surface, light_surface, panel_surface, print_surface
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.core.geometry import inverse, quaternion_from_matrix
from ledpi.core.records import Floats, Frame, Intrinsics, Pixels, Pose, read_only

_NOISE, _OSCILLATORS, _MAINS = 0, 1, 2  # independent streams of random numbers


class Renderer:
    """Renders frames of one scene. What stands still is kept. Not for two threads at once."""

    def __init__(self, scene: Scene, *, seed: int) -> None:
        self.scene = scene
        self._seed = seed
        surfaces = [panel_surface(panel, scene.room, self._seen_from(panel)) for panel in scene.panels]
        surfaces += [light_surface(light) for light in scene.lights]
        self._surfaces: list[Surface] = surfaces + [print_surface(printed, scene.room) for printed in scene.prints]
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_MAINS,)))
        self._room_phase = float(rng.random())  # of whatever hangs on the mains
        self._phases = [self._draw_phases(index, s) for index, s in enumerate(self._surfaces)]
        if scene.floor is not None:
            shown = [*range(len(scene.panels)), *range(len(self._surfaces) - len(scene.prints), len(self._surfaces))]
            self._surfaces += [scene.floor.mirrored(self._surfaces[index]) for index in shown]
            self._phases += [self._phases[index] for index in shown]
        lens = scene.sensor.intrinsics
        self._level: Image = np.empty((lens.height, lens.width), np.float32)
        self._readout = SensorReadout(scene.sensor)
        self._wall = Wall(scene.room, scene.sensor)
        self._kept: dict[int, Exposed | None] = {}
        self._kept_wall: Image | None = None

    def _seen_from(self, panel: Panel) -> Floats | None:
        """(3,) the camera in the panel's frame, as the first frame is exposed: walls hide as seen from there.

        None where the camera does not see the panel's front.
        """
        sensor = self.scene.sensor
        pose = pose_seen(self.scene, panel.motion)(sensor.mid_exposure_s(0, (sensor.intrinsics.height - 1) / 2.0))
        return inverse(pose)[:3, 3] if shows_front(pose) else None

    def _draw_phases(self, index: int, surface: Surface) -> tuple[float, ...]:
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(_OSCILLATORS, index)))
        drawn = rng.random(len(surface.waves)).tolist()
        if surface.antiphase:
            drawn[1] = (drawn[0] + 0.5) % 1.0
        return tuple(
            self._room_phase if wave is not None and wave.on_mains else phase
            for wave, phase in zip(surface.waves, drawn, strict=True)
        )

    @property
    def phases_cycles(self) -> tuple[tuple[float, ...], ...]:
        """Each panel's phases (black class, white class) at t = 0 of the camera's clock."""
        return tuple(self._phases[: len(self.scene.panels)])

    def light(self, seq: int) -> Image:
        """(H, W) linear light of frame `seq` without noise, full scale 1. Overwritten by the next frame."""
        sensor = self.scene.sensor
        if self._kept_wall is None or self.scene.camera_motion.moves:
            self._kept_wall = self._wall.seen(self.scene.camera_motion, seq)
        np.copyto(self._level, self._kept_wall)
        room_rows = self._room_rows(seq)
        if room_rows is not None:
            self._level *= room_rows[:, None]
        now = sensor.mid_exposure_s(seq, (sensor.intrinsics.height - 1) / 2.0)
        poses = [pose_seen(self.scene, surface.motion) for surface in self._surfaces]
        away = [float(np.linalg.norm(pose(now)[:3, 3])) for pose in poses]
        for index in sorted(range(len(poses)), key=lambda i: -away[i]):
            surface = self._surfaces[index]
            exposed = self._exposed(index, poses[index], seq)
            if exposed is not None:
                add_to(self._level, exposed, surface, self._phases[index], sensor, seq, room_rows)
        return self._level

    def _room_rows(self, seq: int) -> Image | None:
        """(H,) the room's light in each row, over its mean; None where it is steady."""
        sensor, ripple = self.scene.sensor, self.scene.room.ripple
        if ripple is None:
            return None
        levels = ripple.shares(
            np.arange(sensor.intrinsics.height, dtype=np.float64),
            phase_cycles=self._room_phase,
            start_s=sensor.exposure_start_s(seq),
            exposure_us=sensor.exposure_us,
            row_time_us=sensor.row_time_us,
        )
        return levels.astype(np.float32)

    def _exposed(self, index: int, pose_at: PoseAt, seq: int) -> Exposed | None:
        surface, sensor = self._surfaces[index], self.scene.sensor
        if surface.motion.moves or self.scene.camera_motion.moves:
            return expose_moving(surface, pose_at, sensor, seq)
        if index not in self._kept:
            self._kept[index] = expose_still(surface, pose_at(0.0), sensor)
        return self._kept[index]

    def render(self, seq: int, into: Pixels) -> None:
        """Fills `into` (H, W) with frame `seq`."""
        sequence = np.random.SeedSequence(self._seed, spawn_key=(_NOISE, seq))
        self._readout.read(self.light(seq), np.random.Generator(np.random.SFC64(sequence)), into)

    def frame(self, seq: int, into: Pixels | None = None, *, reported_row_time: float = 1.0) -> Frame:
        """Frame `seq`, in `into` or pixels of its own; the driver says its row time and exposure times a factor."""
        sensor = self.scene.sensor
        size = (sensor.intrinsics.height, sensor.intrinsics.width)
        pixels = np.empty(size, np.uint8) if into is None else into.view()
        self.render(seq, pixels)
        return Frame(
            pixels=pixels,
            seq=seq,
            row0_readout_ns=sensor.row0_readout_ns(seq),
            exposure_us=sensor.exposure_us * reported_row_time,
            row_time_us=sensor.row_time_us * reported_row_time,
            transfer=sensor.transfer,
            analogue_gain=sensor.gain,
        )

    def truth(self, seq: int) -> tuple[TruthMarker, ...]:
        """The markers that are in view in frame `seq`. Changes nothing: may be asked from another thread."""
        return scene_truth(self.scene, seq)


_TEXELS = 1024
_SPAN = 1.6  # width of the painted picture over the wall's distance: about one texel a pixel at fx = 640
_MIN_COSINE = 0.05  # cosine to the wall's normal: beyond it, and behind, the wall goes on as it is there


class Wall:
    """The wall as one camera sees it, blurred as by its lens. The picture repeats itself, mirrored."""

    def __init__(self, room: Room, sensor: SimulatedSensor) -> None:
        self._distance_m = room.distance_m
        self._sensor = sensor
        lens = sensor.intrinsics
        self._pixels = node_pixels(whole_picture(lens))
        self._rays = np.column_stack([rays_of(self._pixels, lens), np.ones(len(self._pixels))])
        blur_texels = max(Blur.from_sensor(sensor).rms_px, 0.3) * _TEXELS / (_SPAN * lens.fx)
        self._painted: Image = np.asarray(cv2.GaussianBlur(_painted(room), (0, 0), blur_texels), np.float32)

    def seen(self, camera_motion: Trajectory, seq: int) -> Image:
        """(H, W) linear light, each row as at its mid-exposure; motion within the exposure is left out."""
        maps = spread(self._texels(camera_motion, seq), whole_picture(self._sensor.intrinsics))
        seen = cv2.remap(self._painted, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        return np.asarray(seen, np.float32)

    def _texels(self, camera_motion: Trajectory, seq: int) -> Floats:
        """Returns where the node pixels see the painted picture: a quadratic in time through three of the rows."""
        last = self._sensor.intrinsics.height - 1.0
        at_rows = []
        for row in (0.0, last / 2.0, last):
            camera = camera_motion.scene_from_body(self._sensor.mid_exposure_s(seq, row))
            ahead = self._rays @ camera[:3, :3].T
            reach = (self._distance_m - camera[2, 3]) / np.maximum(ahead[:, 2:], _MIN_COSINE)
            at_rows.append((camera[:2, 3] + ahead[:, :2] * reach) / self._distance_m)
        first, middle, final = at_rows
        s = self._pixels[:, 1:] / last * 2.0 - 1.0
        on_wall = middle + s * (final - first) / 2.0 + s * s * ((final + first) / 2.0 - middle)
        return np.asarray(on_wall * (_TEXELS / _SPAN) + (_TEXELS - 1) / 2.0)


def _painted(room: Room) -> Image:
    """(_TEXELS, _TEXELS) levels."""
    picture = _picture(room.texture)
    return np.asarray(room.level * (1.0 + picture * (room.contrast / np.abs(picture).max())), np.float32)


@lru_cache(maxsize=1)  # one room is often photographed several times: with panels, with prints in their place
def _picture(texture: int) -> Image:
    """(_TEXELS, _TEXELS) of mean 0: blotches of every size, boards, frames, lines."""
    rng = np.random.default_rng((texture, 77))
    picture = np.zeros((_TEXELS, _TEXELS), np.float32)
    for octave in range(2, 9):
        grain = rng.standard_normal((2**octave, 2**octave)).astype(np.float32)
        picture += cv2.resize(grain, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC) * 0.6**octave
    picture /= np.abs(picture).max()
    for _ in range(60):
        x, y = rng.integers(0, _TEXELS, 2)
        width, height = (int(v) for v in rng.integers(15, 220, 2))
        shade = float(rng.uniform(-0.8, 0.8))
        far = (int(x) + width, int(y) + height)
        cv2.rectangle(picture, (int(x), int(y)), far, shade, int(rng.choice([cv2.FILLED, 2, 6])), cv2.LINE_AA)
    for _ in range(120):
        x, y = rng.integers(0, _TEXELS, 2)
        dx, dy = rng.integers(-90, 90, 2)
        end = (int(x + dx), int(y + dy))
        shade, thick = float(rng.uniform(-0.9, 0.9)), int(rng.integers(1, 4))
        cv2.line(picture, (int(x), int(y)), end, shade, thick, cv2.LINE_AA)
    picture -= picture.mean()
    return picture


_MAX_TANGENT = 2.75  # of a corner's angle from the optical axis, 70°: lens models end there


def scene_truth(scene: Scene, seq: int) -> tuple[TruthMarker, ...]:
    """The markers that are in view in frame `seq`."""
    found = (marker_truth(p, pose_seen(scene, p.motion), scene.sensor, seq) for p in scene.panels)
    return tuple(truth for truth in found if truth is not None)


def pose_seen(scene: Scene, motion: Trajectory) -> PoseAt:
    """camera_from_body of what moves so, as a function of time."""
    camera = scene.camera_motion
    return lambda t_s: inverse(camera.scene_from_body(t_s)) @ motion.scene_from_body(t_s)


def panel_corners_m(side_m: float) -> Floats:
    """(4, 3) corners in a panel's frame, in the marker's order."""
    return side_m / 2.0 * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])


def marker_truth(panel: Panel, pose_at: PoseAt, sensor: SimulatedSensor, seq: int) -> TruthMarker | None:
    """A panel's truth in frame `seq`; None for decoys, panels out of view, and panels that turn their back.

    Each corner is where its own row's mid-exposure sees it; the pose is at the mid-exposure of the row of the
    panel's centre. Whether something else stands before the panel is not looked at.
    """
    corners_m = panel_corners_m(panel.spec.side_m)
    mid_frame = pose_at(sensor.mid_exposure_s(seq, (sensor.intrinsics.height - 1) / 2.0))
    if panel.marker_id is None or not _is_before_camera(corners_m, mid_frame):
        return None
    corners = np.array([seen_at(corner, pose_at, sensor, seq)[0] for corner in corners_m])
    in_view, whole = _is_in_view(corners, sensor.intrinsics)
    if not in_view:
        return None
    pose = pose_at(seen_at(np.zeros(3), pose_at, sensor, seq)[1])
    return TruthMarker(
        id=panel.marker_id,
        corners_px=read_only(corners),
        camera_from_marker=Pose(
            position_m=read_only(pose[:3, 3]), quaternion_wxyz=read_only(quaternion_from_matrix(pose[:3, :3]))
        ),
        optional=not whole,
    )


def _is_before_camera(corners_m: Floats, camera_from_marker: Floats) -> bool:
    in_camera = corners_m @ camera_from_marker[:3, :3].T + camera_from_marker[:3, 3]
    wide = np.linalg.norm(in_camera[:, :2], axis=1) > _MAX_TANGENT * in_camera[:, 2]
    return shows_front(camera_from_marker) and not bool(np.any(wide))


def _is_in_view(corners: Floats, lens: Intrinsics) -> tuple[bool, bool]:
    """Tells whether any of a quad is in the picture, and whether all of it is."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    picture = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], np.float32)
    shared_area = cv2.intersectConvexConvex(corners.astype(np.float32), picture)[0]
    inside = (corners >= -0.5) & (corners <= (right, bottom))
    return shared_area > 0, bool(inside.all())
