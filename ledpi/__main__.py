"""The command `ledpi`, also as `python -m ledpi`. It loads nothing at first, so that Ctrl-C finds it ready."""

from __future__ import annotations

import os
import signal


def main() -> None:
    """Entry point. Ctrl-C ends it with status 130, also while it loads what the commands need (0.3 s, more on a Pi).

    Until then by a handler that raises nothing: within an import, an exception may be lost or become another one.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, as of a shell's `ledpi … &`
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # nothing is begun yet that would have to be ended
    from ledpi import cli

    cli.main(loaded=_interrupt_from_now_on)


def _interrupt_from_now_on() -> None:
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


if __name__ == "__main__":
    main()
