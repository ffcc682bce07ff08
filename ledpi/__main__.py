"""The command `ledpi`, also as `python -m ledpi`. It loads nothing at first, so that Ctrl-C finds it ready."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ledpi.core.packages import Unusable


def main() -> None:
    """Entry point. Ctrl-C ends it with status 130, also while it loads what the commands need (0.3 s, more on a Pi).

    Until then by a handler that raises nothing: within an import, an exception may be lost or become another one.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, as of a shell's `ledpi … &`
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # nothing is begun yet that would have to be ended
    try:
        from ledpi import cli

        cli.main(loaded=_interrupt_from_now_on)
    except (ImportError, AttributeError) as error:
        from ledpi.core.packages import unusable

        package = unusable(error)
        if package is None:
            raise
        sys.exit(_end_without(package))


def _end_without(package: Unusable) -> int:
    """Says in one line what is wrong with it; `ledpi doctor`, on its page. Returns the exit status."""
    if sys.argv[1:2] == ["doctor"]:
        from ledpi.workshop.doctor.finding import show
        from ledpi.workshop.doctor.machine import without

        return show(without(package), as_json="--json" in sys.argv)
    from ledpi.core.errors import one_line

    print(f"ledpi: {one_line(f'{package.said}; {package.remedy}')}", file=sys.stderr)
    return 2


def _interrupt_from_now_on() -> None:
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


if __name__ == "__main__":
    main()
