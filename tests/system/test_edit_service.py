"""The units of the helper that changes config.yaml for the live page, as systemd reads them, and the helper itself."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from ledpi.core.errors import ConfigError
from ledpi.workshop.editing import SOCKET, ask, socket_of
from tests.builders.command import LEDPI, complaint, in_process
from tests.builders.systemd import Unit, assert_closed_in, needs_systemd, said_of
from tests.system.test_several_cameras import for_several

SERVICE, LISTENER = Unit("ledpi-edit.service"), Unit("ledpi-edit.socket")
ACTIVATE = shutil.which("systemd-socket-activate")


@needs_systemd
def test_the_units_are_clean_and_closed_in(tmp_path: Path) -> None:
    """systemd has nothing to say about them, and leaves the helper little that it could do."""
    unit = SERVICE.copy_to(tmp_path)
    shutil.copy(LISTENER.path, tmp_path)
    assert (said_of(unit), said_of(tmp_path / LISTENER.path.name)) == ("", "")
    assert_closed_in(unit)


def test_only_the_page_s_service_may_ask_and_two_folders_are_written() -> None:
    """By a group that it alone has; the socket is where the page looks for it."""
    assert LISTENER.values("SocketGroup") == Unit("ledpi-view.service").values("SupplementaryGroups") == ["ledpi-edit"]
    assert LISTENER.values("SocketMode") == ["0660"]
    assert [str(SOCKET)] == LISTENER.values("ListenStream") == [str(socket_of(Path("/etc/ledpi/config.yaml")))]
    assert str(socket_of(Path("/etc/ledpi/front.yaml"))) == f"{SOCKET}-front"
    assert SERVICE.values("ReadWritePaths") == ["/etc/ledpi -/var/lib/ledpi"]
    assert SERVICE.values("TemporaryFileSystem") == ["/etc:ro /run:ro"]  # ProtectSystem=strict leaves /run writable
    assert f"ListenStream={SOCKET}-%i\n" in for_several(LISTENER.text)
    assert "--config /etc/ledpi/%i.yaml\n" in for_several(SERVICE.text)


@pytest.fixture
def helper(tmp_path: Path) -> Iterator[Path]:
    """The socket of one that systemd's own tool starts at the first connection."""
    assert ACTIVATE is not None
    path = tmp_path / "edit"
    command = [ACTIVATE, "-l", str(path), *LEDPI, "config", "serve", "--config", str(tmp_path / "config.yaml")]
    with subprocess.Popen(command, env=os.environ, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while "Listening on" not in process.stderr.readline():  # the socket is there a moment before it listens
            assert process.poll() is None
        yield path
        process.kill()


@pytest.mark.slow
@pytest.mark.skipif(ACTIVATE is None, reason="systemd-socket-activate is not installed")
def test_the_helper_changes_the_file_and_nothing_where_it_may_not(helper: Path, tmp_path: Path) -> None:
    """Keeps the mode, says what is wrong in the file's words, and does nothing without `view.edit`."""
    file = tmp_path / "config.yaml"
    file.write_text("# mine\npanels: {side_m: 0.16}\nview: {edit: true}\n", encoding="utf-8")
    file.chmod(0o640)
    assert ask(helper, {"do": "set", "key": "panels.side_m", "value": "0.2"}).startswith("panels.side_m: saved")
    assert file.read_text(encoding="utf-8") == "# mine\npanels: {side_m: 0.2}\nview: {edit: true}\n"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    with pytest.raises(ConfigError, match=r"config\.yaml: panels\.side_m: must be in metres, 10 at most"):
        ask(helper, {"do": "set", "key": "panels.side_m", "value": "200"})
    for wrong in ({"do": "set"}, {"do": "restore", "archive": "?"}, {}):
        with pytest.raises(ConfigError, match="must be set with key and value"):
            ask(helper, wrong)
    ask(helper, {"do": "undo", "to": "config.yaml.bak-1"})
    file.write_text("panels: {side_m: 0.16}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"view\.edit: must be true"):
        ask(helper, {"do": "undo", "to": "config.yaml.bak-2"})


def test_started_by_hand_it_says_who_starts_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line."""
    said = complaint(in_process(monkeypatch, capsys, "config", "serve")())
    assert said == "ledpi: is started by systemd alone: sudo systemctl enable --now ledpi-edit.socket"
