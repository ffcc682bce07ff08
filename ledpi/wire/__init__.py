"""The stream to the motor controller: what is said, how it is put into bytes, and both ends of the line."""

from ledpi.wire.message import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, WirePose
from ledpi.wire.receiver import Receiver, ReceiverCounters

__all__ = [
    "FixMessage",
    "MarkerMessage",
    "Message",
    "NoFix",
    "Receiver",
    "ReceiverCounters",
    "State",
    "StatusMessage",
    "WirePose",
]
