"""The simulator against recordings that were rendered by other code: same geometry, same depth of the bands."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from ledpi.camera.simulate.optics import project
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Panel, PanelAppearance, Scene, SimulatedSensor
from ledpi.camera.simulate.trajectory import Still
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import matrix_from_quaternion, transform
from ledpi.core.records import Floats, Intrinsics, PanelSpec
from ledpi.core.shutter import harmonic_amplitude
from ledpi.core.tone import linear_light

HARMONICS = (1, 3, 5)  # a square wave of duty 0.5 has odd ones only
CORNERS = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) / 2.0  # of a unit panel


@dataclass(frozen=True)
class Take:
    """Frames of one panel that stands still."""

    sensor: SimulatedSensor
    spec: PanelSpec
    marker_id: int
    pose: Floats  # (4, 4) camera_from_marker
    corners_px: Floats
    times_s: Floats  # (frames,) start of row 0's read-out
    light: Floats  # (frames, H, W), linear, NaN where saturated


def lines_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def sensor_of(camera: dict[str, Any]) -> SimulatedSensor:
    lens_keys = ("width", "height", "fx", "fy", "cx", "cy")
    exposure_keys = ("exposure_us", "row_time_us", "frame_length_rows", "transfer")
    lens = Intrinsics(**{k: camera[k] for k in lens_keys}, distortion=tuple(camera["distortion"]))
    return SimulatedSensor(intrinsics=lens, **{k: camera[k] for k in exposure_keys})


def pose_of(marker: dict[str, Any]) -> Floats:
    rotation = matrix_from_quaternion(np.array(marker["quaternion_wxyz"]))
    return transform(rotation, np.array(marker["position_m"]))


def take(folder: Path) -> Take:
    """The first take of a recording. Read here, by the format's description alone."""
    header = yaml.safe_load((folder / "recording.yaml").read_text())
    frames, truth = (lines_of(folder / name) for name in ("frames.jsonl", "truth.jsonl"))
    marker = truth[0]["markers"][0]
    same = [frame for frame, true in zip(frames, truth, strict=True) if true["markers"] == truth[0]["markers"]]
    camera, panel = header["camera"], header["panel"]
    pictures = [cv2.imread(str(folder / frame["file"]), cv2.IMREAD_GRAYSCALE) for frame in same]
    return Take(
        sensor=sensor_of(camera),
        spec=PanelSpec(**{k: panel[k] for k in ("side_m", "black_hz", "white_hz", "duty")}),
        marker_id=marker["id"],
        pose=pose_of(marker),
        corners_px=np.array(marker["corners_px"]),
        times_s=np.array([frame["sensor_timestamp_ns"] * 1e-9 for frame in same]),
        light=linear_light(camera["transfer"])[np.stack(pictures)].astype(np.float64),
    )


def rendered_as(original: Take, *, seed: int) -> Take:
    """The same panel, frames and exposure, by our renderer."""
    panel = Panel(
        codeword=load_dictionary("DICT_4X4_50").codeword(original.marker_id),
        spec=original.spec,
        motion=Still(original.pose),
        marker_id=original.marker_id,
        appearance=PanelAppearance(bezel=0.0, albedo=0.0),
    )
    renderer = Renderer(Scene(sensor=original.sensor, panels=(panel,)), seed=seed)
    pictures = np.empty((len(original.times_s), *original.light.shape[1:]), np.uint8)
    for seq, picture in enumerate(pictures):
        renderer.render(seq, picture)
    times_s = np.array([original.sensor.row0_readout_ns(seq) * 1e-9 for seq in range(len(pictures))])
    light = linear_light(original.sensor.transfer)[pictures].astype(np.float64)
    return Take(**{**{k: getattr(original, k) for k in Take.__dataclass_fields__}, "times_s": times_s, "light": light})


def band_depth(seen: Take, white: bool) -> tuple[float, float]:
    """First harmonic's amplitude over the mean, of one class of cells, and its standard error.

    In the frames of a still picture row r of a cell shows P(r)·(1 + Σ a_h·cos hθ + b_h·sin hθ), θ = 2πf·t(r, frame),
    with one a and b for all cells of the class. P and the harmonics are fitted in turns.
    """
    word = load_dictionary("DICT_4X4_50").codeword(seen.marker_id)
    frequency = seen.spec.white_hz if white else seen.spec.black_hz
    rows = np.arange(seen.light.shape[1])
    angle = 2 * np.pi * frequency * (seen.times_s[:, None] + rows * seen.sensor.row_time_us * 1e-6)
    rows_light, waves = [], []
    for i, j in np.argwhere(word == white):
        centre = np.array([[(j + 0.5) / 4 - 0.5, 0.5 - (i + 0.5) / 4, 0.0]]) + 0.36 / 4 * 2 * CORNERS
        inner = project(centre * seen.spec.side_m, seen.pose, seen.sensor.intrinsics)
        mask = np.zeros(seen.light.shape[1:], np.uint8)
        cv2.fillConvexPoly(mask, np.round(inner).astype(np.int32), 1)
        for row in np.flatnonzero(mask.sum(axis=1) >= 4):
            profile = seen.light[:, row, mask[row] > 0].mean(axis=1)
            if np.isfinite(profile).all():
                rows_light.append(profile)
                waves.append([wave(h * angle[:, row]) for h in HARMONICS for wave in (np.cos, np.sin)])
    light, regressors = np.array(rows_light), np.swapaxes(waves, 1, 2)  # (rows, frames), (rows, frames, waves)
    fitted = np.zeros(2 * len(HARMONICS))
    for _ in range(30):
        blinking = 1.0 + regressors @ fitted
        picture = (light * blinking).sum(axis=1) / (blinking**2).sum(axis=1)  # P(r), by least squares
        design = (picture[:, None, None] * regressors).reshape(-1, len(fitted))
        missing = (light - picture[:, None] * blinking).ravel()
        fitted = fitted + np.linalg.lstsq(design, missing, rcond=None)[0]
    error = missing.std() * np.sqrt(np.linalg.inv(design.T @ design)[:2, :2].trace() / 2)
    return float(np.hypot(*fitted[:2])), float(error)


@pytest.mark.parametrize("name", ["static/d0.6", "short_exposure/d0.8"])
def test_bands_are_as_deep_as_the_physics_says_in_both_renderings(name: str, shared: Callable[[str], Path]) -> None:
    """2·sinc(d)·sinc(f·T) over the mean, in our frames; in the others' too, but for steady light on the panel.

    What the panel returns of the room does not blink. It takes the same share, here at most a tenth, from both
    classes. Ours is rendered without it.
    """
    theirs = take(shared(f"recordings/{name}"))
    ours = rendered_as(theirs, seed=1)
    blinking_shares = []
    for white in (False, True):
        frequency = theirs.spec.white_hz if white else theirs.spec.black_hz
        depth = harmonic_amplitude(1, frequency, theirs.sensor.exposure_us, theirs.spec.duty)
        amplitude, error = band_depth(ours, white)
        assert amplitude == pytest.approx(depth, abs=4 * error + 0.003 * depth)
        amplitude, error = band_depth(theirs, white)
        assert error < 0.02 * depth
        blinking_shares.append(amplitude / depth)
    assert all(0.9 < share <= 1.0 for share in blinking_shares)
    assert blinking_shares[0] == pytest.approx(blinking_shares[1], rel=0.025)


@pytest.mark.parametrize("name", ["static/d2", "oblique/d0.6_yaw-70"])
def test_a_pose_means_the_same_pixels_to_both_renderers(name: str, shared: Callable[[str], Path]) -> None:
    """Our projection of their pose gives their corners, and our panel lies on theirs to 0.1 px."""
    theirs = take(shared(f"recordings/{name}"))
    corners = project(CORNERS * theirs.spec.side_m, theirs.pose, theirs.sensor.intrinsics)
    np.testing.assert_allclose(corners, theirs.corners_px, atol=0.02)
    ours = rendered_as(theirs, seed=1)
    inside = np.zeros(ours.light.shape[1:], np.uint8)
    cv2.fillConvexPoly(inside, np.round(corners).astype(np.int32), 1)
    inside = cv2.erode(inside, np.ones((5, 5), np.uint8)) > 0
    one, other = (np.nan_to_num(seen.light, nan=1.0).mean(axis=0) for seen in (theirs, ours))
    down, across = np.gradient(other)
    terms = np.stack([other, np.ones_like(other), across, down], axis=-1)[inside]  # gain, offset, shift
    gain, _, dx, dy = np.linalg.lstsq(terms, one[inside], rcond=None)[0]
    assert np.hypot(dx, dy) / gain < 0.1


@pytest.mark.parametrize("name", ["drive", "two_panels"])
def test_a_corner_in_motion_is_seen_at_its_own_rows_mid_exposure(name: str, shared: Callable[[str], Path]) -> None:
    """From the poses of the frames around it follows each corner of the others' truth, to 0.01 px."""
    folder = shared(f"recordings/{name}")
    header = yaml.safe_load((folder / "recording.yaml").read_text())
    sensor, side_m = sensor_of(header["camera"]), header["panel"]["side_m"]
    frames, truth = (lines_of(folder / name) for name in ("frames.jsonl", "truth.jsonl"))
    errors = []
    for k in range(1, len(frames) - 1):
        t0, _, t2 = (frames[j]["sensor_timestamp_ns"] * 1e-9 for j in (k - 1, k, k + 1))
        markers = [{m["id"]: m for m in truth[j]["markers"]} for j in (k - 1, k, k + 1)]
        for marker_id in set(markers[0]) & set(markers[1]) & set(markers[2]):
            before, now, after = (pose_of(m[marker_id]) for m in markers)
            if t2 - t0 > 0.05:
                continue  # another take
            drift = (after - before) / (t2 - t0)
            centre_row = float(project(np.zeros((1, 3)), now, sensor.intrinsics)[0, 1])
            for corner, seen in zip(CORNERS * side_m, markers[1][marker_id]["corners_px"], strict=True):
                later_s = (seen[1] - centre_row) * sensor.row_time_us * 1e-6
                pixel = project(corner[None, :], now + drift * later_s, sensor.intrinsics)[0]
                errors.append(np.abs(pixel - seen).max())
    assert len(errors) > 100
    assert max(errors) < 0.01
