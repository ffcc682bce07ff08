"""The section `outputs`: which keys each kind takes, and that no secret is in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from ledpi.bridge.factory import TARGETS
from ledpi.config.named_files import read_password
from ledpi.config.origins import values_of
from ledpi.config.outputs import KEYS
from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError
from tests.builders import ROOT

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


def test_an_empty_password_is_a_mistake(tmp_path: Path) -> None:
    """A broker would say less."""
    path = tmp_path / "secret"
    path.write_text("\n", encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="its first line must be the password"):
        read_password(path, ConfigError)
