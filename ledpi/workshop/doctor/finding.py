"""A finding of one check, and the page of all. Nothing is imported that could be missing."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Literal

State = Literal["ok", "bad", "unknown"]
MARKS = {"ok": "✓", "bad": "✗", "unknown": "·"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line of the page."""

    name: str  # what was looked at, as "camera"
    state: State  # unknown: could not be looked at here, or does not apply
    said: str  # what was found
    remedy: str = ""  # where it is bad: what to do
    stops_daemon: bool = False  # whether `ledpi run` ends, or does not start, for it


def ok(name: str, said: str) -> Finding:
    """It is as it should be."""
    return Finding(name=name, state="ok", said=said)


def unknown(name: str, said: str, remedy: str = "") -> Finding:
    """It could not be looked at here, or does not apply."""
    return Finding(name=name, state="unknown", said=said, remedy=remedy)


def bad(name: str, said: str, remedy: str, *, stops_daemon: bool = False) -> Finding:
    """It is not; `remedy` is what to do."""
    return Finding(name=name, state="bad", said=said, remedy=remedy, stops_daemon=stops_daemon)


def show(found: Iterable[Finding], *, as_json: bool) -> int:
    """Prints each finding as soon as it is known. Returns the exit status: 0 if `ledpi run` would run, else 1."""
    findings = []
    for finding in found:
        findings.append(finding)
        if not as_json:
            print(line(finding), flush=True)
    would_run = not any(finding.stops_daemon for finding in findings)
    if as_json:
        print(json.dumps({"would_run": would_run, "findings": [asdict(finding) for finding in findings]}))
    else:
        print(verdict(findings))
    return 0 if would_run else 1


def verdict(findings: list[Finding]) -> str:
    """The page's last line: whether the daemon would run, and what it would not do well."""
    wrong = [finding for finding in findings if finding.state == "bad"]
    stoppers = [finding.name for finding in wrong if finding.stops_daemon]
    others = [finding.name for finding in wrong if not finding.stops_daemon]
    if stoppers:
        return f"`ledpi run` would not run: {', '.join(stoppers)}"
    return "`ledpi run` would run" + (f", but see to its ✗: {', '.join(others)}" if others else "")


def line(finding: Finding) -> str:
    """As in `✗ serial port        /dev/ledpi-controller: …`, and a second line with the remedy."""
    said = f"{MARKS[finding.state]} {finding.name:<18} {finding.said}"
    return f"{said}\n  {'':<18} → {finding.remedy}" if finding.remedy else said
