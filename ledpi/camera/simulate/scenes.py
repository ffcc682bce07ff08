"""Ready-made scenes, and the sensor of the Pi's camera."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ledpi.camera.simulate.scene import FIRST_READOUT_NS, Panel, Print, Room, Scene, SimulatedSensor, uneven_gains
from ledpi.camera.simulate.trajectory import Patrol, Shown, Still, facing_camera
from ledpi.core.codewords import Bits
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, transform
from ledpi.core.records import Intrinsics, MapPanel, PanelMap, PanelSpec

_DRIVE_PANELS = (  # ID, place in the scene, yaw, brightness
    (7, (-0.22, -0.05, 2.75), 8.0, 0.45),
    (23, (0.25, 0.06, 3.0), -15.0, 0.38),
)
DRIVE_IDS = tuple(panel[0] for panel in _DRIVE_PANELS)
_DRIVE_SIDE_M = 0.16  # that the drive's distances are meant for
_MIN_EXPOSURE_ROWS = 4  # the OV5647 driver's lower limit


def ov5647_lens(width: int = 640, height: int = 480) -> Intrinsics:
    """The Pi camera v1: 3.6 mm lens, pixels of 4 × 1.4 µm in the 640×480 mode, distortion of a usual size."""
    focal_px = 3.6e-3 / (4 * 1.4e-6) * width / 640
    return Intrinsics(
        width=width,
        height=height,
        fx=focal_px,
        fy=focal_px,
        cx=(width - 1) / 2 + 0.004 * width,
        cy=(height - 1) / 2 - 0.003 * width,
        distortion=(0.1, -0.2, 0.0005, -0.0005, 0.06),
    )


def whole_rows_us(exposure_us: float, row_time_us: float) -> float:
    """Returns what the sensor makes of an exposure that is asked for: whole rows, rounded down, four at least."""
    rows = math.floor(exposure_us / row_time_us + 1e-6)
    return max(rows, _MIN_EXPOSURE_ROWS) * row_time_us


def still_scene(
    sensor: SimulatedSensor, specs: Mapping[int, PanelSpec], dictionary: str, *, distance_m: float, angle_deg: float
) -> Scene:
    """Panels side by side before a camera at rest, each turned about its vertical axis as in the paper.

    `specs` holds each ID's panel; they stand 1.5 sides apart, at the same depth.
    """
    pitch_m = 1.5 * max(spec.side_m for spec in specs.values())
    panels = []
    for place, (marker_id, spec) in enumerate(specs.items()):
        position = np.array([(place - (len(specs) - 1) / 2.0) * pitch_m, 0.0, distance_m])
        pose = facing_camera(position, yaw_deg=angle_deg)
        codeword = load_dictionary(dictionary).codeword(marker_id)
        panels.append(Panel(codeword=codeword, spec=spec, motion=Still(pose), marker_id=marker_id))
    return Scene(sensor=sensor, panels=tuple(panels))


MOST_ABREAST = 8  # panels of `abreast_scene`
_ABREAST_SIDES = tuple(
    (x, y) for y in (-1.375, 1.375) for x in (-2.8125, -0.9375, 0.9375, 2.8125)
)  # four across, two down


def abreast_scene(sensor: SimulatedSensor, specs: Mapping[int, PanelSpec], dictionary: str) -> Scene:
    """Up to eight panels at rest, 8.75 sides away before a textured wall, each turned by 5° more than the last."""
    side_m = max(spec.side_m for spec in specs.values()) if specs else _DRIVE_SIDE_M
    panels = tuple(
        Panel(
            codeword=load_dictionary(dictionary).codeword(marker_id),
            spec=spec,
            motion=Still(facing_camera(side_m * np.array([*_ABREAST_SIDES[place], 8.75]), roll_deg=5.0 * place)),
            marker_id=marker_id,
        )
        for place, (marker_id, spec) in enumerate(specs.items())
    )
    return Scene(sensor=sensor, panels=panels, room=Room(distance_m=18.75 * side_m))


def drive_scene(sensor: SimulatedSensor, specs: Mapping[int, PanelSpec], dictionary: str) -> Scene:
    """A robot that drives up to two panels, 7 and 23, and back, for ever: 0.7 to 2.5 m away, up to 0.7 m/s.

    Distances and speeds are of panels of 16 cm; they grow with the panels. Raises ValueError for a dictionary without
    these IDs.
    """
    scale = max(spec.side_m for spec in specs.values()) / _DRIVE_SIDE_M
    panels = []
    for marker_id, place, yaw_deg, brightness in _DRIVE_PANELS:
        codeword = load_dictionary(dictionary).codeword(marker_id)
        panels.append(
            Panel(
                codeword=codeword,
                spec=specs[marker_id],
                motion=Still(facing_camera(scale * np.array(place), yaw_deg=yaw_deg, roll_deg=yaw_deg / 3)),
                marker_id=marker_id,
                brightness=brightness,
                cell_gains=uneven_gains(np.random.default_rng(marker_id), len(codeword), 0.05),
            )
        )
    patrol = Patrol(
        period_s=10.0,
        centre_m=scale * np.array([0.0, 0.0, 1.15]),
        swing_m=(0.3 * scale, 0.9 * scale),
        looks_at_m=scale * np.array([0.0, 0.0, 2.9]),
    )
    room = Room(distance_m=4.5 * scale)
    return Scene(sensor=sensor, panels=tuple(panels), camera_motion=patrol, room=room)


# Of the drive: the map's x is ahead in the scene, y to the left, z up, and the camera drives 1.2 m above the floor.
MAP_FROM_SCENE = transform(CAMERA_LINK_FROM_CAMERA, np.array([0.0, 0.0, 1.2]))


def drive_map(side_m: float = _DRIVE_SIDE_M) -> PanelMap:
    """Returns where the panels of the drive hang, placed without an error that matters."""
    scale = side_m / _DRIVE_SIDE_M
    return {
        marker_id: MapPanel(
            map_from_marker=MAP_FROM_SCENE
            @ facing_camera(scale * np.array(place), yaw_deg=yaw_deg, roll_deg=yaw_deg / 3),
            position_sigma_m=0.001,
            angle_sigma_rad=0.001,
        )
        for marker_id, place, yaw_deg, _ in _DRIVE_PANELS
    }


def board_scene(sensor: SimulatedSensor, black: Bits, width_m: float) -> Scene:
    """A board that is held before the camera for half a second at each of 20 places, tilted to every side.

    `black`, (rows, columns) texels: the printed board, `width_m` wide without the white around it. It is brought so
    near that its outer parts leave the view.
    """
    near = 1.75 * width_m
    places = tuple(
        (np.array([x * width_m, y * width_m, near * depth]), np.array([pitch, yaw, 3.0 * number]))
        for number, (pitch, yaw, depth) in enumerate(
            [(0.0, 30.0, 1.0), (0.0, -30.0, 1.1), (30.0, 0.0, 1.0), (-30.0, 0.0, 1.1), (0.0, 0.0, 1.0)]
        )
        for x, y in ((-0.42, -0.3), (0.42, -0.3), (0.42, 0.3), (-0.42, 0.3))
    )
    motion = Shown(places=places, each_s=0.5, rest_s=0.4, start_s=FIRST_READOUT_NS * 1e-9)
    paper = Print(modules=~black, width_m=width_m, motion=motion, quiet_modules=black.shape[1] // 14)
    return Scene(sensor=sensor, prints=(paper,), room=Room(distance_m=8.0 * width_m))
