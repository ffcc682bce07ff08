"""Blinking panels through a rolling shutter. Truth: counting points, and arithmetic by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from evaluation.simulated import BuiltAppearance, Ripple
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Light, PanelAppearance, Room, Scene, SquareWave
from ledpi.camera.simulate.trajectory import Gliding, Still, Trajectory, facing_camera
from ledpi.core.geometry import transform
from ledpi.core.records import Pixels
from tests.builders.simulate import (
    DARK,
    LENS,
    PINHOLE,
    WORD_7,
    dark_scene,
    light_by_counting,
    panel,
    sensor,
    share_on,
    standing,
)

EXPOSURE_S = 9967e-6


def exposure_start_s(seq: int, row: int) -> float:
    """Row 0 of frame 0 is read out at 1 s; a frame is 504 rows of 33.67 µs."""
    return 1.0 + (seq * 504 + row) * 33.67e-6 - EXPOSURE_S


def picture(renderer: Renderer, seq: int) -> Pixels:
    pixels = np.empty((480, 640), np.uint8)
    renderer.render(seq, pixels)
    return pixels


@pytest.mark.parametrize("psf_sigma_px", [0.0, 2.0])
def test_bands_in_a_cell_are_the_square_wave_integrated_over_each_rows_exposure(psf_sigma_px: float) -> None:
    """Rows show the share of their own exposure in which their class was on, in each cell, row 0 at the top."""
    camera = sensor(PINHOLE, psf_sigma_px=psf_sigma_px)
    renderer = Renderer(dark_scene(panel(standing(z_m=0.4)), camera=camera), seed=5)
    black_phase, white_phase = renderer.phases_cycles[0]
    for seq in (0, 3, 1000):
        light = renderer.light(seq)
        for i, j in np.ndindex(4, 4):  # the panel spans 256 px, rows 112 to 367
            frequency, phase = (2450.0, white_phase) if WORD_7[i, j] else (1250.0, black_phase)
            for row in range(112 + 64 * i + 15, 112 + 64 * i + 50, 10):
                expected = 0.4 / 0.5 * share_on(exposure_start_s(seq, row), EXPOSURE_S, frequency, phase)
                assert light[row, 192 + 64 * j + 32] == pytest.approx(expected, abs=4e-4)


@pytest.mark.slow
def test_a_still_panel_through_a_lens_agrees_with_counting() -> None:
    """Perspective, distortion, pixel area, blur and bands: the light of each pixel as counted."""
    still = panel(standing(0.3, -0.2, 1.5, yaw_deg=50, roll_deg=20))
    for blur, rows, tolerance in ((0.0, (130, 150, 170), 0.010), (0.7, (150,), 0.006)):
        scene = dark_scene(still, camera=sensor(LENS, psf_sigma_px=blur))
        renderer = Renderer(scene, seed=3)
        light = renderer.light(0)
        for row in rows:
            counted = light_by_counting(scene, renderer.phases_cycles[0], 0, row, range(405, 480), steps=1)
            assert np.abs(light[row, 405:480] - counted).max() < tolerance
            assert light[row, 405:480].sum() == pytest.approx(counted.sum(), rel=0.003)


def test_a_moving_panel_agrees_with_counting() -> None:
    """Blur along the motion, skew from row to row, and blinking within the exposure, against 200 moments a row."""
    motion = Gliding(
        start=facing_camera(np.array([0.3, -0.2, 1.5]), yaw_deg=20, roll_deg=10),
        velocity_m_s=np.array([1.0, 0.3, -0.3]),
        angular_velocity_rad_s=np.array([0.2, 0.5, 0.5]),
        start_s=1.0,
    )
    scene = dark_scene(panel(motion), camera=sensor(LENS, psf_sigma_px=0.0))
    renderer = Renderer(scene, seed=3)
    light = renderer.light(0)
    for row in (130, 150, 170):
        counted = light_by_counting(scene, renderer.phases_cycles[0], 0, row, range(405, 495), steps=200)
        assert np.abs(light[row, 405:495] - counted).max() < 0.012
        assert light[row, 405:495].sum() == pytest.approx(counted.sum(), rel=0.003)


def gliding_sideways(velocity_m_s: float, z_m: float = 1.0) -> Gliding:
    start = facing_camera(np.array([0.0, 0.0, z_m]))
    return Gliding(start=start, velocity_m_s=np.array([velocity_m_s, 0, 0]), start_s=1.0)


def test_a_moving_camera_and_a_moving_panel_are_the_same_thing() -> None:
    """Only the relative motion counts: the camera going left shows what the panel going right shows."""
    camera = sensor(LENS)
    by_panel = dark_scene(panel(gliding_sideways(0.4)), camera=camera)
    drift = Gliding(start=np.eye(4), velocity_m_s=np.array([-0.4, 0, 0]), start_s=1.0)
    by_camera = Scene(sensor=camera, panels=(panel(standing()),), room=DARK, camera_motion=drift)
    np.testing.assert_allclose(Renderer(by_panel, seed=4).light(2), Renderer(by_camera, seed=4).light(2), atol=1e-5)


def test_a_frame_depends_on_the_seed_and_its_number_only() -> None:
    """The same frame comes again whatever was rendered before it; another seed gives another one."""
    scene = Scene(sensor=sensor(), panels=(panel(standing()), panel(gliding_sideways(0.5), marker_id=23)))
    forward, backward = Renderer(scene, seed=9), Renderer(scene, seed=9)
    first = {seq: picture(forward, seq) for seq in (0, 1, 5)}
    for seq in (5, 1, 0):
        np.testing.assert_array_equal(picture(backward, seq), first[seq])
    assert np.any(first[0] != picture(Renderer(scene, seed=10), 0))
    assert np.mean(first[0] != first[1]) > 0.3  # fresh noise in every frame, over the whole picture


def test_cells_have_walls_hot_spots_and_gains() -> None:
    """Between cells it is dark, in their middle brightest, and a gain scales its own cell."""
    appearance = PanelAppearance(gap=0.1, bezel=0.2, falloff=0.3, hot_spot=0.3, hot_spot_sigma=0.15, albedo=0.0)
    plain = panel(standing(z_m=0.4), appearance=appearance)
    gains = np.ones((4, 4))
    gains[0, 0] = 0.5
    uneven = dataclasses.replace(plain, cell_gains=gains)
    camera = sensor(PINHOLE, psf_sigma_px=0.3)
    light, weak = (Renderer(dark_scene(p, camera=camera), seed=5).light(0) for p in (plain, uneven))
    assert light[144, 256] == 0.0  # on the wall between the first two cells of the top row
    assert light[144, 224] > 1.3 * light[144, 204] > 0  # middle of the first cell, near its left wall
    assert weak[144, 224] == pytest.approx(light[144, 224] / 2, rel=1e-5)
    assert weak[144, 288] == light[144, 288]
    assert light[144, 190] == 0.0  # the bezel
    assert light[144, 194] > 0.1  # the lit grid begins at column 192, without a wall


@pytest.mark.parametrize("equal", [False, True])
def test_cells_of_one_size_or_on_a_lattice(equal: bool) -> None:
    """Walls of a tenth, on a lattice from column 252.8 to 259.2, between equal cells from 251.1 to 257.6."""
    appearance = BuiltAppearance(gap=0.1, bezel=0.1, falloff=0.0, hot_spot=0.0, albedo=0.0, equal_cells=equal)
    camera = sensor(PINHOLE, psf_sigma_px=0.0)
    row = Renderer(dark_scene(panel(standing(z_m=0.4), appearance=appearance), camera=camera), seed=5).light(0)[144]
    assert (row[252] < 0.1, row[258] > 0.1) == (equal, equal)
    assert (row[320], row[190], row[450]) == (0.0, 0.0, 0.0)
    assert min(row[194], row[446], row[240], row[280]) > 0.1


def test_a_dark_panel_hides_the_wall() -> None:
    """A panel's face is opaque: it returns its albedo of the room, whatever is behind."""
    appearance = PanelAppearance(albedo=0.25)
    scene = Scene(
        sensor=sensor(PINHOLE), panels=(panel(standing(), brightness=0.0, appearance=appearance),), room=Room(level=0.2)
    )
    light = Renderer(scene, seed=0).light(0)
    assert light[240, 320] == pytest.approx(0.25 * 0.2)
    assert np.ptp(light[:100]) > 0.02  # the wall has a texture
    assert light.mean() == pytest.approx(0.2, rel=0.25)


def lamp(shape: str, z_m: float, level: float, wave: SquareWave | None = None, y_m: float = 0.0) -> Light:
    return Light(
        shape=shape,  # type: ignore[arg-type]
        width_m=0.2,
        height_m=0.2,
        motion=Still(facing_camera(np.array([0.0, y_m, z_m]))),
        level=level,
        wave=wave,
    )


def test_the_nearer_thing_hides_the_farther() -> None:
    """Whatever their order in the scene, surfaces are painted from far to near."""
    near, far = lamp("rectangle", 1.0, 0.3), lamp("rectangle", 1.5, 0.7, y_m=0.1)
    for lights in ((near, far), (far, near)):
        light = Renderer(Scene(sensor=sensor(PINHOLE), lights=lights, room=DARK), seed=0).light(0)
        assert light[290, 320] == pytest.approx(0.3, abs=1e-5)  # both are there
        assert light[315, 320] == pytest.approx(0.7, abs=1e-5)  # only the farther one


def test_lamps_have_their_shape() -> None:
    """A disc has no corners; a lattice has dark bars between its panes."""
    disc = Renderer(Scene(sensor=sensor(PINHOLE), lights=(lamp("disc", 1.0, 0.5),), room=DARK), seed=0).light(0)
    assert disc.sum() == pytest.approx(0.5 * np.pi * 64**2, rel=0.003)
    lattice = Renderer(Scene(sensor=sensor(PINHOLE), lights=(lamp("lattice", 1.0, 0.5),), room=DARK), seed=0).light(0)
    assert lattice[200, 320] == pytest.approx(0.5, abs=1e-4)  # 3 panes across, 2 down: the middle of one
    assert lattice[240, 320] < 0.05
    assert lattice[200, 299] < 0.25


@pytest.mark.slow
def test_a_pwm_lamp_has_bands_of_its_own_frequency() -> None:
    """Its rows are the integral of its own square wave, of unequal duty."""
    wave = SquareWave(frequency_hz=333.0, duty=0.2)
    scene = Scene(sensor=sensor(PINHOLE), lights=(lamp("rectangle", 0.5, 0.1, wave),), room=DARK)
    rows = np.arange(150, 330, 9)
    light = Renderer(scene, seed=0).light(0)[rows, 320]
    fits = [
        [0.1 / 0.2 * share_on(exposure_start_s(0, int(row)), EXPOSURE_S, 333.0, phase, 0.2) for row in rows]
        for phase in np.arange(0, 1, 1 / 64)
    ]
    best = min(float(np.abs(light - np.array(fit)).max()) for fit in fits)
    assert np.ptp(light) > 0.02
    assert best < 0.004


def test_a_panel_from_behind_or_behind_the_camera_is_not_there() -> None:
    """No light from a panel that turns its back, lies behind the camera, or is out of view.

    At 5 cm its corners are 66° aside, where a lens's equation may have folded back: what it shows is drawn.
    """
    turned = Still(transform(np.diag([-1.0, -1.0, 1.0]), np.array([0.0, 0.0, 1.0])))
    for motion in (turned, standing(z_m=-1.0), standing(x_m=3.0)):
        assert Renderer(dark_scene(panel(motion), camera=sensor()), seed=0).light(0).max() == 0.0
    folding = dataclasses.replace(PINHOLE, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    light = Renderer(dark_scene(panel(standing(z_m=0.05)), camera=sensor(folding)), seed=5).light(0)
    assert np.isfinite(light).all()
    assert light[240].max() > 0.1


@pytest.mark.parametrize(("frequency_hz", "left"), [(100.0, 0.0), (120.0, -0.156)])
def test_mains_flicker_bands_the_room_as_far_as_the_exposure_leaves_it(frequency_hz: float, left: float) -> None:
    """10 ms hold one cycle of 100 Hz, and nothing is left; of 120 Hz sinc 1.2 = sin(1.2π)/(1.2π), about 16 %."""
    ripple = Ripple(frequency_hz=frequency_hz, depth=0.6)
    camera = sensor(PINHOLE, exposure_us=10_000.0)

    def rows(room: Room) -> np.ndarray:
        return np.array(Renderer(Scene(sensor=camera, room=room), seed=3).light(4).mean(axis=1))

    ratio = rows(Room(ripple=ripple)) / rows(Room())
    assert np.ptp(ratio) == pytest.approx(2 * 0.6 * abs(left), abs=0.003)
    if left:
        y = np.arange(480.0)
        wave = np.exp(2j * np.pi * frequency_hz * 33.67e-6 * y)
        fit = np.linalg.lstsq(np.column_stack([np.ones(480), wave.real, wave.imag]), ratio, rcond=None)
        assert float(fit[1][0]) < 1e-6  # all of it is the ripple's own frequency


def test_antiphase_classes_are_half_a_cycle_apart() -> None:
    """A panel of one class only is dark where one of the other is bright: together they do not flicker."""
    usual = panel(standing(z_m=1.0))
    spec = dataclasses.replace(usual.spec, white_hz=usual.spec.black_hz, phase="antiphase")
    black, white = (
        Renderer(
            dark_scene(dataclasses.replace(usual, spec=spec, codeword=np.full((4, 4), own)), camera=sensor(PINHOLE)),
            seed=1,
        ).light(0)[200:280, 320]
        for own in (False, True)
    )
    still = (black + white) / 2
    assert np.ptp(black / still) > 0.06
    np.testing.assert_allclose(black / still - 1, 1 - white / still, atol=1e-5)


def test_each_row_of_the_wall_is_seen_from_where_the_camera_is_then() -> None:
    """At the row's mid-exposure, by a camera that drives, turns and speeds past it: as by one that stands there.

    And 0.1 m to the right, before a wall 2 m away, it sees the wall 32 px further left; half a metre nearer, what was
    three columns from the middle is four columns from it.
    """
    camera, room = sensor(PINHOLE), Room(distance_m=2.0)
    motion = Gliding(
        start=transform(np.eye(3), np.array([0.1, -0.05, 0.2])),
        velocity_m_s=np.array([2.0, 0.5, 1.0]),
        angular_velocity_rad_s=np.array([0.5, 3.0, 1.0]),
        start_s=1.0,
    )

    def seen(by: Trajectory, seq: int) -> np.ndarray:
        return np.array(Renderer(Scene(sensor=camera, room=room, camera_motion=by), seed=0).light(seq), np.float64)

    moving = seen(motion, 3)
    for row in (0, 120, 240, 300, 479):
        mid_exposure_s = exposure_start_s(3, row) + EXPOSURE_S / 2
        there = seen(Still(motion.scene_from_body(mid_exposure_s)), 0)[row]
        assert np.abs(there - moving[row]).max() < 0.02 * np.ptp(there)
    ahead, aside, nearer = (
        seen(Still(transform(np.eye(3), np.array([x_m, 0.0, z_m]))), 0) for x_m, z_m in ((0, 0), (0.1, 0), (0, 0.5))
    )
    np.testing.assert_allclose(aside[:, :-32], ahead[:, 32:], atol=0.02 * np.ptp(ahead))
    np.testing.assert_allclose(nearer[240, 320:600:4], ahead[240, 320:530:3], atol=0.05 * np.ptp(ahead))
