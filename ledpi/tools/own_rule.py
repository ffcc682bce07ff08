"""The udev rule that comes with ledpi, with a board's own values filled in: another one is not taken from an archive.

A rule may start programs as root (RUN+=), and may say what becomes of any device.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from ledpi.config.shipped import udev_rule

_VALUE = r"[A-Za-z0-9_.:/+-]{1,100}"


def foreign_line(content: bytes) -> int | None:
    """Number of the first line that is not one of ledpi's own, counted from 1; None where all are."""
    try:
        lines = content.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return 1
    return next((number for number, line in enumerate(lines, 1) if not _is_own(line)), None)


def _is_own(line: str) -> bool:
    if "\\" in line or not line.replace("\t", " ").isprintable():  # one at its end would join the next line
        return False
    text = line.strip()
    return not text or text[0] == "#" or any(form.fullmatch(text) for form in _forms())


@cache
def _forms() -> tuple[re.Pattern[str], ...]:
    return tuple(map(re.compile, _written(udev_rule())))


def _written(template: str) -> Iterator[str]:
    """A pattern for each rule of the template, active or an example: what is compared may have any value."""
    for line in template.splitlines():
        rule = line.removeprefix("# ")
        if re.match(r'[A-Z]+(\{\w+\})?[!=]?="', rule):
            yield re.sub(r'==""', lambda _: f'=="{_VALUE}"', re.escape(re.sub(r'=="[^"]*"', '==""', rule)))
