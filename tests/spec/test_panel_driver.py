"""The driver's program in an emulated ATmega328P: what its pins really do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ledpi.workshop.panel.circuit import CHIP_MOST_A, CHIP_OWN_A, PORTS, PORTS_MOST_A, plan_pins
from ledpi.workshop.panel.firmware import Build
from tests.builders.panel import (
    ANTIPHASE,
    CELL_PINS,
    CHIP_PINS,
    IDS,
    MAX_JITTER,
    PAIRS,
    classes,
    defined,
    duty,
    jitter,
    program,
    shown_word,
)
from tests.builders.simavr import CLOCK_HZ, emulate, needs_simavr

pytestmark = needs_simavr

SECONDS = 0.25


@pytest.fixture(scope="module")
def seven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sixteen-cell build for ID 7."""
    return program(tmp_path_factory.mktemp("seven") / "sources", Build.SIXTEEN_CELLS)


@pytest.mark.parametrize("pair", PAIRS)
def test_two_outputs_are_exact_to_the_cycle(tmp_path: Path, pair: tuple[float, float]) -> None:
    """Every half period has the announced number of cycles, no edge jitters; within 100 ppm of the asked.

    So the duty is one half, period by period, and the phase runs on through all wraps of the timer.
    """
    built = program(tmp_path / "sources", Build.TWO_OUTPUTS, pair=pair)
    trace = emulate(built, SECONDS, work=tmp_path)
    for pin, name, asked_hz in (("PB1", "BLACK", pair[0]), ("PB2", "WHITE", pair[1])):
        edges, half = trace.edges[pin], defined(built, name)
        assert np.diff(edges).min() == np.diff(edges).max() == half
        assert edges[0] < 100e-6 * CLOCK_HZ  # from reset
        assert trace.end - edges[-1] < 1.1 * half  # till the end
        assert CLOCK_HZ / (2 * half) == pytest.approx(asked_hz, rel=100e-6)
        assert duty(edges) == 0.5


@pytest.mark.parametrize("hz", [1253.33, 1656.0, 20000.0])
def test_two_outputs_in_antiphase_are_each_others_opposite(tmp_path: Path, hz: float) -> None:
    """Every edge of one is one of the other, the other way: to the cycle, once both have begun."""
    built = program(tmp_path / "sources", Build.TWO_OUTPUTS, pair=(hz, hz))
    trace = emulate(built, SECONDS, work=tmp_path)
    black, white = trace.edges["PB1"], trace.edges["PB2"]
    assert np.diff(black).min() == np.diff(black).max() == defined(built, "BLACK")
    np.testing.assert_array_equal(black[1:], white)
    assert trace.is_high("PB1", int(white[0])) != trace.is_high("PB2", int(white[0]))


def test_sixteen_cells_in_antiphase_are_half_a_cycle_apart(tmp_path: Path) -> None:
    """Each class with its own interrupt: to 4 µs, on every pin, and each at the one frequency."""
    built = program(tmp_path / "sources", Build.SIXTEEN_CELLS, pair=ANTIPHASE)
    half = defined(built, "BLACK")
    assert half == defined(built, "WHITE")
    trace = emulate(built, SECONDS, work=tmp_path)
    first = {name: trace.edges[pin] for pin, name in zip(CELL_PINS, classes(7), strict=True)}
    for pin, name in zip(CELL_PINS, classes(7), strict=True):
        assert jitter(trace.edges[pin], half) <= MAX_JITTER
        assert abs(int(trace.edges[pin][0] - first["black"][0]) - half * (name == "white")) <= MAX_JITTER


@pytest.mark.slow
@pytest.mark.parametrize("pair", [ANTIPHASE, PAIRS[0]])
def test_sixteen_pins_give_no_more_than_the_chip_may(tmp_path: Path, pair: tuple[float, float]) -> None:
    """One LED on each, as `ledpi panel sheet --direct` has them: no level is short of half a period, from reset on; no
    other pin moves; at no moment do pins that are on together give more than their ports and the chip may.
    """
    built = program(tmp_path / "sources", Build.SIXTEEN_CELLS, pair=pair)
    trace, circuit = emulate(built, SECONDS, work=tmp_path), plan_pins(3.2, 0.0075)
    assert {pin for pin, edges in trace.edges.items() if len(edges)} - {"PD0", "PD1"} == set(CELL_PINS)
    for pin, name in zip(CELL_PINS, classes(7), strict=True):
        levels = np.diff(trace.edges[pin], prepend=0)
        assert levels.min() >= defined(built, name.upper()) - MAX_JITTER
    moments = np.concatenate([trace.edges[pin] for pin in CELL_PINS])
    on = {pin: np.searchsorted(trace.edges[pin], moments, side="right") % 2 for pin in CELL_PINS}
    for board_pins in PORTS.values():
        together = sum(on[CHIP_PINS[pin]] for pin in board_pins if CHIP_PINS[pin] in on)
        assert np.max(together) * circuit.most_a <= PORTS_MOST_A
    most = int(np.max(sum(on.values())))
    assert pair == ANTIPHASE or most == 16  # the worst does happen
    assert most * circuit.most_a + CHIP_OWN_A <= CHIP_MOST_A


def test_two_outputs_move_no_other_pin(tmp_path: Path) -> None:
    """D9 and D10 alone."""
    trace = emulate(program(tmp_path / "sources", Build.TWO_OUTPUTS), 0.01, work=tmp_path)
    assert {pin for pin, edges in trace.edges.items() if len(edges)} == {"PB1", "PB2"}


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS)
def test_sixteen_cells_keep_their_frequencies(tmp_path: Path, pair: tuple[float, float]) -> None:
    """Frequency within 100 ppm, duty 50 ± 0.2 %, edges within 4 µs, on every pin, also where both classes collide."""
    built = program(tmp_path / "sources", Build.SIXTEEN_CELLS, pair=pair)
    halves = {"black": defined(built, "BLACK"), "white": defined(built, "WHITE")}
    trace = emulate(built, SECONDS, work=tmp_path)
    for pin, name in zip(CELL_PINS, classes(7), strict=True):
        edges = trace.edges[pin]
        assert 0 < jitter(edges, halves[name]) <= MAX_JITTER
        periods = (len(edges) - 1) // 2
        made_hz = periods * CLOCK_HZ / (edges[2 * periods] - edges[0])
        assert made_hz == pytest.approx(pair[name == "white"], rel=100e-6 + MAX_JITTER / (SECONDS * CLOCK_HZ))
        assert duty(edges) == pytest.approx(0.5, abs=0.002)
        assert trace.end - edges[-1] < 1.1 * halves[name]


def test_the_cells_of_a_class_switch_together(tmp_path: Path) -> None:
    """Port after port, within half a microsecond."""
    trace = emulate(program(tmp_path / "sources", Build.SIXTEEN_CELLS), 0.05, work=tmp_path)
    for name in ("black", "white"):
        pins = [pin for pin, its in zip(CELL_PINS, classes(7), strict=True) if its == name]
        together = np.stack([trace.edges[pin] for pin in pins])
        assert np.ptp(together, axis=0).max() <= 0.5e-6 * CLOCK_HZ


def test_the_word_of_each_id(tmp_path: Path) -> None:
    """Ten IDs one after the other over the serial line: each is answered, and its word is what the cells show."""
    built = program(tmp_path / "sources", Build.SIXTEEN_CELLS)
    asked = [(0.05 + 0.05 * n, f"id {marker_id}\n".encode()) for n, marker_id in enumerate(IDS)]
    trace = emulate(built, 0.05 + 0.05 * len(IDS), work=tmp_path, arrivals=asked)
    assert trace.said.decode().splitlines() == [f"ok id {marker_id}" for marker_id in IDS]
    halves = defined(built, "BLACK"), defined(built, "WHITE")
    for (at_s, _), marker_id in zip(asked, IDS, strict=True):
        begin = int((at_s + 0.02) * CLOCK_HZ)  # 8 characters take 8 ms
        assert shown_word(trace, *halves, begin, begin + int(0.03 * CLOCK_HZ)) == classes(marker_id), marker_id


def test_a_new_id_disturbs_nobody_else(tmp_path: Path) -> None:
    """Cells that stay in their class go on as if nothing had happened; one that changes has one odd interval.

    That is shorter than a period, and from then on the cell is in step with its new class.
    """
    built = program(tmp_path / "sources", Build.SIXTEEN_CELLS, marker_id=7)
    halves = {"black": defined(built, "BLACK"), "white": defined(built, "WHITE")}
    trace = emulate(built, 0.15, work=tmp_path, arrivals=[(0.05, b"id 23\n")])
    seen = set()
    for pin, before, after in zip(CELL_PINS, classes(7), classes(23), strict=True):
        edges, lengths = trace.edges[pin], np.diff(trace.edges[pin])
        if before == after:
            assert jitter(edges, halves[before]) <= MAX_JITTER
            continue
        seen.add((before, after))
        changed = int(np.flatnonzero(np.abs(lengths - halves[before]) > MAX_JITTER)[0])
        assert lengths[changed] < 2 * max(halves.values())
        assert jitter(edges[: changed + 1], halves[before]) <= MAX_JITTER
        in_new_class = edges[changed + 2 :]
        assert jitter(in_new_class, halves[after]) <= MAX_JITTER
        partner = next(p for p, b, a in zip(CELL_PINS, classes(7), classes(23), strict=True) if b == a == after)
        assert trace.is_high(pin, trace.end - 200) == trace.is_high(partner, trace.end - 200)
    assert seen == {("black", "white"), ("white", "black")}


@pytest.mark.slow
def test_a_new_id_may_come_at_any_moment(tmp_path: Path, seven: Path) -> None:
    """Forty changes to and fro, anywhere in the classes' periods: the others' edges hold, no level lasts a period."""
    moments_s = 0.05 + 0.04 * np.arange(40) + np.random.default_rng(5).uniform(0, 0.004, 40)
    told = [(at_s, b"id 23\n" if n % 2 == 0 else b"id 7\n") for n, at_s in enumerate(moments_s.tolist())]
    trace = emulate(seven, told[-1][0] + 0.05, work=tmp_path, arrivals=told)
    assert trace.said.count(b"ok id") == 40
    halves = {"black": defined(seven, "BLACK"), "white": defined(seven, "WHITE")}
    for pin, one, other in zip(CELL_PINS, classes(7), classes(23), strict=True):
        if one == other:
            assert jitter(trace.edges[pin], halves[one]) <= MAX_JITTER
        else:
            assert np.diff(trace.edges[pin]).max() < 2 * halves["black"]


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"id\n", "ok id 7"),
        (b"id 049\r\n", "ok id 49"),
        (b"\n\n\nid\n", "ok id 7"),
        (b"id 50\n", "error: ids are 0 to 49"),
        (b"id 65543\n", "error: ids are 0 to 49"),  # 7, if 16 bits ran over
        (b"id -1\n", "error: ids are 0 to 49"),
        (b"id 9x\n", "error: ids are 0 to 49"),
        (b"id \n", "error: ids are 0 to 49"),
        (b"ID 9\n", "error: say id or id N"),
        (b"id 9" + 20 * b" " + b"\n", "error: ids are 0 to 49"),
        (b"\xff\x00id 9\n", "error: say id or id N"),
    ],
)
def test_every_line_has_one_answer(tmp_path: Path, seven: Path, line: bytes, answer: str) -> None:
    """A good one shows its ID; of a bad one it is told what is wrong, and nothing changes."""
    seconds = 0.02 + 0.0011 * len(line)
    trace = emulate(seven, seconds + 0.06, work=tmp_path, arrivals=[(0.01, line), (seconds + 0.03, b"id\n")])
    first, then = trace.said.decode().splitlines()
    assert first == answer
    assert then == (answer if answer.startswith("ok") else "ok id 7")


def said_at_start(hex_file: Path, work: Path) -> str:
    """Returns what it answers to `id`."""
    return emulate(hex_file, 0.08, work=work, arrivals=[(0.01, b"id\n")]).said.decode().strip()


def test_an_id_outlives_a_power_cut(tmp_path: Path, seven: Path) -> None:
    """It is kept in the EEPROM, and shown from the first edge on after the next start."""
    emulate(seven, 0.06, work=tmp_path, arrivals=[(0.01, b"id 23\n")])
    again = emulate(seven, 0.05, work=tmp_path)
    halves = defined(seven, "BLACK"), defined(seven, "WHITE")
    assert shown_word(again, *halves, 0, again.end) == classes(23)
    assert said_at_start(seven, tmp_path) == "ok id 23"


def test_a_program_for_another_id_shows_that_one(tmp_path: Path, seven: Path) -> None:
    """Ignores what an older program kept in the EEPROM."""
    emulate(seven, 0.06, work=tmp_path, arrivals=[(0.01, b"id 23\n")])
    assert said_at_start(program(tmp_path / "nine", Build.SIXTEEN_CELLS, marker_id=9), tmp_path) == "ok id 9"


@pytest.mark.parametrize("byte", range(6))
def test_a_broken_record_shows_nothing(tmp_path: Path, seven: Path, byte: int) -> None:
    """Dark rather than wrong, until it is told an ID."""
    emulate(seven, 0.06, work=tmp_path, arrivals=[(0.01, b"id 23\n")])
    kept = bytearray((tmp_path / "eeprom.bin").read_bytes())
    kept[byte] ^= 0x10
    (tmp_path / "eeprom.bin").write_bytes(kept)
    trace = emulate(seven, 0.12, work=tmp_path, arrivals=[(0.01, b"id\n"), (0.07, b"id 31\n")])
    assert trace.said.decode().splitlines() == ["error: no id kept; say id N", "ok id 31"]
    assert min(trace.edges[pin][0] for pin in CELL_PINS) > 0.07 * CLOCK_HZ
    halves = defined(seven, "BLACK"), defined(seven, "WHITE")
    assert shown_word(trace, *halves, int(0.09 * CLOCK_HZ), trace.end) == classes(31)
