"""MAVLink over a network, as pymavlink's own connections receive it."""

from __future__ import annotations

import sys
from typing import Any

import pytest

pytest.importorskip("pymavlink")

from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from ledpi.bridge.factory import open_target
from ledpi.config.outputs import OutputSettings
from ledpi.core.errors import ConfigError
from tests.builders.bridges import free_port
from tests.builders.made_up_daemon import HEALTH, HELLO, PANEL, decoded
from tests.builders.waiting import wait_until

ON_THE_NOSE = {"position_m": [0.1, 0.0, 0.0], "rpy_deg": [0.0, 0.0, 0.0], "newer": 1}  # looks ahead
AT = {"position_m": [1.0, 2.0, 3.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0], "covariance": None, "panels_used": [7]}


def hello(panel_at_m: list[float]) -> dict[str, Any]:
    panel = {"position_m": panel_at_m, "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0], "side_m": 0.16}
    return HELLO | {"camera_mount": ON_THE_NOSE, "map": {"7": panel}}


@pytest.mark.parametrize(("kind", "listens"), [("udp", "udpin"), ("tcp", "tcpin")])
def test_an_autopilot_on_the_network_hears_what_one_on_the_serial_line_does(kind: Any, listens: str) -> None:
    """Heartbeat, fix and panel in its own frames; another map is a reset; the daemon's end is told."""
    port = free_port()
    autopilot = mavutil.mavlink_connection(f"{listens}:127.0.0.1:{port}")
    heard: list[Any] = []

    def of(name: str) -> list[Any]:
        return [message for message in heard if message.get_type() == name]

    def listen() -> None:
        while (message := autopilot.recv_msg()) is not None:
            heard.append(message)

    target = open_target(
        "fc", OutputSettings(kind=kind, host="127.0.0.1", port=port, format="mavlink", mavlink_system=5)
    )
    target.open()
    target.tell_setup(hello([0.0, 0.0, 0.0]))
    target.tell_state("running", HEALTH)
    frame = decoded(3)
    exposed_ns = frame["exposed_ns"] - 20_000_000
    seen = {"markers": [PANEL | {"exposed_ns": exposed_ns}], "robot": AT | {"exposed_ns": exposed_ns}}
    assert target.send(frame | seen, frame["exposed_ns"])
    target.tell_setup(hello([0.5, 0.0, 0.0]))
    assert target.send(frame | seen, frame["exposed_ns"])
    target.tell_state("no_daemon", None)
    wait_until(lambda: len(of("HEARTBEAT")) == 2, meanwhile=listen)
    assert [each.system_status for each in of("HEARTBEAT")] == [common.MAV_STATE_ACTIVE, common.MAV_STATE_POWEROFF]
    fixes, (panel, _) = of("VISION_POSITION_ESTIMATE"), of("LANDING_TARGET")
    assert [(fix.x, fix.y, fix.z, fix.reset_counter) for fix in fixes] == [(2, 1, -3, 0), (2, 1, -3, 1)]
    assert panel.target_num == 7
    assert (panel.x, panel.y, panel.z) == pytest.approx((2.1, 0, 0), abs=1e-6)
    assert panel.time_usec == exposed_ns // 1000
    assert [message.get_seq() for message in heard] == list(range(6))
    assert {message.get_srcSystem() for message in heard} == {5}
    target.close()
    autopilot.close()


def test_without_pymavlink_the_output_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the remedy."""
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(ConfigError, match=r"outputs.fc.format: mavlink needs pymavlink.*pip install"):
        open_target("fc", OutputSettings(kind="udp", host="127.0.0.1", port=14550, format="mavlink"))
