"""The stream to the motor controller: what is said, how it is put into bytes, and both ends of the line."""

from ledpi.wire.codec import Receiver, ReceiverCounters
from ledpi.wire.message import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, WirePose
from ledpi.wire.state_message import Mode, OdometryMessage, StateMessage, TimeAnswer, TimeAsk

__all__ = [
    "FixMessage",
    "MarkerMessage",
    "Message",
    "Mode",
    "NoFix",
    "OdometryMessage",
    "Receiver",
    "ReceiverCounters",
    "State",
    "StateMessage",
    "StatusMessage",
    "TimeAnswer",
    "TimeAsk",
    "WirePose",
]
