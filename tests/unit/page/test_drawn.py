"""Drawings of the live page: overlay, map, bands, focus, table; and its words and colours can be read."""

from __future__ import annotations

import math
import re
from typing import Any

import cv2
import numpy as np
import pytest

from ledpi.camera.simulate.scenes import drive_map
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import quaternion_from_matrix
from ledpi.daemon.tap.frames import not_read_of
from ledpi.page.encode import amplified, as_jpeg, as_png, focus, histogram
from ledpi.page.lines import check_line
from ledpi.page.panels import drawn, drawn_reasons, panels_from_above, robot_from_above
from ledpi.page.server import FILES
from ledpi.pipeline.diagnosis.diagnose import Diagnosis
from ledpi.workshop.monitor import PanelTable
from tests.builders import ROOT
from tests.builders.made_up_daemon import HELLO, PANEL, decoded

DICTIONARY = load_dictionary("DICT_4X4_50")
SURE = 20.0  # nats


def nats(word: np.ndarray) -> np.ndarray:
    return np.where(word, SURE, -SURE)


# ---- Over the picture


def test_cells_have_their_class_at_their_place() -> None:
    """Puts an upright panel's first cell at its top left, where it stays within it."""
    (panel,) = drawn(decoded(1), HELLO)
    classes = np.array([cell["white"] for cell in panel["cells"]]).reshape(4, 4)
    assert (classes == DICTIONARY.codeword(7)).all()
    first = np.array(panel["cells"][0]["corners_px"])
    assert first.min() > 10.0
    assert first.max() < 15.0


def test_axes_are_where_opencv_sees_them() -> None:
    """x to the right, y up, half a side long, 2 m ahead; z at the camera, in the middle."""
    (panel,) = drawn(decoded(1), HELLO)
    half_px = 64.0 * 0.08 / 2.0
    assert np.allclose(panel["axes_px"], [[32, 24], [32 + half_px, 24], [32, 24 - half_px], [32, 24]], atol=0.06)


def test_without_a_lens_there_are_no_axes() -> None:
    """Nor where a panel has no pose; its distance is not known then."""
    (panel,) = drawn(decoded(1), HELLO | {"camera": HELLO["camera"] | {"fx": None}})
    assert panel["axes_px"] is None
    (panel,) = drawn(decoded(1, markers=[PANEL | {"position_m": None, "quaternion_wxyz": None}]), HELLO)
    assert (panel["axes_px"], panel["distance_m"]) == (None, None)


def test_a_dictionary_that_cannot_be_read_here_leaves_the_cells_out() -> None:
    """As the service may not read the daemon's files."""
    (panel,) = drawn(decoded(1), HELLO | {"panels": HELLO["panels"] | {"dictionary": "/nowhere/words.yaml"}})
    assert (panel["id"], panel["cells"]) == (7, [])


def test_a_reason_joins_its_cells() -> None:
    """Joins what was looked at closely with the look at the same place."""
    corners = PANEL["corners_px"]
    swapped = nats(~DICTIONARY.codeword(11)).ravel().tolist()
    picture = {
        "rejected": [{"corners_px": corners, "why": "identify.not_in_dictionary"}],
        "looks": [{"corners_px": corners, "id": None, "why": "identify.not_in_dictionary", "cells_nats": swapped}],
    }
    (found,) = not_read_of(picture)
    assert found.cells_nats is not None
    assert (found.cells_nats == nats(~DICTIONARY.codeword(11))).all()
    (look,) = picture["looks"]
    for looks in ([], [look | {"cells_nats": []}], [look | {"cells_nats": swapped[:-1]}]):  # or that tell of no square
        (found,) = not_read_of(picture | {"looks": looks})
        assert found.cells_nats is None


def test_a_reason_is_drawn_with_its_cells_as_they_seem() -> None:
    """Those that are likelier white are of white's class."""
    word = DICTIONARY.codeword(11)
    corners = np.array(PANEL["corners_px"])
    one = Diagnosis(corners_px=corners, why="a.b", says="it is", helps="do", kind="panel", cells_nats=nats(word))
    (found,) = drawn_reasons([one])
    assert [cell["white"] for cell in found["cells"]] == word.ravel().tolist()
    assert (found["says"], found["helps"], found["kind"], found["why"]) == ("it is", "do", "panel", "a.b")


# ---- From above


def test_the_map_is_seen_from_above() -> None:
    """The drive's panels hang on walls across x, and face against it: lines, 16 cm long."""
    panels = {
        str(marker_id): {
            "position_m": panel.map_from_marker[:3, 3].tolist(),
            "quaternion_wxyz": quaternion_from_matrix(panel.map_from_marker[:3, :3]).tolist(),
        }
        for marker_id, panel in drive_map().items()
    }
    seen = panels_from_above(HELLO | {"map": panels})
    assert [panel["id"] for panel in seen] == [7, 23]
    for panel, true in zip(seen, (drive_map()[7], drive_map()[23]), strict=True):
        corners = np.array(panel["corners_m"])
        assert corners.mean(axis=0) == pytest.approx(true.map_from_marker[:2, 3], abs=0.001)
        assert np.ptp(corners, axis=0)[1] == pytest.approx(0.16, abs=0.01)
        assert panel["facing"][0] < -0.9
    assert panels_from_above(HELLO) == []


def test_the_ellipse_holds_two_deviations_along_its_axes() -> None:
    """3 cm along a direction of 30°, 1 cm across it; the robot looks along y."""
    turn = np.array([[math.cos(math.pi / 6), -0.5], [0.5, math.cos(math.pi / 6)]])
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = turn @ np.diag([0.03**2, 0.01**2]) @ turn.T
    half = math.sqrt(0.5)
    place = {"position_m": [1.0, 2.0, 0.0], "quaternion_wxyz": [half, 0, 0, half], "covariance": covariance.ravel()}
    robot = robot_from_above(place | {"panels_used": [7]})
    assert robot is not None
    assert (robot["position_m"], robot["heading_rad"]) == ([1.0, 2.0], pytest.approx(math.pi / 2, abs=1e-4))
    assert (robot["ellipse"]["long_m"], robot["ellipse"]["short_m"]) == (pytest.approx(0.06), pytest.approx(0.02))
    assert robot["ellipse"]["angle_rad"] % math.pi == pytest.approx(math.pi / 6, abs=1e-3)
    assert robot_from_above(None) is None


# ---- The table


def test_rows_tell_age_and_rate_and_are_forgotten() -> None:
    """Ten detections in a second are 5/s of the last two; 30 s later there is no row."""
    table = PanelTable(30.0)
    for moment in range(10):
        table.see({"exposed_ns": moment * 100_000_000, "markers": [PANEL]})
    (row,) = table.rows(1_000_000_000)
    assert (row["id"], row["age_ms"], row["rate_hz"], row["margin"]) == (7, 100.0, 5.0, 40.0)
    assert table.rows(31_000_000_000) == []


# ---- The picture


def test_jpeg_and_png_hold_the_picture() -> None:
    """PNG exactly; JPEG nearly, and made smaller where it is too wide."""
    picture = np.random.default_rng(1).integers(0, 255, (30, 2000)).astype(np.uint8)
    assert (cv2.imdecode(np.frombuffer(as_png(picture), np.uint8), cv2.IMREAD_UNCHANGED) == picture).all()
    assert cv2.imdecode(np.frombuffer(as_jpeg(picture), np.uint8), cv2.IMREAD_UNCHANGED).shape == (19, 1280)


def test_faint_bands_are_made_visible() -> None:
    """Shows 2 % of the light, 24 rows high, over a slope of brightness; black and white afterwards."""
    rows = np.arange(480)[:, None] * np.ones((1, 640))
    light = (100 + rows / 10) * (1 + 0.02 * np.cos(2 * np.pi * rows / 24))
    noise = np.random.default_rng(1).normal(0, 0.5, light.shape)
    grey = amplified(np.round(light + noise).astype(np.uint8), 24.0)[40:-40].mean(axis=1)
    assert grey[np.cos(2 * np.pi * np.arange(40, 440) / 24) > 0.95].mean() > 200
    assert grey[np.cos(2 * np.pi * np.arange(40, 440) / 24) < -0.95].mean() < 55


def test_an_even_picture_stays_grey() -> None:
    """Finds no bands in what is dark, and blows no noise up to them."""
    assert np.ptp(amplified(np.full((48, 64), 3, np.uint8), 24.0)) == 0
    assert abs(int(amplified(np.full((48, 64), 99, np.uint8), 24.0).mean()) - 127) < 2


def test_the_focus_score_falls_as_the_picture_blurs() -> None:
    """Judged at the panel if there is one; the light's amount does not matter."""
    sharp = np.zeros((100, 100), np.uint8)
    sharp[20:60:8, 20:60] = 200
    quad = np.array([[18.0, 18], [62, 18], [62, 62], [18, 62]])
    scores = [focus(cv2.GaussianBlur(sharp, (0, 0), sigma) if sigma else sharp, [quad]) for sigma in (0, 1, 2, 4)]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > 10 * scores[-1]
    assert focus(sharp // 2, [quad]) == pytest.approx(scores[0], rel=0.1)
    assert focus(np.zeros((10, 10), np.uint8), []) == 0.0
    assert focus(sharp, [quad - 500]) >= 0.0  # that lies outside


def test_the_histogram_counts_every_pixel() -> None:
    """The last range holds the full ones."""
    picture = np.zeros((10, 10), np.uint8)
    picture[0] = 255
    counted = histogram(picture)
    assert (counted[0], counted[-1], sum(counted), len(counted)) == (90, 10, 100, 64)


# ---- Lines of the tap


@pytest.mark.parametrize(
    "change",
    [
        {"markers": None},
        {"markers": [PANEL | {"corners_px": [[0, 0]] * 3}]},
        {"markers": [PANEL | {"corners_px": [[0, float("nan")]] * 4}]},
        {"markers": [PANEL | {"quaternion_wxyz": [0, 0, 0, 0]}]},
        {"markers": [PANEL | {"id": -1}]},
        {"robot": {"position_m": [0, 0, 0]}},
        {"exposed_ns": "now"},
        {"rejected": []},
    ],
)
def test_a_line_that_is_no_taps_is_refused_by_its_key(change: dict[str, Any]) -> None:
    """Before anything is drawn of it; a good one, and one of an unknown type, pass."""
    check_line(decoded(1))
    check_line({"type": "new"})
    with pytest.raises(ValueError, match=r"^\w+: "):
        check_line(decoded(1, **change))


@pytest.mark.parametrize("key", ["looks", "rejected"])
def test_what_was_not_read_has_four_corners_too(key: str) -> None:
    """In a picture's line."""
    four: list[list[float]] = [[0, 0]] * 4
    picture = {"type": "picture", "pixels": {}, "decoded": decoded(1)}
    check_line(picture | {key: [{"corners_px": four, "why": "too_far"}]})
    with pytest.raises(ValueError, match="corners_px: must be four"):
        check_line(picture | {key: [{"corners_px": four[1:], "why": "too_far"}]})


# ---- Colours


def luminance(colour: str) -> float:
    """As WCAG 2 defines it."""
    whole = colour if len(colour) == 7 else "#" + "".join(2 * digit for digit in colour[1:])
    parts = [int(whole[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_stand_out_from_their_ground(scheme: str) -> None:
    """At least 4.5 to 1, as WCAG 2 AA asks; the dark scheme too."""
    css = (ROOT / "ledpi/page/static/view.css").read_text(encoding="utf-8")
    light, dark = re.findall(r":root \{(.*?)\}", css, re.DOTALL)[:2]
    colours = dict(re.findall(r"--([\w-]+): (#\w+)", light))
    if scheme == "dark":
        colours |= dict(re.findall(r"--([\w-]+): (#\w+)", dark))
    for ink in ("ink", "quiet", "good", "warn", "bad", "accent"):
        for ground in ("ground", "card", *(("soft",) if ink in ("ink", "quiet") else ())):
            high, low = sorted((luminance(colours[ink]), luminance(colours[ground])), reverse=True)
            assert (high + 0.05) / (low + 0.05) >= 4.5, (ink, ground)
    high, low = sorted((luminance(colours["accent"]), luminance(colours["on-accent"])), reverse=True)
    assert (high + 0.05) / (low + 0.05) >= 4.5


def test_the_page_needs_nothing_from_elsewhere() -> None:
    """No address of another machine in it, no inline script or style: it works offline, and under its own policy."""
    static = ROOT / "ledpi/page/static"
    assert {f"/{path.name}" for path in static.iterdir()} == {*FILES, "/index.html"} - {"/"}
    for path in static.iterdir():
        text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        assert "//" not in re.sub(r"^\s*//.*$|\s// .*$", "", text, flags=re.MULTILINE), path
    html = (static / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<style|style=|\son\w+=|<script>", html)
