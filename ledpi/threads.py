"""How soon a thread that wants to run gets the interpreter from one that computes."""

from __future__ import annotations

import sys

# A thread that wants to run waits at most so long for one that computes in Python. The default is 5 ms: so long would
# poses that are ready wait, twice (woken, and before the packet is written), while the picture is searched; and so long
# would frames that are there, for each of the threads that decode, encode and write. Below 20 µs nothing more is won.
SWITCH_INTERVAL_S = 0.00002


def switch_promptly() -> None:
    """For the whole process, as only that can be set."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
