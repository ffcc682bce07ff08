"""The rolling-shutter renderer: (scene, seed, frame number) → picture and truth, in whatever order.

Linear light of a pixel in row y = what is behind × (1 − opacity) + Σ over classes of picture × w(y),
surface by surface from far to near (`exposure`), then noise and codes (`sensor`). Each panel has its own
oscillator for each class; all run from t = 0 of the camera's clock, from a phase that the seed decides. A panel
whose cells were traced shows what the trace says.
"""

from __future__ import annotations

import numpy as np

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulate.exposure import Exposed, add_to, expose_moving, expose_still
from ledpi.camera.simulate.optics import PoseAt, shows_front
from ledpi.camera.simulate.scene import Panel, Scene
from ledpi.camera.simulate.sensor import SensorReadout
from ledpi.camera.simulate.surface import Image, Surface, light_surface, panel_surface, print_surface
from ledpi.camera.simulate.truth import pose_seen, scene_truth
from ledpi.camera.simulate.wall import Wall
from ledpi.core.geometry import inverse
from ledpi.core.records import Floats, Frame, Pixels

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

    def frame(self, seq: int, *, reported_row_time: float = 1.0) -> Frame:
        """Frame `seq`, in pixels of its own, with what the driver says of it: row time and exposure times a factor."""
        sensor = self.scene.sensor
        pixels = np.empty((sensor.intrinsics.height, sensor.intrinsics.width), np.uint8)
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
