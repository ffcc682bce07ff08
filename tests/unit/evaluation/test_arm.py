"""`evaluation/speed/arm.py`: what its figures make of a board, that the pages have them, and that marks are counted."""

from __future__ import annotations

import shutil

import pytest

from evaluation.speed import arm, counting
from tests.builders.marked import PROGRAM, check_counted

FIGURES = {
    machine: {exposure: dict(zip(arm.KINDS, (40_000, 100_000, 20_000, 50_000), strict=True)) for exposure in ("10 ms",)}
    for machine in arm.MACHINES
}


def test_a_board_is_between_half_of_coremarks_instructions_a_cycle_and_all() -> None:
    """By hand for a Zero 2 W: 0.98 thousand million instructions a second make 49 frames of 20 million each."""
    zero = next(line for line in arm.boards_table(FIGURES).splitlines() if line.startswith("| Zero 2 W |"))
    following_one, following_four, searching = "24 to 49", "9.8 to 20", "12 to 24"
    cells = ["10 ms", following_one, following_four, searching, "100 to 200 ms"]
    assert zero == f"| Zero 2 W | Cortex-A53, 1 GHz | {' | '.join(cells)} |"


def test_figures_are_kept_of_all_kinds_on_arm() -> None:
    """Keeps millions of instructions a frame; to follow four panels takes more than to follow one."""
    for counts in arm.kept()["aarch64"].values():
        assert set(counts) == set(arm.KINDS)
        assert all(500 < thousands < 1_000_000 for thousands in counts.values())
        assert counts["following one"] < counts["following four"]


def test_the_pages_have_the_kept_figures() -> None:
    """As `--renew` writes them."""
    for page, table in arm.tables(arm.kept()).items():
        assert table in page.read_text(encoding="utf-8"), page.name


def test_a_table_is_written_in_the_place_of_the_one_before() -> None:
    """Leaves what stands around it, also where it gets other lines."""
    page = "before\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n\nafter | a |\n"
    new = "| a | b |\n| --- | --- |\n| 5 | 6 |"
    assert arm.with_table(page, new) == f"before\n\n{new}\n\nafter | a |\n"
    with pytest.raises(SystemExit, match="no table"):
        arm.with_table("before\n", new)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not here (apt install valgrind)")
def test_stretches_between_marks_are_counted() -> None:
    """On x86-64; tests/system/test_packages.py does so on 64-bit ARM."""
    check_counted(counting.on_x86_64(["-c", PROGRAM]))
