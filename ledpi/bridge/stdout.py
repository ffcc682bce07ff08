"""`kind: stdout`: for a pipe into another program."""

from __future__ import annotations

import fcntl
import os
import select
import stat
import sys

from ledpi.bridge.payload import BytesTarget
from ledpi.bridge.target import UNSENT_BYTES
from ledpi.config.outputs import OutputSettings
from ledpi.core.errors import TransientError


class StdoutTarget(BytesTarget):
    """Standard output. Where it is a pipe that nobody empties, frames are dropped."""

    def __init__(self, settings: OutputSettings) -> None:
        super().__init__(settings)
        self._output = sys.stdout.fileno()

    def open(self) -> None:
        if stat.S_ISFIFO(os.fstat(self._output).st_mode):
            fcntl.fcntl(self._output, fcntl.F_SETPIPE_SZ, UNSENT_BYTES)

    def tick(self) -> None:
        """Raises TransientError where the reader is gone, though nothing is written."""
        poll = select.poll()
        poll.register(self._output, 0)
        if any(found & select.POLLERR for _, found in poll.poll(0)):
            raise TransientError("standard output: its reader is gone")

    def close(self) -> None:
        """Nothing: it is not ours."""

    def _write(self, data: bytes) -> bool:
        """Waits for nobody to begin; what was begun is ended, however long the reader takes."""
        if not select.select((), (self._output,), (), 0)[1]:
            return False
        try:
            while data:
                data = data[os.write(self._output, data) :]
        except BrokenPipeError:
            raise TransientError("standard output: its reader is gone") from None
        return True
