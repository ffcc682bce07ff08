"""A frame in PhotonLib's packet: the bytes that photonlibpy 2026.3.4 itself packs of the same target."""

from __future__ import annotations

import struct

import pytest

from ledpi.bridge.photon import MESSAGE, packet
from tests.builders.made_up_daemon import PANEL, decoded

# One target, ID 7, 2 m ahead and facing the camera, or turned by 106°; times 1000 and 31000 µs.
PACKED = bytes.fromhex(
    "0300000000000000e803000000000000187900000000000000000000000000000100000000000000000000000000000000abaaaaaaaa0a"
    "2a40000000000000000007000000ffffffff000080bf000000000000004000000000000000000000000000000000000000000000000000"
    "000000000000000000000000000000000000000000f03f000000000000004000000000000000000000000000000000333333333333e33f"
    "000000000000000000000000000000009a9999999999e93f000000000000d03f0400000000000024400000000000003e40000000000000"
    "3e400000000000003e400000000000003e4000000000000024400000000000002440000000000000244004000000000000244000000000"
    "00003e400000000000003e400000000000003e400000000000003e4000000000000024400000000000002440000000000000244000"
)
HEAD = struct.Struct("<4qB4d2if7d7dd")  # up to the corners
MIRRORED = {"position_m": [0.0, 0.0, 2.0], "quaternion_wxyz": [0.0, 0.8, 0.0, -0.6], "reprojection_px": 0.4}


def test_a_packet_is_photonlibs() -> None:
    """Number by number (a zero may be negative), and the corners to the byte."""
    frame = decoded(3) | {"markers": [PANEL | {"reprojection_px": 0.1, "alternate": MIRRORED}]}
    made = packet(frame, (64, 48), captured_us=1000, published_us=31000)
    assert HEAD.unpack_from(made) == HEAD.unpack_from(PACKED)
    assert made[HEAD.size :] == PACKED[HEAD.size :]


def test_a_panel_without_a_pose_is_no_target() -> None:
    """PhotonLib knows no other."""
    frame = decoded(3) | {"markers": [PANEL | {"position_m": None, "quaternion_wxyz": None}]}
    made = packet(frame, (64, 48), captured_us=1000, published_us=31000)
    assert made[32:] == bytes([0, 0])


def test_the_topic_says_which_message_it_holds(capfd: pytest.CaptureFixture[str]) -> None:
    """PhotonLib asks for it every 5 s; ntcore has nothing to warn of."""
    ntcore = pytest.importorskip("ntcore")
    from ledpi.bridge.nt import _publish_photon

    instance = ntcore.NetworkTableInstance.create()
    topic = instance.getRawTopic("/photonvision/ledpi/rawBytes")
    publisher = _publish_photon(topic, ntcore.PubSubOptions())
    assert topic.getProperty("message_uuid") == MESSAGE
    publisher.close()
    ntcore.NetworkTableInstance.destroy(instance)
    assert capfd.readouterr().err == ""
