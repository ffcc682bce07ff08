"""`ledpi doctor`'s speed: that it follows what it draws, and what it advises to a machine that is too slow."""

from __future__ import annotations

import pytest

from ledpi.camera.simulated import simulated_sensor
from ledpi.camera.timing import MIN_PHASE_ADVANCE_CYCLES
from ledpi.config.settings import Config, load_config
from ledpi.core.shutter import phase_advance_cycles
from ledpi.workshop.doctor.camera import IN_VIEW, finding_of, measured_ms, speed


def config_of(*settings: str) -> Config:
    return load_config(None, ("panels.side_m=0.16", *settings))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [(), ("camera.exposure_us=150",), ("camera.width=1280", "camera.height=960"), ("panels.dictionary=DICT_5X5_50",)],
    ids=" ".join,
)
def test_what_is_drawn_is_followed(settings: tuple[str, ...]) -> None:
    """Draws the configuration's own panels and pictures; else a rate would be told that is none of theirs."""
    config = config_of(*settings)
    sensor = simulated_sensor(config.camera, config.panels)
    assert all((measured_ms(config, sensor, count) or 0.0) > 0.0 for count in IN_VIEW)


def test_panels_that_there_are_not_are_not_told_of() -> None:
    """With a single ID nobody follows four."""
    said = speed(config_of("panels.ids=[7]")).said
    assert "with 1 panel followed" in said
    assert "4 panels" not in said


def test_a_machine_that_keeps_up_is_well() -> None:
    """A frame comes every 17.2 ms."""
    config = config_of()
    found = finding_of({0: 10.0, 1: 4.0, 4: 8.0}, config, simulated_sensor(config.camera, config.panels))
    assert (found.state, found.remedy) == ("ok", "")
    assert found.said.startswith(
        "frames a second: 100 searching, 250 with 1 panel followed, 125 with 4 panels followed"
    )


@pytest.mark.parametrize("searching_ms", [20.0, 50.0, 400.0])
def test_a_machine_that_searches_too_slowly_is_told_a_longer_period(searching_ms: float) -> None:
    """By a fifth longer than that at least, and one in which the bands of both classes move."""
    config = config_of()
    found = finding_of({0: searching_ms, 1: 4.0}, config, simulated_sensor(config.camera, config.panels))
    assert (found.state, found.stops_daemon) == ("unknown", False)
    period_us = int(found.remedy.partition("camera.frame_duration_us: ")[2].split()[0])
    assert 1200.0 * searching_ms <= period_us <= 2500.0 * searching_ms
    for hz in config.panels.frequencies_hz():
        assert abs(phase_advance_cycles(hz, period_us)) > 0.95 * MIN_PHASE_ADVANCE_CYCLES


def test_where_nothing_can_be_drawn_that_is_said() -> None:
    """A picture too narrow for a lens."""
    found = speed(config_of("camera.width=32", "camera.height=480"))
    assert found.state == "unknown"
    assert "camera" in found.said
