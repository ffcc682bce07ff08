"""A board before the running daemon's camera: the page is told what is missing, and gets the lens in the end."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import board_scene, ov5647_lens
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.core.records import Pixels
from ledpi.page import board as board_module
from ledpi.page.board import BoardWatch, board_of
from ledpi.page.pictures import Pictures
from ledpi.workshop.calibrate.boards import Board, Kind
from tests.builders import ROOT
from tests.builders.made_up_daemon import HELLO, decoded
from tests.builders.waiting import limit_s


class Shown(Pictures):
    """Pictures of a board that is held at rest at 20 places: the two of each that are asked for first."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(lambda extras: True)
        self._renderer = Renderer(scene, seed=1)
        self._seqs = iter([place * 29 + at for place in range(20) for at in (8, 9)])  # 29 frames, half a second, each

    def wait(self, kind: Any, after: int, timeout_s: float) -> Any:
        """As of `Pictures`."""
        seq = next(self._seqs, None)
        if seq is None:
            return None
        into: Pixels = np.empty((480, 640), np.uint8)
        self._renderer.render(seq, into)
        self.came({"type": "picture", "width": 640, "height": 480, "pixels": into, "decoded": decoded(seq)}, HELLO)
        return self.newest()


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardWatch]:
    """Shows one of 6 × 5 inner corners, 1 m before the lens of the Pi's camera."""
    monkeypatch.setattr(board_module, "PAUSE_S", 0.0)
    board = Board(kind="charuco", columns=6, rows=5)
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=9966.32, row_time_us=33.67, frame_length_rows=504)
    scene = board_scene(sensor, board.black(), 0.2)
    begun = BoardWatch(board, Shown(scene))
    yield begun
    begun.stop()


@pytest.mark.slow
def test_a_board_gives_the_lens(watch: BoardWatch, tmp_path: Path) -> None:
    """Finds the focal length within 1 %; on the way it was told how to hold the board."""
    said = set()
    end_s = time.monotonic() + limit_s(60)
    while (told := watch.told())["runs"]:
        assert time.monotonic() < end_s, told
        said.add(told["says"])
        time.sleep(0.05)
    assert any(words.startswith("tilt the board") for words in said)
    assert told["says"].startswith("that is enough")
    assert told["views"] >= told["enough"]
    assert np.min(told["coverage"]) > 0
    assert told["rms_px"] < 0.5
    text = watch.camera_yaml()
    assert text is not None
    (tmp_path / "camera.yaml").write_text(text, encoding="utf-8")
    assert load_intrinsics(tmp_path / "camera.yaml").fx == pytest.approx(ov5647_lens().fx, rel=0.01)
    assert yaml.safe_load(text)["ledpi"]["views"] == told["views"]


def test_before_any_view_there_is_no_lens(watch: BoardWatch) -> None:
    """And nothing is covered."""
    watch.stop()
    told = watch.told()
    assert (watch.camera_yaml(), told["rms_px"]) == (None, None)
    assert np.shape(told["coverage"]) == (3, 4)


def test_the_page_offers_each_kind_of_board() -> None:
    """By the name that the server takes."""
    choice = (ROOT / "ledpi/page/static/index.html").read_text(encoding="utf-8").partition('id="board-kind">')[2]
    assert sorted(re.findall(r'value="(\w+)"', choice.partition("</select>")[0])) == sorted(Kind)


@pytest.mark.parametrize(
    ("kind", "cols", "rows"), [("", 6, 5), ("hexagons", 6, 5), ("charuco", 2, 5), ("charuco", 6, 21)]
)
def test_what_is_no_board_is_told(kind: str, cols: int, rows: int) -> None:
    """With what would be right."""
    with pytest.raises(ValueError, match="must be"):
        board_of(kind, cols, rows)
