"""`ledpi monitor`'s table: what it says below the panels of what is not read."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from ledpi.pipeline.diagnosis.diagnose import Diagnosis, Kind, Note
from ledpi.pipeline.diagnosis.why_not import Why
from ledpi.workshop.monitor import MOST_REASONS, Live
from tests.builders.made_up_daemon import HEALTH, HELLO

CORNERS = np.array([[100.0, 50], [140, 50], [140, 90], [100, 90]])
TOLD = {"frames": 9, "decoded_per_s": 30.0} | {"rejected": {"fit.misfit": 5}}


def shown(live: Live) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(live.shown(0.0))
    return str(console.file.getvalue())  # type: ignore[attr-defined]


def live(**health: Any) -> Live:
    table = Live()
    for line in (HELLO, HEALTH | TOLD | health, HEALTH | TOLD | {"rejected": {"fit.misfit": 7}}):
        table.take(line)
    return table


def diagnosis(kind: Kind, says: str = "it is upside down") -> Diagnosis:
    return Diagnosis(corners_px=CORNERS, why="fit.misfit", says=says, helps="turn it", kind=kind)


def test_what_is_wrong_is_said_with_its_place_and_what_helps() -> None:
    """Speaks of a panel, of what may be one, and of the whole picture. A shape that is no light is left out."""
    table = live()
    table.explain(Why([diagnosis("panel"), diagnosis("light"), diagnosis("shape")], [Note(says="dark", helps="light")]))
    said = [line.strip() for line in shown(table).splitlines()]
    assert "panel at 120, 70 is not read: it is upside down; turn it" in said
    assert "light at 120, 70, if it is a panel: it is upside down; turn it" in said
    assert "dark; light" in said
    assert sum("upside down" in line for line in said) == 2


def test_without_pictures_the_counts_of_reasons_are_told() -> None:
    """As where the daemon's dictionary cannot be read from here; with pictures they would only repeat it."""
    table = live()
    assert "not read, 2×: the model of a panel explains too little of the light" in shown(table)
    table.explain(Why([], []))
    assert "not read" not in shown(table)


@pytest.mark.slow
def test_what_is_wrong_with_the_daemon_is_said() -> None:
    """As `ledpi doctor` says it: of the last seconds."""
    table = live()
    recent = {"seconds": 5, "sent": 0, "replaced": 40, "stale": 0, "refused": 0}
    table.take(HEALTH | TOLD | {"wire": HEALTH["wire"] | {"recent": recent}})
    assert "serial port: is open, but takes nothing" in shown(table)
    table.take(HEALTH | TOLD)
    assert "takes nothing" not in shown(table)


def test_where_the_robot_is_is_said_with_what_that_rests_on() -> None:
    """Between panels, too; and that nothing is known, where that is so. Doubts are named."""
    table, known = live(), {"type": "robot_state", "t_ns": 3_000_000_000, "mode": "odometry", "panel_ns": 2_915_000_000}
    known |= {"position_m": [1.25, -0.5], "yaw_rad": 0.5236, "covariance": np.diag([4e-6, 9e-6, 1.2185e-4]).ravel()}
    table.take(known | {"contested": False, "moved": [12]})
    said = "state: x +1.250 y -0.500 m ± 3 mm, heading +30.0 ± 0.6°, by odometry, a panel 85 ms ago, panel 12 has moved"
    assert said in shown(table)
    assert said in table.line(0.0)
    table.take(known | {"mode": "none", "position_m": None})
    assert "no state: " in shown(table)


def test_no_more_is_said_than_fits() -> None:
    """Names some of twenty lamps."""
    table = live()
    table.explain(Why([diagnosis("light")] * 20, []))
    assert shown(table).count("upside down") == MOST_REASONS


def test_of_a_daemon_that_is_gone_nothing_is_said() -> None:
    """Keeps silent on what it saw last, which may be gone, too; nor of the next one, before it has shown a picture."""
    table = live()
    table.explain(Why([diagnosis("panel")], []))
    table.take({"type": "lost"})
    assert "upside down" not in shown(table)
    table.take(HELLO)
    assert "upside down" not in shown(table)
