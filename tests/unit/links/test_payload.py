"""A frame as bytes for targets that take bytes, also as MAVLink's; and the settings of outputs."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any, Literal

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from ledpi.config.named_files import read_password
from ledpi.config.origins import values_of
from ledpi.config.outputs import KEYS, OutputSettings
from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError
from ledpi.links.bridge import TARGETS, open_target
from ledpi.links.payload import Payload, payload_of
from ledpi.wire import FixMessage, MarkerMessage, Receiver, StatusMessage
from ledpi.wire.message import State
from tests.builders import ROOT
from tests.builders.bridges import free_port
from tests.builders.made_up_daemon import HEALTH, HELLO, PANEL, decoded
from tests.builders.waiting import wait_until

COVARIANCE = [4e-6 if row == column else 0.0 for row in range(6) for column in range(6)]
PLACE = {"position_m": [1.0, 2.0, 0.5], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}


def payload(form: Literal["json", "wire"]) -> Payload:
    return payload_of(OutputSettings(kind="stdout", format=form))


def test_a_line_tells_its_age_and_its_unix_time() -> None:
    """30 ms after the exposure."""
    frame = decoded(3)
    line = json.loads(*payload("json").frame(frame, frame["exposed_ns"] + 30_000_000))
    assert (line["seq"], line["age_us"]) == (3, 30_000)
    assert abs(time.time_ns() - line["unix_ns"] - 30_000_000) < 2_000_000_000


def test_where_the_robot_is_between_frames_is_a_line_with_its_age() -> None:
    """20 ms after it held. Packets have no place for it."""
    state = {"type": "robot_state", "t_ns": 5_000_000_000, "position_m": [1.0, 2.0]}
    line = json.loads(*payload("json").robot(state, 5_020_000_000))
    assert (line["type"], line["position_m"], line["age_us"]) == ("robot_state", [1.0, 2.0], 20_000)
    assert payload("wire").robot(state, 5_020_000_000) == []


def test_packets_hold_the_fix_first_then_markers_each_with_its_own_age() -> None:
    """And the mirror pose, where it is not excluded."""
    frame = decoded(3)
    at_ns = frame["exposed_ns"]
    marker = PANEL | {"exposed_ns": at_ns - 2_000_000, "covariance": COVARIANCE, "alternate": PLACE}
    robot = PLACE | {"exposed_ns": at_ns - 1_000_000, "covariance": COVARIANCE, "panels_used": [7]}
    packets = payload("wire")
    messages = Receiver().feed(*packets.frame(frame | {"markers": [marker], "robot": robot}, at_ns + 10_000_000))
    fix, first, other = messages
    assert isinstance(fix, FixMessage)
    assert (fix.age_us, fix.panels_used, fix.pose.position_m) == (11_000, 1, (1.0, 2.0, 0.5))
    assert isinstance(first, MarkerMessage)
    assert (first.id, first.age_us, first.ambiguous, first.alternate) == (7, 12_000, True, False)
    assert isinstance(other, MarkerMessage)
    assert other.alternate


def test_a_pose_that_fits_no_packet_is_left_out_and_the_others_are_sent() -> None:
    """As on the serial line."""
    frame = decoded(3)
    at_ns = frame["exposed_ns"]
    far = PLACE | {"position_m": [2000.0, 0.0, 0.0], "exposed_ns": at_ns, "panels_used": []}
    markers = [PANEL | far | {"id": 9}, *frame["markers"]]
    (message,) = Receiver().feed(*payload("wire").frame(frame | {"robot": far, "markers": markers}, at_ns))
    assert isinstance(message, MarkerMessage)
    assert message.id == 7


def test_the_daemons_state_is_a_status_packet() -> None:
    """One that has ended says stopping."""
    packets = payload("wire")
    (running,) = Receiver().feed(packets.state("running", HEALTH | {"temperature_c": 50}))
    (gone,) = Receiver().feed(packets.state("no_daemon", None))
    assert isinstance(running, StatusMessage)
    assert isinstance(gone, StatusMessage)
    assert (running.state, gone.state) == (State.RUNNING, State.STOPPING)


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


MISTAKES = [
    ("{a: {kind: fax}}", "outputs.a.kind: must be 'stdout', 'udp'"),
    ("{a: {kind: udp}}", "outputs.a: must have a host: the address that udp sends to"),
    ("{a: {kind: udp, host: x}}", "outputs.a: must have a port; udp has none of its own"),
    ("{a: {kind: udp, host: x, port: 5, tls: true}}", "outputs.a: has tls, which is not for udp; udp takes host, port"),
    ('{a: {kind: tcp, port: 5, host: "a\\nb"}}', "outputs.a.host: must be a name or an address alone, as robot.lan"),
    ("{a: {kind: mqtt, host: x, ca_file: c.pem}}", "outputs.a: has ca_file, which needs tls: true"),
    ("{a: {kind: mqtt, host: x, user: me}}", "outputs.a: must have user and password_file together"),
    ("{a: {kind: mqtt, host: x, topic: 'a/#'}}", "outputs.a.topic: must be words of letters, digits, _ and -"),
    ("{a: {kind: zenoh, host: x, topic: robot-1}}", "outputs.a: has topic robot-1; ROS 2's words have letters"),
    ("{a: {kind: stdout, mavlink_profile: px4}}", "outputs.a: has mavlink_profile, which needs format: mavlink"),
    ("{A B: {kind: stdout}}", "outputs.A B: must be a name of small letters"),
    ("{a: {kind: mqtt, host: x, password: secret}}", "outputs.a.password: unknown key; did you mean password_file?"),
]


@pytest.mark.parametrize(("outputs", "expected"), MISTAKES)
def test_a_mistake_is_one_line(outputs: str, expected: str) -> None:
    """It names the output, the key, and what would be right."""
    with pytest.raises(ConfigError) as caught:
        load_config(None, ("panels.side_m=0.16", f"outputs={outputs}"))
    assert expected in str(caught.value)
    assert "secret" not in str(caught.value).split("not ")[0]


def test_every_kind_has_its_keys_and_its_target() -> None:
    """The tables agree with each other and with the page."""
    assert TARGETS.keys() == KEYS.keys()
    page = (ROOT / "docs/outputs.md").read_text(encoding="utf-8")
    assert [kind for kind in KEYS if f"kind: {kind}" not in page] == []
    assert [key for keys in KEYS.values() for key in keys if f"`{key}`" not in page] == []


def test_files_are_relative_to_the_configuration(tmp_path: Path) -> None:
    """As all paths in it."""
    text = "panels: {side_m: 0.16}\noutputs: {b: {kind: mqtt, host: x, user: u, password_file: secret}}\n"
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")
    config = load_config(tmp_path / "config.yaml")
    assert config.outputs["b"].password_file == tmp_path / "secret"
    assert config.outputs["b"].address == ("x", 1883)


def test_the_password_is_the_first_line_of_a_file_that_not_everybody_may_read(tmp_path: Path) -> None:
    """Shows its path only, where the configuration is shown."""
    path = tmp_path / "secret"
    path.write_text("hunter2\nmore\n", encoding="utf-8")
    path.chmod(0o640)
    assert read_password(path, ConfigError) == "hunter2"
    outputs = f"outputs={{b: {{kind: mqtt, host: x, user: u, password_file: {path}}}}}"
    assert "hunter2" not in str(values_of(load_config(None, ("panels.side_m=0.16", outputs))))
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="everybody may read it; chmod o-r"):
        read_password(path, ConfigError)
    path.chmod(0o600)
    path.write_text("\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="its first line must be the password"):
        read_password(path, ConfigError)
