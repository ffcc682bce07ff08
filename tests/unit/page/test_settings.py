"""`ledpi view` as a command, and its keys: where it listens, who may look, and what it says when it cannot."""

from __future__ import annotations

import http.client
import json
import re
import signal
import socket
from contextlib import closing
from pathlib import Path

import pytest

import ledpi.cli.view as command
from ledpi.cli.view import kept_token
from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError
from ledpi.page import guard
from ledpi.page.guard import Guard
from ledpi.page.hub import Hub
from ledpi.page.settings import Settings
from tests.builders.command import complaint, in_process
from tests.builders.view import view
from tests.builders.waiting import limit_s

GIVEN = "panels.side_m=0.16"


@pytest.mark.parametrize(
    ("listen", "address"),
    [
        ("127.0.0.1:8088", ("127.0.0.1", 8088)),
        ("localhost:0", ("127.0.0.1", 0)),
        ("0.0.0.0:80", ("0.0.0.0", 80)),
        ("'[::1]:65535'", ("::1", 65535)),
        ("'[::]:8088'", ("::", 8088)),
    ],
)
def test_addresses(listen: str, address: tuple[str, int]) -> None:
    """Takes both kinds of numbers, with a port."""
    assert load_config(None, (GIVEN, f"view.listen={listen}")).view.address == address


ADDRESSES = "8088 127.0.0.1 127.0.0.1: 127.0.0.1:65536 127.0.0.1:-1 robot:8088 ::1:8088 '[127.0.0.1]:1' null"
NAMES = "robot.lan:8443 http://robot.lan '*' -robot robot..lan '' 7"
TOKENS = ("short", "'with a blank in it'", "'ünicode-tokens-no'", "123456789012345")
WRONG = [
    *((f"listen={each}", r"listen: must be an IP address and a port, as 127\.0\.0\.1") for each in ADDRESSES.split()),
    *((f"hosts=[{each}]", r"hosts\.0: must be a name alone, as robot\.lan") for each in NAMES.split()),
    *((f"token={each}", "token: (must be|is too short)") for each in TOKENS),  # to be guessed, or not to be sent
]


@pytest.mark.parametrize(("given", "said"), WRONG)
def test_what_cannot_be_is_told(given: str, said: str) -> None:
    """With what would be right."""
    with pytest.raises(ConfigError, match=rf"view\.{said}"):
        load_config(None, (GIVEN, f"view.{given}"))


def test_a_proxy_may_ask_by_its_own_name() -> None:
    """`view.hosts` are names that the page is asked for by, besides this machine's own; any other is refused."""
    settings = load_config(None, (GIVEN, "view.listen=127.0.0.1:0", "view.hosts=[Robot.lan]")).view
    server, token = command.open_server(settings, hub := Hub("/nowhere"), Settings(hub, None, ()))
    server.server_close()
    right = {"authorization": f"Bearer {token}"}
    assert server.guard.refuse("/api/state", {"host": "robot.lan", **right}) is None
    assert server.guard.refuse("/api/state", {"host": "ROBOT.LAN:8443", **right}) is None
    refused = server.guard.refuse("/api/state", {"host": "evil.example", **right})
    assert refused is not None
    assert refused.status == 421


def test_a_service_keeps_its_token(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In systemd's state folder; a file that holds none is replaced, and without the folder each start makes one."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    token = kept_token()
    assert (kept_token(), (tmp_path / "token").read_text()) == (token, token)
    (tmp_path / "token").write_text("")
    assert kept_token() == kept_token() != token
    monkeypatch.delenv("STATE_DIRECTORY")
    assert kept_token() != kept_token()


def test_the_page_asks_for_nothing_from_the_root() -> None:
    """Below any path of a proxy's, as https://robot.lan/ledpi/: all that it asks for is relative to itself."""
    for file in (Path(guard.__file__).parent / "static").iterdir():
        text = file.read_text(encoding="utf-8")
        assert not re.findall(r"""(?:href|src)=["']/|["'`]/(?:api|[a-z]+\.(?:js|css))|from "/""", text), file.name


def test_tokens_are_compared_in_constant_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """By hmac.compare_digest, all of them: how long it takes tells nothing of how much was right."""
    compared: list[tuple[bytes, bytes]] = []
    monkeypatch.setattr(guard.hmac, "compare_digest", lambda a, b: compared.append((a, b)) or False)
    judge = Guard(token="right-right-right", names=frozenset())
    for given in ("right-right-right", "wrong", "ü" * 3):
        refused = judge.refuse("/api/state", {"host": "127.0.0.1", "authorization": f"Bearer {given}"})
        assert refused is not None
        assert refused.status == 401
    assert [given for given, _ in compared] == [b"right-right-right", b"wrong", "üüü".encode()]


def test_where_it_cannot_listen_or_see_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A port that is taken, an address of another machine, and a daemon without a tap, for which it would wait."""
    monkeypatch.chdir(tmp_path)
    run = in_process(monkeypatch, capsys, "view")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        said = complaint(run("--set", f"view.listen=127.0.0.1:{port}"))
    assert said == f"ledpi: view.listen: 127.0.0.1:{port}: is in use; choose another port, or end what uses it"
    said = complaint(run("--set", "view.listen=192.0.2.1:8088"))
    assert said.startswith("ledpi: view.listen: 192.0.2.1:8088: ")
    assert "tap.socket" in complaint(run("--set", "tap.socket=null"))


@pytest.mark.slow
@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
def test_a_token_is_made_and_printed(tmp_path: Path, address: str) -> None:
    """Long, another one at each start, and needed for every answer, on the machine's own address, too."""
    with view(tmp_path, f"view.listen={address}:0") as page, view(tmp_path, f"view.listen={address}:0") as other:
        assert len(page.token) >= 24
        assert page.token != other.token
        assert page.ask("/api/state")["link"]["state"] == "down"
        for token in ("", other.token):
            with closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=limit_s())) as connection:
                connection.request("GET", "/api/state", headers={"Authorization": f"Bearer {token}"} if token else {})
                answer = connection.getresponse()
                assert answer.status == 401
                assert "token" in json.loads(answer.read())["error"]


@pytest.mark.slow
def test_a_token_of_the_configuration_is_used(tmp_path: Path) -> None:
    """In place of one that is made."""
    with view(tmp_path, "view.token=chosen-by-me-1") as page:
        assert page.token == "chosen-by-me-1"
        assert page.ask("/api/state")["daemon"] is None
        with closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=limit_s())) as connection:
            connection.request("GET", "/api/state")
            assert connection.getresponse().status == 401


@pytest.mark.parametrize("mode", [0o644, 0o640])
def test_a_token_that_every_user_can_read_is_warned_of(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
    mode: int,
) -> None:
    """With the remedy: it would keep nobody of this machine out."""
    (tmp_path / "config.yaml").write_text(
        "panels: {side_m: 0.16}\nview: {token: chosen-by-me-1, listen: '192.0.2.1:80'}"
    )
    (tmp_path / "config.yaml").chmod(mode)
    monkeypatch.chdir(tmp_path)
    in_process(monkeypatch, capsys, "view")()
    told = "view.token: every user of this machine can read it in config.yaml; remedy: chgrp ledpi config.yaml"
    assert (told in caplog.text) == (mode == 0o644)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_well(tmp_path: Path, number: signal.Signals) -> None:
    """By a service manager or Ctrl-C, while somebody waits for a picture: status 0."""
    with (
        view(tmp_path) as page,
        closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=limit_s())) as connection,
    ):
        connection.request("GET", "/api/frame")
        page.process.send_signal(number)
        assert page.process.wait(limit_s()) == 0
