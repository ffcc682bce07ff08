"""The place of the tap's socket, and what lies there already: nothing is taken away but what a dead daemon left."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from ledpi.core.errors import ConfigError
from ledpi.daemon.tap.crowd import Listening
from ledpi.daemon.tap.places import SERVICE, to_look, to_serve
from tests.builders import ROOT
from tests.builders.tap import Raw, tap_at


@pytest.fixture(autouse=True)
def _outside_a_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)


def test_a_service_listens_in_the_folder_that_systemd_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first, where there are several."""
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/ledpi:/run/other")
    assert to_serve("auto") == SERVICE


def test_by_hand_it_is_in_the_users_own_runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one that nobody else may enter; a client looks for the service first, and then there."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    path = to_serve("auto")
    assert path == tmp_path / "ledpi" / "tap.sock"
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert to_look()[:2] == [SERVICE, path]


@pytest.mark.parametrize("given", ["", ".", "/nowhere/at/all"])
def test_without_such_a_folder_it_is_under_tmp(given: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after `su` or `sudo`."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", given)
    assert to_serve("auto") == Path(f"/tmp/ledpi-{os.geteuid()}/tap.sock")


@pytest.mark.parametrize("mischief", ["group", "others", "owner", "link", "file"])
def test_a_folder_that_another_may_have_made_is_not_used(
    tmp_path: Path, mischief: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither by the daemon nor by its clients: another may write in it, or has it; or it is no folder."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = tmp_path / "ledpi"
    if mischief == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(tmp_path / "elsewhere")
    elif mischief == "file":
        folder.write_text("mine", encoding="utf-8")
    else:
        folder.mkdir()
        folder.chmod({"group": 0o720, "others": 0o702, "owner": 0o700}[mischief])
    if mischief == "owner":
        monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(ConfigError, match=r"tap.socket: .*ledpi"):
        to_serve("auto")
    assert folder / "tap.sock" not in to_look()


def test_a_path_that_is_too_long_for_a_socket_is_said() -> None:
    """Linux would say that it is invalid."""
    with pytest.raises(ConfigError, match="a socket's path must have 107 at most"):
        to_serve(f"/{'x' * 107}")
    assert to_serve(f"/{'x' * 106}")


def test_what_a_dead_daemon_left_is_replaced(tmp_path: Path) -> None:
    """A socket at which nobody answers."""
    path = tmp_path / "tap.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    with tap_at(path):
        assert Raw(path).line()["type"] == "hello"
    assert not path.exists()
    Raw.close_all()


def test_a_daemon_that_lives_is_left_alone(tmp_path: Path) -> None:
    """The second is told so; the first goes on."""
    path = tmp_path / "tap.sock"
    with tap_at(path):
        with pytest.raises(ConfigError, match="another daemon listens there; must be another path, or null"):
            Listening(path)
        assert Raw(path).line()["type"] == "hello"
    Raw.close_all()


@pytest.mark.parametrize("what", ["file", "folder", "link"])
def test_what_is_no_socket_is_never_taken_away(tmp_path: Path, what: str) -> None:
    """Somebody's file stays as it is, also behind a link."""
    path, file = tmp_path / "tap.sock", tmp_path / "file"
    file.write_text("mine", encoding="utf-8")
    if what == "file":
        file.rename(path)
        file = path
    elif what == "folder":
        path.mkdir()
    else:
        path.symlink_to(file)
    with pytest.raises(ConfigError, match="is there, and is no socket; must be another path, or null"):
        Listening(path)
    assert os.path.lexists(path)
    assert file.read_text(encoding="utf-8") == "mine"


def test_at_its_end_a_daemon_takes_away_only_its_own_socket(tmp_path: Path) -> None:
    """Another's may stand in its place by then."""
    path = tmp_path / "tap.sock"
    first = Listening(path)
    path.unlink()
    second = Listening(path)
    first.close()
    assert path.exists()
    second.close()
    assert not path.exists()


def test_a_folder_that_is_missing_is_said(tmp_path: Path) -> None:
    """With the key, and what may be there."""
    with pytest.raises(ConfigError, match=r"tap.socket: .*/nowhere/tap.sock: No such file.*; must be a path to make"):
        Listening(tmp_path / "nowhere" / "tap.sock")


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be somebody else")
def test_a_folder_without_permission_is_said(tmp_path: Path) -> None:
    """As any user who is not root meets it."""
    path = tmp_path / "tap.sock"
    script = (
        "import os; from pathlib import Path; from ledpi.daemon.tap.crowd import Listening; os.setuid(65534); "
        f"Listening(Path({str(path)!r}))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "tap.sock: Permission denied; must be a path" in done.stderr


@pytest.mark.parametrize(("group", "mode"), [("its own", 0o660), ("another", 0o600), (None, 0o600)])
def test_the_group_may_use_it_whatever_the_umask(
    tmp_path: Path, group: str | None, mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lets the daemon's group in where that is `ledpi`, as in the service; by hand it is its user's alone."""
    gid = os.getegid() + (group == "another")
    groups = {"ledpi": SimpleNamespace(gr_gid=gid)} if group else {}
    monkeypatch.setattr("grp.getgrnam", groups.__getitem__)
    before = os.umask(0o077)
    try:
        listens = Listening(tmp_path / "tap.sock")
    finally:
        os.umask(before)
    assert stat.S_IMODE(listens.path.stat().st_mode) == mode
    listens.close()
