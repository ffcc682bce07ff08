"""Reasons in words, for people: why something was rejected, and why there is no fix."""

from __future__ import annotations

from typing import NamedTuple

from ledpi.config.shipped import reasons


class Explained(NamedTuple):
    """A reason in words."""

    means: str
    helps: str  # "" where nothing is to be done


def explained(key: str) -> Explained:
    """A key like `find.too_small`, as docs/troubleshooting.md has it; of one that is not there, the key itself."""
    stage, _, reason = key.partition(".")
    return Explained(*reasons().get(key, (f"{stage}: {reason.replace('_', ' ')}", "")))


# As the status says it (`NoFix`), and as a frame's own reasons do (`fix.…`).
_WORDS = {
    "not_running": "ledpi is starting or stopping",
    "no_frames": "the camera delivers nothing",
    "uncalibrated": "the lens is not calibrated",
    "no_map": "no map is set",
    "no_panel": "no panel is in view",
    "not_in_map": "no panel of the map is in view",
    "rejected": "panels contradict the map",
    "panels_contradict": "panels contradict the map",
    "ambiguous": "one panel is in view, and its mirror pose is not excluded",
    "stale": "the last one is too old",
    "behind": "decoding is too slow",
}


def why_no_fix(why: str) -> str:
    """Returns words for `why`, which a newer daemon may say, too."""
    return _WORDS.get(why.lower(), why.lower().replace("_", " "))
