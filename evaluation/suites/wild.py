"""Draws a take of the suite `wild`: a panel as anybody may have built it, seen by any camera, all varied at once."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from evaluation.simulated import BuiltAppearance, GlossyFloor
from evaluation.suites.decoys import place_in_view
from evaluation.suites.draw import Take, brightness_of, drawable_ids
from evaluation.suites.surroundings import BEFORE, page_behind, rectangle
from evaluation.suites.wild_rows import CAMERA_SPANS, TAKE_SPANS, TAKES_A_CAMERA, WILD, drawn
from ledpi.camera.simulate.render import panel_corners_m
from ledpi.camera.simulate.scene import Light, Panel, Print, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import whole_rows_us
from ledpi.camera.simulate.trajectory import Still
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Intrinsics

PAGE_SIDES = 2.5  # its width in sides of the panel
CRYSTAL_PPM = 100.0  # that an oscillator may be off by
FAULTY = 1 / 16  # of the panels have a dead cell; of as many, something hides a strip


def draw_wild(row: str, panels: PanelSettings, seed: int, number: int) -> Take:
    """Take `number` of a row. What a range cannot say, as which cell is dead, comes from a stream of random numbers."""
    values = drawn(TAKE_SPANS, row, seed, number)
    rng = np.random.default_rng((seed, zlib.crc32(row.encode()), number))
    sensor = draw_camera(row, seed, number)
    panel = _panel(values, row, panels, sensor, rng)
    pose = panel.motion.scene_from_body(0.0)
    scene = Scene(
        sensor=sensor,
        room=Room(
            level=values["room_level"],
            contrast=values["room_contrast"],
            distance_m=float(pose[2, 3]) + 2.5,
            texture=int(rng.integers(2**31)),
        ),
        panels=(panel,),
        prints=_page(values, panel, rng),
        lights=(*_frame(values, panel), *_hiding(values, panel, rng)),
        floor=_floor(values, pose, panel.spec.side_m),
    )
    return Take(scene=scene, peak_level=values["peak_level"], seed=int(rng.integers(2**63)), reported_row_time=1.0)


def draw_camera(row: str, seed: int, number: int) -> SimulatedSensor:
    """The camera of take `number`, which it shares with the others that are written into one recording."""
    values = drawn(CAMERA_SPANS, row, seed, number // TAKES_A_CAMERA)
    k1, row_time_us = values["k1"], values["row_time_us"]
    return SimulatedSensor(
        intrinsics=Intrinsics(
            width=640,
            height=480,
            fx=values["focal_px"],
            fy=values["focal_px"],
            cx=319.5 + values["centre_x"],
            cy=239.5 + values["centre_y"],
            distortion=(k1, -2.0 * k1, 0.005 * k1, -0.005 * k1, 0.6 * k1),  # in the proportions of the Pi's lens
        ),
        exposure_us=whole_rows_us(WILD[row].exposure_us, row_time_us),
        row_time_us=row_time_us,
        frame_length_rows=round(values["frame_length_rows"]),
        transfer="linear" if values["tone"] < 0.5 else "srgb",
        psf_sigma_px=values["psf_sigma_px"],
        defocus_px=values["defocus_px"],
        full_well_e=values["full_well_e"],
        read_noise_e=values["read_noise_e"],
    )


def _panel(
    values: dict[str, float], row: str, panels: PanelSettings, sensor: SimulatedSensor, rng: np.random.Generator
) -> Panel:
    dictionary = load_dictionary(panels.dictionary)
    drawable = drawable_ids(panels)
    marker_id = drawable[int(values["id"] * len(drawable))]
    spec = panels.spec(marker_id)
    (near, far), (low, high) = WILD[row].distance_m, WILD[row].yaw_deg
    (pose,) = place_in_view(
        [(0.0, spec.side_m, values["roll_deg"])],
        float(near * (far / near) ** values["distance"]),  # each doubling as frequent
        float(np.copysign(low + abs(values["yaw"]) * (high - low), values["yaw"])),
        np.array([values["place_x"], values["place_y"]]),
        sensor,
    )
    off = 1.0 + 1e-6 * CRYSTAL_PPM * rng.uniform(-1.0, 1.0, len(spec.waves_hz))
    n = dictionary.cells_per_side
    gains = 1.0 + values["gain"] * rng.uniform(-1.0, 1.0, (n, n))
    if values["fault"] < FAULTY:
        gains.flat[rng.integers(n * n)] = 0.0
    return Panel(
        codeword=dictionary.codeword(marker_id),
        spec=spec.retune([hz * own for hz, own in zip(spec.waves_hz, off.tolist(), strict=True)]),
        motion=Still(pose),
        marker_id=marker_id,
        brightness=brightness_of(values["peak_level"], spec, sensor),
        cell_gains=gains,
        appearance=_appearance(values),
    )


def _appearance(values: dict[str, float]) -> BuiltAppearance:
    leds = 1 if values["leds"] < 0.5 else 2 if values["leds"] < 0.75 else 3
    equal = values["equal_cells"] >= 0.75
    return BuiltAppearance(
        gap=values["gap"] / 2.0 if equal else values["gap"],
        equal_cells=equal,
        bezel=max(0.0, values["bezel"]),
        falloff=values["falloff"],
        hot_spot=values["hot_spot"],
        hot_spot_sigma=values["hot_spot_sigma"] / leds,
        leds=leds,
        depth=max(0.0, values["depth"]),
        wall_glow=values["wall_glow"],
        albedo=values["albedo"],
    )


def _page(values: dict[str, float], panel: Panel, rng: np.random.Generator) -> tuple[Print, ...]:
    """Spots of any level about the room's, close behind the panel: letters, tiles, bricks, leaves."""
    if values["page"] <= 0:
        return ()
    spots, (room, contrast) = round(PAGE_SIDES * values["page_spots"]), (values["room_level"], values["page"])
    page = page_behind(panel, spots, PAGE_SIDES, rng, depth=1.004)  # behind a bright frame, too
    return (replace(page, white=room * (1.0 + contrast), black=room * (1.0 - contrast)),)


def _frame(values: dict[str, float], panel: Panel) -> tuple[Light, ...]:
    """A bright frame, that the panel lights or the room does, close behind it."""
    if values["frame_level"] <= 0:
        return ()
    side_m = panel.spec.side_m * (1.0 + 2.0 * (values["frame_width"] + max(0.0, values["bezel"]) / len(panel.codeword)))
    level = values["frame_level"] * panel.brightness
    return (rectangle(panel, 0.0, (0.0, 0.0), (side_m, side_m), depth=1.002, level=level),)


def _hiding(values: dict[str, float], panel: Panel, rng: np.random.Generator) -> tuple[Light, ...]:
    """Something well before the panel that hides a strip along one side."""
    if not FAULTY <= values["fault"] < 2.0 * FAULTY:
        return ()
    side_m = panel.spec.side_m
    turn = float(rng.integers(4)) * np.pi / 2.0
    size_m = (1.4 * side_m, 2.0 * values["hidden"] * side_m)
    return (rectangle(panel, turn, (0.0, 0.5 * side_m), size_m, depth=BEFORE, level=values["hidden_level"]),)


def _floor(values: dict[str, float], pose: Floats, side_m: float) -> GlossyFloor | None:
    """Below the panel's lowest corner, and below the camera."""
    if values["floor"] <= 0:
        return None
    lowest_m = float((panel_corners_m(side_m) @ pose[1, :3]).max() + pose[1, 3])
    return GlossyFloor(y_m=max(lowest_m + values["floor_below"] * side_m, 0.05), reflectance=values["floor"])
