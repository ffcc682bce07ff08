"""The other end of the line: bytes in, messages out, everything else counted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from ledpi.wire.codec import DELIMITER, FROM_LEDPI, MAX_FRAME_BYTES, FrameError, FrameFault, decode
from ledpi.wire.message import Message

_NEWER_SENDER: frozenset[FrameFault] = frozenset({"version", "type", "flags"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverCounters:
    """Counts of what came in since the receiver was made."""

    good: int
    lost: int  # numbers missing in the sequence
    restarts: int  # times the sequence began anew
    bad: dict[FrameFault, int]  # damaged on the way, by reason
    skipped: dict[FrameFault, int]  # whole, but of a newer version, type or flag


class Receiver:
    """Turns a byte stream into messages, however it is cut. Raises nothing, keeps at most one frame of bytes.

    What comes before the first delimiter and is no frame is not counted: it began before we listened.
    """

    def __init__(self, kinds: tuple[type[Message], ...] = FROM_LEDPI) -> None:
        """`kinds`: those of one direction; others are skipped."""
        self._kinds = kinds
        self._partial = bytearray()
        self._joined = False
        self._last_sequence: int | None = None
        self._good = self._lost = self._restarts = 0
        self._bad: Counter[FrameFault] = Counter()
        self._skipped: Counter[FrameFault] = Counter()

    @property
    def counters(self) -> ReceiverCounters:
        """Frames since the start: good, lost, bad and skipped by reason, and the sender's restarts."""
        return ReceiverCounters(
            good=self._good,
            lost=self._lost,
            restarts=self._restarts,
            bad=dict(self._bad),
            skipped=dict(self._skipped),
        )

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes, oldest first."""
        messages = []
        *ends, rest = data.split(DELIMITER)
        for end in ends:
            self._keep(end)
            message = self._finish()
            if message is not None:
                messages.append(message)
        self._keep(rest)
        return messages

    def _keep(self, piece: bytes) -> None:
        # One byte more than the longest frame is enough to know that this is none.
        self._partial += piece[: MAX_FRAME_BYTES - len(self._partial)]

    def _finish(self) -> Message | None:
        frame, joined = bytes(self._partial), self._joined
        self._partial.clear()
        self._joined = True
        if not frame:
            return None  # two delimiters in a row separate nothing
        try:
            sequence, message = decode(frame, self._kinds)
        except FrameError as error:
            if error.sequence is not None:
                self._count_lost(error.sequence)
            if error.reason in _NEWER_SENDER:
                self._skipped[error.reason] += 1
            elif joined:
                self._bad[error.reason] += 1
            return None
        self._count_lost(sequence)
        self._good += 1
        return message

    def _count_lost(self, sequence: int) -> None:
        """0 is only ever a sender's first number; after 65535 comes 1. A step back means a new sender."""
        if self._last_sequence is not None:
            missing = (sequence - self._last_sequence - 1) % 0xFFFF
            if sequence == 0 or missing >= 0x8000:
                self._restarts += 1
            else:
                self._lost += missing
        self._last_sequence = sequence
