"""A serial port: opened for nobody else, written to without waiting for the other end, read by a thread."""

from __future__ import annotations

import errno
import fcntl
import glob
import json
import logging
import os
import re
import select
import stat
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

import serial

from ledpi.core.errors import WireError
from ledpi.core.linux import described, openers, who_holds
from ledpi.wire.numbers import BITS_PER_BYTE

# The transmit FIFO of the Pi's PL011 (16 bytes on BCM2835 to BCM2837), which TIOCOUTQ does not see. The next
# frame may follow while the FIFO is emptied, so that the line never idles; its bytes count in the age.
FIFO_BYTES = 16
READ_BYTES = 4096  # at once: as many as a terminal keeps
JAMMED_RETRY_NS = 20_000_000
QUEUED_RETRY_NS = 1_000_000
OTHERS_EVERY_S = 5.0  # who else has the port open is looked for: some milliseconds of work

_REMEDIES = {
    errno.EACCES: "permission denied (is this user in the group dialout?)",
    errno.EPERM: "not permitted (a service may open only the devices of its unit's DeviceAllow=)",
    errno.EAGAIN: "in use by another process",
    errno.EBUSY: "in use by another process",
    errno.ENOTTY: "not a serial port",
}
_IN_USE = _REMEDIES[errno.EBUSY]
_log = logging.getLogger("ledpi")
_CONTROL = 2  # of termios' list: the place of c_cflag


class _OwnPort(serial.Serial):
    """Nobody else may open it meanwhile (root may), and closing it resets no controller."""

    def open(self) -> None:
        """As pyserial's, then TIOCEXCL, and without HUPCL: an Arduino is reset where DTR rises, so it stays up."""
        super().open()
        with suppress(OSError, termios.error):  # a driver that cannot
            fcntl.ioctl(self.fileno(), termios.TIOCEXCL)
            settings = termios.tcgetattr(self.fileno())
            settings[_CONTROL] &= ~termios.HUPCL
            termios.tcsetattr(self.fileno(), termios.TCSANOW, settings)

    def close(self) -> None:
        """As pyserial's. Where another process has it open too, TIOCEXCL would stay."""
        if self.is_open:
            with suppress(OSError, termios.error):
                fcntl.ioctl(self.fileno(), termios.TIOCNXCL)
        super().close()


def open_port(port: str, baud: int, *, read_timeout_s: float = 0.0) -> serial.Serial:
    """An open serial port that is ours alone, 8N1 without flow control. Raises WireError with the reason."""
    try:
        if _is_terminal(port):
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        return _OwnPort(port, baud, timeout=read_timeout_s, exclusive=True)
    except (OSError, ValueError, termios.error) as error:
        why = reason(error)
    if why == _IN_USE:
        why = f"{why}, {who_holds(glob.escape(port)) or _unseen(port)}"
    raise WireError(f"{port}: cannot be opened: {why}")


def _is_terminal(port: str) -> bool:
    """Tells whether it is one of Linux's own terminals, which take what nobody reads: /dev/ptmx, a console, /dev/tty.

    Raises OSError where it is not there. Numbers: the kernel's Documentation/admin-guide/devices.txt.
    """
    found = os.stat(port)
    major, minor = os.major(found.st_rdev), os.minor(found.st_rdev)
    return stat.S_ISCHR(found.st_mode) and (major == 5 or (major == 4 and minor < 64))


def _unseen(port: str) -> str:
    """Says how to find a holder that is another user's."""
    said = f"which `sudo fuser -v {port}` names"
    is_pty = os.path.realpath(port).startswith("/dev/pts/")  # its TIOCEXCL stays after a process that was killed
    return f"{said}; if it names none, close the other end of this pty" if is_pty else said


def reason(error: Exception) -> str:
    """Returns what the system says. pyserial often keeps the error number in its text only."""
    in_text = re.search(r"\[Errno (\d+)\]|\((\d+), ", str(error))
    if in_text is None:
        return str(error)
    code = int(in_text[1] or in_text[2])
    return _REMEDIES.get(code, os.strerror(code).lower())


class SerialLine:
    """One open port. Every method that touches it raises WireError when the port is lost."""

    def __init__(
        self, port: str, baud: int, *, ahead: bytes = b"", clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """`ahead`: written before each frame, so that bytes of others, or half a frame of ours, are none of it."""
        self._port = port
        self._ahead = ahead
        self._clock = clock  # ns
        self._serial = open_port(port, baud)
        self._byte_ns = BITS_PER_BYTE * 1_000_000_000 / baud
        self._free_ns = 0  # when, at the baud rate, the last byte that was written has left
        self._known_free = False  # since the last write the kernel has said that nothing queues and there is room
        self._ahead_ns = round(len(ahead) * self._byte_ns)

    def busy_ns(self, now_ns: int) -> int:
        """0 where a frame may be written now; else how long to wait before asking again.

        The kernel is asked only until it has said yes: what is asked again when a pose is there makes that wait.
        """
        if not self._known_free:
            queued = self._queued_bytes()
            if queued:
                return max(round(queued * self._byte_ns), QUEUED_RETRY_NS)
            if not self._has_room():
                return JAMMED_RETRY_NS
        free_in_ns = max(0, self._free_ns - now_ns - round(FIFO_BYTES * self._byte_ns))
        self._known_free = free_in_ns == 0
        return free_in_ns

    def first_byte_ns(self, now_ns: int) -> int:
        """When the first byte of a frame written now leaves: after all that was written before, and what is ahead."""
        return max(now_ns, self._free_ns) + self._ahead_ns

    def is_drained(self, now_ns: int) -> bool:
        """Tells whether every byte that was written has left."""
        return self._queued_bytes() == 0 and self._free_ns <= now_ns

    def write(self, frame: bytes, latest_ns: int | None = None) -> bool | None:
        """Writes a whole frame; False where the port took only a part of it. Never waits.

        None where nothing was written: it is later than `latest_ns`, there is no room after all, or another process
        is writing this very moment. Not by pyserial's `write`: that would wait, or spin.
        """
        data = self._ahead + frame
        if latest_ns is not None:
            latest_ns -= self._ahead_ns
        try:
            port = self._serial.fileno()
            # In one line, so that next to nothing comes between the look at the clock and the write.
            written = os.write(port, data) if latest_ns is None or self._clock() <= latest_ns else None
        except BlockingIOError:
            written = None
        except OSError as error:
            raise self._lost(error) from None
        self._known_free = False
        if written is None:
            return None
        self._free_ns = max(self._clock(), self._free_ns) + round(len(data) * self._byte_ns)
        return written == len(data)

    def read(self, timeout_s: float) -> bytes:
        """Bytes that have come, once some have; none after the time."""
        try:
            port = self._serial.fileno()
            if not select.select([port], [], [], timeout_s)[0]:
                return b""
            data = os.read(port, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(error) from None
        if not data:
            raise WireError(f"{self._port}: lost: the other end hung up")
        return data

    def close(self) -> None:
        """Closes the port at once. What still queues is thrown away: the kernel would wait 30 s for it."""
        with suppress(OSError, WireError, termios.error):
            if self._queued_bytes():
                self._serial.reset_output_buffer()
        with suppress(OSError):
            self._serial.close()

    def _queued_bytes(self) -> int:
        """Bytes in the kernel's queue (TIOCOUTQ). A pty always says 0: there, only the baud rate paces us."""
        try:
            return int(self._serial.out_waiting)
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):  # a driver that does not know the question
                return 0
            raise self._lost(error) from None

    def _has_room(self) -> bool:
        try:
            _, writable, _ = select.select([], [self._serial.fileno()], [], 0)
        except OSError as error:
            raise self._lost(error) from None
        return bool(writable)

    def _lost(self, error: OSError) -> WireError:
        return WireError(f"{self._port}: lost: {reason(error)}")


class Others:
    """Processes that have a port open beside this one, each named once. Not thread-safe."""

    def __init__(self) -> None:
        self._known: set[int] = set()
        self._look_s = 0.0  # when they are looked for next

    def name(self, port: str) -> None:
        """Tells the journal who has come, as often as it is asked."""
        now_s = time.monotonic()
        if now_s < self._look_s:
            return
        self._look_s = now_s + OTHERS_EVERY_S
        found = openers([port])
        for pid in sorted(found - self._known):
            _log.warning("serial_shared port=%s with=%s", port, json.dumps(described(pid)))
        self._known = found


LOOK_S = 0.1  # after which the thread looks whether it is to end


class Ear(Protocol):
    """Whoever hears what comes in. Called from the publisher's threads; must not wait."""

    def opened(self) -> None:
        """The port is open, anew: what was heard of a message is none."""

    def asked(self, number: int, first_byte_ns: int) -> None:
        """A question for the controller's clock has left."""

    def heard(self, data: bytes, now_ns: int) -> None:
        """Bytes have just come."""


@contextmanager
def listening(line: SerialLine, hear: Callable[[bytes, int], None] | None) -> Iterator[None]:
    """Reads, in a thread of its own, as long as the context lasts; or until the port is lost, which writing shows.

    `hear` takes what has come, and when; None: nothing is read. What it raises is a mistake of ours: told once, with
    where it was, and the next is heard.
    """
    if hear is None:
        yield
        return
    ends = threading.Event()

    def listen() -> None:
        has_failed = False
        with suppress(WireError):
            while not ends.is_set():
                data = line.read(LOOK_S)
                try:
                    if data:
                        hear(data, time.monotonic_ns())
                except Exception as error:
                    if not has_failed:
                        _log.warning("ear_failed error=%s", json.dumps(repr(error)), exc_info=error)
                    has_failed = True

    thread = threading.Thread(target=listen, name="ear", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ends.set()
        thread.join()
