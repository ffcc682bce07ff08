"""A run as it was asked for, and the units of work that this makes."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from evaluation.suites.conditions import (
    METHODS,
    PRINTED,
    WILD_METHODS,
    Condition,
    Method,
    Suite,
    suite_conditions,
)
from evaluation.suites.units import TAKES_A_UNIT, Unit
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import check_method
from ledpi.core.errors import ConfigError, install_command
from ledpi.core.records import Transfer
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE, PANEL_METHODS, Tally
from ledpi.workshop.evaluate.table import TableRow, table_row

COMMAND = ("python", "-m", "evaluation.suites")

_BY_SUITE: dict[Suite, tuple[Method, ...]] = {
    "paper": METHODS,
    "beyond": METHODS,
    "robustness": ("likelihood", "stream"),
    "decoys": PANEL_METHODS,
    "wild": WILD_METHODS,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The same plan gives the same results, however and wherever its units are run."""

    suites: tuple[Suite, ...]
    frames: int  # of each condition: takes that are judged, or, of decoys, frames
    seed: int
    transfers: tuple[Transfer, ...] = ("srgb",)
    exposures_us: tuple[float, ...] = ()  # in place of the suites' own, as the next four
    distances_m: tuple[float, ...] = ()
    angles_deg: tuple[float, ...] = ()
    cases: tuple[str, ...] = ()
    methods: tuple[Method, ...] = ()
    any_roll: bool = False
    apriltag: bool  # whether its detector is installed: an optional extra
    panels: PanelSettings
    frame_duration_us: float | None = None  # None: as the daemon would choose it
    panel_options: tuple[str, ...] = ()  # the command line's, that `panels` came from
    code: str

    def conditions(self) -> list[Condition]:
        """In the tables' order. Raises ConfigError for a case that there is not."""
        every = [
            condition
            for suite in self.suites
            for condition in suite_conditions(
                suite,
                distances_m=self.distances_m,
                angles_deg=self.angles_deg,
                exposures_us=self.exposures_us,
                transfers=self.transfers,
                any_roll=self.any_roll,
            )
        ]
        unknown = set(self.cases) - {condition.case for condition in every}
        if unknown:
            known = ", ".join(dict.fromkeys(condition.case for condition in every))
            raise ConfigError(f"--case {min(unknown)}: {', '.join(self.suites)} has only: {known}")
        return list(dict.fromkeys(c for c in every if not self.cases or c.case in self.cases))

    def check(self) -> None:
        """Raises ConfigError for what would be passed over in silence: wild draws what other suites are given."""
        given = {"--distance": self.distances_m, "--angle": self.angles_deg, "--exposure-us": self.exposures_us}
        named = next((name for name, values in given.items() if values), None)
        if "wild" in self.suites and named is not None:
            raise ConfigError(f"{named}: the suite wild draws its own")

    def methods_of(self, suite: Suite) -> tuple[Method, ...]:
        """Returns what reads the conditions of a suite. Raises ConfigError where a method cannot."""
        own = _BY_SUITE[suite]
        for method in self.methods:
            if method in PRINTED and method not in own:
                where = "the suites paper, beyond and wild"
                raise ConfigError(f"--method {method}: prints are for {where}, not for {suite}")
            if method not in own and (suite == "wild" or method in WILD_METHODS):
                raise ConfigError(f"--method {method}: is not for the suite {suite}, which has {', '.join(own)}")
            if method == "apriltag" and not self.apriltag:
                raise ConfigError(f"--method apriltag: is not installed: {install_command('suites')}")
            if method == "uemura":
                check_method(method, self.panels, "--method")
        unable = {"apriltag": not self.apriltag, "uemura": self.panels.has_antiphase()}
        return tuple(m for m in self.methods or own if not unable.get(m, False))

    def units(self) -> list[Unit]:
        """All the work."""
        units = []
        for condition in self.conditions():
            decoys = condition.suite == "decoys"
            takes = -(-self.frames // FRAMES_A_TAKE) if decoys else self.frames
            for first in range(0, takes, TAKES_A_UNIT):
                units.append(
                    Unit(
                        seed=self.seed,
                        condition=condition,
                        first_take=first,
                        takes=min(TAKES_A_UNIT, takes - first),
                        methods=self.methods_of(condition.suite),
                        panels=condition.panels_of(self.panels),
                        frame_duration_us=self.frame_duration_us,
                        code=self.code,
                    )
                )
        return units

    def rows(self, finished: dict[str, dict[str, Any]]) -> list[TableRow]:
        """The tables' rows, from the records of all units, by key."""
        tallies: dict[tuple[Condition, str], list[Tally]] = {}
        for unit in self.units():
            record = finished[unit.key]
            for method in unit.methods:
                for row in unit.rows_of(method):
                    tally = Tally.from_json(record["rows"][row])
                    tallies.setdefault((unit.condition, row), []).append(tally)
        return [
            table_row(Tally.sum_of(parts), **asdict(condition), method=row)
            for (condition, row), parts in tallies.items()
        ]

    def as_json(self) -> dict[str, Any]:
        """Returns what must be the same for results to be added to."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return values | {"panels": self.panels.model_dump(mode="json")}

    def commands(self, row: TableRow) -> list[str]:
        """The command line that gives the table again which a row is in."""
        words = [*COMMAND, "--out", "DIR", "--suite", row.suite, "--frames", str(self.frames)]
        words += ["--seed", str(self.seed)]
        if row.suite != "wild":  # which draws all of these
            words += ["--transfer", row.transfer, "--exposure-us", f"{row.exposure_us:g}"]
            words += _options("--distance", self.distances_m) + _options("--angle", self.angles_deg)
        words += _options("--case", self.cases) + _options("--method", self.methods)
        return [shlex.join([*words, *(["--roll"] if self.any_roll else []), *self.panel_options])]


def _options(name: str, values: Sequence[float | str]) -> list[str]:
    return [word for value in values for word in (name, f"{value:g}" if isinstance(value, float) else str(value))]
