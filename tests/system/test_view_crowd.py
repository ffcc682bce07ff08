"""The live page under a crowd, and before another user of the machine."""

from __future__ import annotations

import os
import pwd
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from ledpi.page.connections import MOST
from tests.builders import ROOT
from tests.builders.made_up_daemon import LARGE, MadeUpDaemon
from tests.builders.view import Page, view, watched
from tests.builders.waiting import wait_until

VIEWERS = 50
WATCHED_S = 8.0


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    """The page of a daemon that shows pictures of 640 × 480."""
    daemon = MadeUpDaemon(tmp_path / "tap.sock", hello=LARGE)
    with view(tmp_path) as opened:
        wait_until(lambda: opened.ask("/api/state")["link"]["state"] == "up", "the daemon")
        yield opened
    daemon.close()


@pytest.mark.slow
def test_many_viewers_take_little_memory(page: Page) -> None:
    """Fifty of all kinds of pictures: 45 MB more at most. Each thread with memory of its own took 70, and 120 later."""
    before_mb = page.resident_mb
    got = watched(page, VIEWERS, WATCHED_S)
    assert sum(count > 0 for count in got) >= MOST
    assert page.resident_mb - before_mb < 45.0


ANOTHER_USER = """
import os, socket, sys
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
port, tap = int(sys.argv[1]), sys.argv[2]
paths = ("/api/frame", "/api/frame?kind=bands", "/api/frame.png", "/api/state", "//api/frame", "/api/%66rame")
headers = ("", "Authorization: Bearer \\r\\n", "Authorization: \\r\\n", "Cookie: token=1\\r\\n")
asked = [(f"GET {path} HTTP/1.1", header) for path in paths for header in headers]
asked += [(f"{method} /api/frame HTTP/1.1", "") for method in ("HEAD", "POST", "OPTIONS", "TRACE")]
others = ("/metrics", "/api/takes", "/api/take.tar?name=x", "/x/../api/frame")
asked += [(f"GET {path} HTTP/1.1", "") for path in others]
asked += [(f"GET http://{host}/api/frame HTTP/1.1", "") for host in ("localhost", "127.0.0.1")]
asked += [("GET /api/frame HTTP/1.0", "")]
asked += [("GET /api/frame HTTP/1.1", "Upgrade: websocket\\r\\nConnection: Upgrade\\r\\n")]
for line, header in asked:
    connection = socket.socket()
    connection.settimeout(20)
    connection.connect(("127.0.0.1", port))
    connection.sendall(f"{line}\\r\\nHost: localhost\\r\\n{header}\\r\\n".encode())
    print(connection.recv(12).decode().split()[1])
    connection.close()
try:
    socket.socket(socket.AF_UNIX).connect(tap)
except PermissionError:
    print("refused")
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_user_of_the_machine_gets_no_picture(page: Page, tmp_path: Path) -> None:
    """Neither from the tap nor from the page, whatever is asked without the token."""
    assert pwd.getpwuid(65534).pw_name == "nobody"
    (tmp_path / "tap.sock").chmod(0o600)  # as the daemon leaves it
    asked = subprocess.run(
        [sys.executable, "-c", ANOTHER_USER, str(page.port), str(tmp_path / "tap.sock")],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert asked.returncode == 0, asked.stderr
    *statuses, tap = asked.stdout.split()
    assert set(statuses) <= {"401", "404", "501"}
    assert len(statuses) == 36
    assert tap == "refused"


@pytest.mark.slow
def test_a_crowd_that_asks_for_nothing_keeps_nobody_out(page: Page) -> None:
    """Sixty connections of one address drip: one of another is answered nearly as soon as if they were not there."""
    alone_s, dripping = answered_s(page), []
    for _ in range(60):
        connection = socket.create_connection(("127.0.0.1", page.port), source_address=("127.0.0.3", 0))
        with suppress(OSError):
            connection.sendall(b"G")
        dripping.append(connection)
    assert answered_s(page) < 20 * alone_s  # who waits until one of them has to end, waits a thousand times as long
    for connection in dripping:
        connection.close()


def answered_s(page: Page) -> float:
    """Returns how long an answer takes to whoever connects for it: the median of nine."""
    took_s = []
    for _ in range(9):
        start_s = time.monotonic()
        assert page.ask("/api/state")["link"]["state"] == "up"
        took_s.append(time.monotonic() - start_s)
    return statistics.median(took_s)
