"""The live page's server over real HTTP: what it gives, what it refuses, and what a hostile or slow client gets."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from ledpi import __version__
from ledpi.camera.recording.picture import text_of
from ledpi.daemon.tap.frames import camera_of, settings_of
from ledpi.page import connections, pictures
from ledpi.page.guard import HEADERS, MAX_BODY_BYTES, Guard, metrics_token
from ledpi.page.hub import Hub
from ledpi.page.server import Handler, ViewServer
from ledpi.page.settings import Settings
from tests.builders.made_up_daemon import HEALTH, PANEL, PIECE_BYTES, TAKE, TAKE_BYTES, MadeUpDaemon
from tests.builders.waiting import limit_s, wait_until

TOKEN = "a-token-of-this-test"
RIGHT = {"Authorization": f"Bearer {TOKEN}"}


COVARIANCE = [0.0001, 0.0, 0.0, 0.0, 0.0009, 0.0, 0.0, 0.0, 0.01]  # of x, y and yaw
HERE = {"position_m": [1.0, 2.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}


class Site:
    """A server in this process, and a client."""

    def __init__(self, path: Path, file: Path | None = None) -> None:
        self.hub = Hub(str(path))
        guard = Guard(token=TOKEN, names=frozenset({"localhost", "robot.local"}))
        self.server = ViewServer(("127.0.0.1", 0), guard, self.hub, Settings(self.hub, file, ()))
        self.port = self.server.server_port
        self._thread = threading.Thread(target=self.server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()
        self.hub.start()

    def ask(self, method: str, path: str, headers: dict[str, str] = RIGHT, body: bytes | None = None) -> Answer:
        """With the token, unless the headers are others."""
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=limit_s())) as connection:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())

    def frame(self, kind: str = "plain", after: int = -1) -> dict[str, Any]:
        """Returns what is told with the next picture."""
        answer = self.ask("GET", f"/api/frame?kind={kind}&after={after}")
        assert answer.status == 200
        return told(answer.body)

    def state_once(self, link: str) -> dict[str, Any]:
        """The state, as soon as the daemon is so."""

        def state() -> dict[str, Any] | None:
            told: dict[str, Any] = self.ask("GET", "/api/state").json()
            return told if told["link"]["state"] == link else None

        return wait_until(state, f"a daemon that is {link}") or {}

    def raw(self) -> socket.socket:
        """A connection of one's own."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=limit_s())

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        self.hub.close()


class Answer:
    def __init__(self, status: int, headers: dict[str, str], body: bytes) -> None:
        self.status, self.headers, self.body = status, headers, body

    def json(self) -> Any:
        return json.loads(self.body)


def told(body: bytes) -> dict[str, Any]:
    (size,) = struct.unpack(">I", body[:4])
    assert body[4 + size : 6 + size] == b"\xff\xd8", "what follows is no JPEG"
    return dict(json.loads(body[4 : 4 + size]))


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[MadeUpDaemon]:
    with closing(MadeUpDaemon(tmp_path / "tap.sock")) as made:
        yield made


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with closing(Site(tmp_path / "tap.sock")) as made:
        yield made


# ---- What it gives


def test_a_picture_comes_with_what_is_drawn_over_it(site: Site, daemon: MadeUpDaemon) -> None:
    """In one answer: corners as the tap told them, cells of the word, and the times for its age."""
    site.state_once("up")
    shown = site.frame()
    (panel,) = shown["panels"]
    assert (panel["id"], panel["corners_px"], len(panel["cells"])) == (7, PANEL["corners_px"], 16)
    assert shown["exposed_ns"] <= shown["sent_ns"] <= time.monotonic_ns()
    assert sum(shown["histogram"]) == 64 * 48


def test_why_not_is_in_words(site: Site, daemon: MadeUpDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Evidence is asked of the daemon only for that view; each candidate has its place, its reason and what helps."""
    beside = [[40.0, 30.0], [55.0, 30.0], [55.0, 45.0], [40.0, 45.0]]
    monkeypatch.setattr(daemon, "picture", lambda seq: np.full((48, 64), 50 + seq % 50, np.uint8))  # no light there
    at_the_panel = {"corners_px": PANEL["corners_px"], "why": "fit.misfit"}  # a part of it: not told
    daemon.extra = {"rejected": [{"corners_px": beside, "why": "find.too_small"}, at_the_panel]}
    site.state_once("up")
    site.frame()
    assert [request["with"] for request in daemon.asked("picture")] == [[]]
    (found,) = site.frame("whynot")["why_not"]
    assert (found["why"], found["says"]) == ("find.too_small", "an outline too small for a panel")
    assert (found["helps"], found["corners_px"]) == ("go nearer", beside)


def test_the_table_has_a_row_for_each_panel(site: Site, daemon: MadeUpDaemon) -> None:
    """With its distance, and how often it was seen."""
    site.state_once("up")
    site.frame()
    (row,) = site.ask("GET", "/api/state").json()["panels"]
    assert (row["id"], row["distance_m"], row["yaw_deg"]) == (7, 2.0, 0.0)
    assert row["rate_hz"] > 0


def test_the_configuration_says_where_values_are_from_and_hides_the_token(site: Site, daemon: MadeUpDaemon) -> None:
    """Also where a daemon tells it."""
    site.state_once("up")
    keys = {row["key"]: row for row in site.ask("GET", "/api/config").json()["keys"]}
    assert [keys["panels.side_m"][part] for part in ("text", "from", "unit")] == ["0.16", "default", "m"]
    assert keys["view.token"]["text"] == "set"


def test_a_frame_can_be_kept_without_loss(site: Site, daemon: MadeUpDaemon) -> None:
    """As PNG of the picture's own pixels; it says what decodes it."""
    site.state_once("up")
    site.frame()
    answer = site.ask("GET", "/api/frame.png")
    assert (answer.status, answer.headers["Content-Type"], answer.body[:4]) == (200, "image/png", b"\x89PNG")
    told = text_of(answer.body)
    assert told is not None
    assert camera_of(told).exposure_us == daemon.hello["camera"]["exposure_us"]
    assert settings_of(told).panels.side_m == daemon.hello["panels"]["side_m"]


def test_commands_are_handed_on(site: Site, daemon: MadeUpDaemon) -> None:
    """And what the daemon answers is told, whether it could or not."""
    site.state_once("up")
    saved = site.ask("POST", "/api/save", RIGHT)
    assert (saved.status, saved.json()) == (200, {"path": "/var/lib/ledpi/take"})
    failed = site.ask("POST", "/api/record", RIGHT)
    assert (failed.status, failed.json()) == (503, {"error": "the disk is full"})
    assert [len(daemon.asked(do)) for do in ("save", "record")] == [1, 1]


@pytest.mark.slow
def test_every_page_knows_that_a_recording_runs(site: Site, daemon: MadeUpDaemon) -> None:
    """Whoever has begun it: until it is stopped, ends by itself, or the daemon is gone; a refused one does not run."""
    site.state_once("up")
    site.ask("POST", "/api/record", RIGHT)
    assert site.ask("GET", "/api/state").json()["recording"] is False
    daemon.disk_is_full = False
    assert site.ask("POST", "/api/record", RIGHT).status == 200
    assert site.ask("GET", "/api/state").json()["recording"] is True
    assert site.ask("POST", "/api/record_stop", RIGHT).status == 200
    assert site.ask("GET", "/api/state").json()["recording"] is False
    assert site.ask("POST", "/api/record", RIGHT).status == 200
    daemon.end_recording()
    wait_until(lambda: site.ask("GET", "/api/state").json()["recording"] is False)


def test_the_head_line_says_nothing_against_the_map(
    site: Site, daemon: MadeUpDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second without a fix is over once a frame has one; without one, the newest frame says why."""
    monkeypatch.setitem(HEALTH, "no_fix", "rejected")
    robot = {"position_m": [1.0, 2.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0], "panels_used": [7]}
    site.state_once("up")

    def state() -> dict[str, Any]:
        return site.ask("GET", "/api/state").json()

    daemon.frame = {"rejected": {"fix.ambiguous": 1}}
    wait_until(lambda: (now := state())["robot"] is None and now["no_fix"] == "ambiguous")
    assert state()["no_fix_says"] == "one panel is in view, and its mirror pose is not excluded"
    daemon.frame = {"robot": robot}
    wait_until(lambda: state()["robot"] is not None)
    assert state()["no_fix"] is None


def test_the_map_shows_the_state_between_panels(site: Site, daemon: MadeUpDaemon) -> None:
    """With its ellipse and what it rests on; a line that makes no sense changes nothing, and none is no robot."""
    state = {"mode": "odometry", "position_m": [1.0, 2.0], "yaw_rad": 0.5, "covariance": COVARIANCE, "way_m": 1.1}
    daemon.robot_state = state | {"contested": False, "moved": [11]}

    def robot() -> dict[str, Any]:
        return site.ask("GET", "/api/state").json()["robot"] or {}

    wait_until(lambda: robot().get("heading_rad") == 0.5)
    said = "dead reckoning, 2.4 s and 1.10 m since the last panel; not where the map has it: panel 11"
    assert (robot()["position_m"], robot()["by"]) == ([1.0, 2.0], said)
    assert (robot()["ellipse"]["long_m"], robot()["ellipse"]["short_m"]) == (0.06, 0.02)
    seen, daemon.robot_state = daemon.last_seq, daemon.robot_state | {"covariance": [1.0]}
    wait_until(lambda: daemon.last_seq > seen + 4)
    assert site.ask("GET", "/api/state").status == 200
    daemon.robot_state = {"mode": "none", "position_m": None}
    wait_until(lambda: not robot())


# ---- Without a daemon, and with a bad one


def test_without_a_daemon_it_says_so(site: Site) -> None:
    """The page is there, no picture comes, and nothing can be saved."""
    assert site.ask("GET", "/").status == 200
    state = site.state_once("down")
    assert "no running daemon answers" in state["link"]["says"] or "not yet" in state["link"]["says"]
    assert site.ask("GET", "/api/frame").status == 204
    answer = site.ask("POST", "/api/save", RIGHT)
    assert (answer.status, answer.json()) == (503, {"error": "the daemon is not running"})


def test_a_daemon_that_comes_back_is_followed_again(site: Site, daemon: MadeUpDaemon, tmp_path: Path) -> None:
    """And it is told that it was started anew."""
    assert site.state_once("up")["link"]["starts"] == 1
    daemon.close()
    assert "ended" in site.state_once("down")["link"]["says"]
    with closing(MadeUpDaemon(tmp_path / "tap.sock")):
        assert site.state_once("up")["link"]["starts"] == 2
        assert site.frame()["seq"] > 0


@pytest.mark.parametrize("panel_map", [None, {"7": HERE | {"side_m": 0.16}}])
def test_what_another_map_has_told_is_not_drawn_in_this_one(
    site: Site, daemon: MadeUpDaemon, tmp_path: Path, panel_map: dict[str, Any] | None
) -> None:
    """After a restart with another map there is no track and no panel of before; with the same, none, they stay."""
    daemon.frame = {"robot": HERE}
    wait_until(lambda: site.ask("GET", "/api/history").json()["track"])
    daemon.close()
    site.state_once("down")
    with closing(MadeUpDaemon(tmp_path / "tap.sock", hello={"map": panel_map}, frame_s=3600.0)):
        state = site.state_once("up")
        assert bool(state["panels"]) == bool(site.ask("GET", "/api/history").json()["track"]) == (panel_map is None)
        assert panel_map is None or state["robot"] is None


@pytest.mark.parametrize(
    "changes", [{"markers": 7}, {"markers": [{}]}, {"exposed_ns": None}, {"markers": [PANEL | {"position_m": [1]}]}]
)
def test_lines_that_cannot_be_used_stop_nothing(site: Site, daemon: MadeUpDaemon, changes: dict[str, Any]) -> None:
    """The next good ones are shown."""
    site.state_once("up")
    for frame in (changes, {}):
        daemon.frame, seen = frame, daemon.last_seq
        wait_until(lambda seen=seen: daemon.last_seq > seen + 4)
        site.ask("GET", "/api/frame")
    wait_until(lambda: [panel["id"] for panel in site.frame()["panels"]] == [7])
    assert site.ask("GET", "/api/state").status == 200


# ---- Who may


@pytest.mark.parametrize(
    "path", ["/api/save", "/api/record", "/api/record_stop", "/api/board/start", "/api/board/stop"]
)
@pytest.mark.parametrize("headers", [{}, {"Authorization": "Bearer wrong"}, {"Authorization": f"Basic {TOKEN}"}])
def test_nothing_is_changed_without_the_token(
    site: Site, daemon: MadeUpDaemon, path: str, headers: dict[str, str]
) -> None:
    """401, even on the machine's own address, and the daemon hears nothing."""
    site.state_once("up")
    assert site.ask("POST", path, headers).status == 401
    assert daemon.asked(path.removeprefix("/api/")) == []


def test_nothing_is_changed_by_get(site: Site, daemon: MadeUpDaemon) -> None:
    """A link, or a picture's address in a foreign page, is a GET."""
    site.state_once("up")
    assert site.ask("GET", "/api/save", RIGHT).status == 405
    assert daemon.asked("save") == []


def test_nothing_is_told_without_the_token(site: Site, daemon: MadeUpDaemon) -> None:
    """The page itself holds no data, and asks for the token; all that it asks for is 401 without."""
    site.state_once("up")
    for path in sorted({"/api/nothing", *(path for _, path in Handler.answers)} - {"/favicon.ico"}):
        for headers in ({}, {"Authorization": "Bearer wrong"}):
            assert site.ask("GET", path, headers).status == 401
            assert site.ask("HEAD", path, headers).status == 501
    assert daemon.asked("picture") == []
    assert site.ask("GET", "/api/state").status == 200
    assert TOKEN.encode() not in b"".join(site.ask("GET", path).body for path in ("/", "/main.js", "/view.css"))


OWN = ("localhost", "LOCALHOST:8088", "127.0.0.1:1", "192.168.7.7", "[::1]:8088", "robot.local")
FOREIGN = ("evil.example", "localhost.evil.example", "127.0.0.1.evil:80", "[::1].evil", "", "robot")


@pytest.mark.parametrize(("host", "status"), [*((name, 200) for name in OWN), *((name, 421) for name in FOREIGN)])
def test_a_foreign_name_that_leads_here_is_refused(site: Site, host: str, status: int) -> None:
    """DNS rebinding: a foreign site's own page would otherwise read ours. Own names have a port or none."""
    for path in ("/", "/api/state"):
        assert site.ask("GET", path, {"Host": host} | RIGHT).status == status


@pytest.mark.parametrize("asker", ["cross-site", "same-site"])
def test_another_sites_page_gets_nothing(site: Site, daemon: MadeUpDaemon, asker: str) -> None:
    """As browsers tell who asks."""
    site.state_once("up")
    assert site.ask("GET", "/api/frame", {"Sec-Fetch-Site": asker}).status == 403
    assert site.ask("POST", "/api/save", RIGHT | {"Sec-Fetch-Site": asker}).status == 403
    assert daemon.asked("save") == []


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", "/", 200), ("GET", "/api/state", 200), ("GET", "/no", 404), ("POST", "/api/save", 503), ("PUT", "/", 501)],
)
def test_every_answer_has_the_headers(site: Site, method: str, path: str, status: int) -> None:
    """Against frames, sniffing, foreign scripts and caches; and no foreign site is let in."""
    answer = site.ask(method, path)
    assert answer.status == status
    assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
    assert not [name for name in answer.headers if name.lower().startswith("access-control-")]
    assert "frame-ancestors 'none'" in HEADERS["Content-Security-Policy"]
    assert "Python" not in answer.headers["Server"]


# ---- What is asked


@pytest.mark.parametrize(
    "path",
    ["/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/main.js/", "/static/main.js", "/index.html"],
)
def test_no_path_reaches_the_file_system(site: Site, path: str) -> None:
    """There is a fixed table of pages."""
    assert site.ask("GET", path).status == 404


@pytest.mark.parametrize("query", ["kind=raw", "kind=..%2f", "after=x", "after=1e9", f"after={'9' * 40}"])
def test_a_question_that_makes_no_sense_is_told(site: Site, query: str) -> None:
    """400, in one line that says what would be right."""
    answer = site.ask("GET", f"/api/frame?{query}")
    assert answer.status == 400
    assert "must be" in answer.json()["error"]


@pytest.mark.parametrize(
    ("header", "status"),
    [
        ("Content-Length: -1", 400),
        ("Content-Length: ten", 400),
        ("Content-Length: ²", 400),
        (f"Content-Length: {MAX_BODY_BYTES + 1}", 413),
        (f"Content-Length: {10 << 20}", 413),
        (f"Content-Length: {'9' * 5000}", 413),
        ("Transfer-Encoding: chunked", 411),
    ],
)
def test_a_body_that_is_too_long_or_of_no_known_length_is_refused(site: Site, header: str, status: int) -> None:
    """The answer comes though no byte of it was sent; then the connection is closed."""
    with site.raw() as connection:
        connection.sendall(_request("POST /api/save", header))
        assert _all(connection).startswith(b"HTTP/1.1 %d " % status)


@pytest.mark.parametrize(
    "sent",
    [
        b"\0" * 100 + b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET http://[ HTTP/1.1\r\n\r\n",
        b"POST http://[ HTTP/1.1\r\nExpect: 100-continue\r\n\r\n",
        b"A" * 70_000 + b"\r\n\r\n",
    ],
)
def test_what_is_no_request_is_refused(site: Site, sent: bytes) -> None:
    """With an answer that repeats nothing of it, and the next client is served."""
    with site.raw() as connection:
        connection.sendall(sent)
        answer = _all(connection)
        assert b" 400 " in answer[:20] or b" 414 " in answer[:20] or b" 505 " in answer[:20]
        assert sent[:8] not in answer
    assert site.ask("GET", "/").status == 200


# ---- Who comes


def test_bytes_that_drip_hold_no_connection(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """A request must be there in time as a whole, however steadily its bytes come."""
    monkeypatch.setattr(connections, "IDLE_S", 0.5)
    with site.raw() as connection:
        start_s, ended = time.monotonic(), False
        while not ended:
            assert time.monotonic() < start_s + limit_s(), "the connection is held"
            try:
                connection.sendall(b"G")
                connection.settimeout(0.05)
                ended = connection.recv(1) == b""
            except TimeoutError:
                continue
            except OSError:
                ended = True


def test_one_viewer_too_many_is_told(site: Site, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """503; when another has gone, there is room again."""
    monkeypatch.setattr(connections, "MOST", 2)
    with closing(Site(tmp_path / "other.sock")) as small:
        first, second = small.raw(), small.raw()
        for connection in (first, second):
            connection.sendall(_request("GET /api/history"))
            assert connection.recv(12) == b"HTTP/1.1 200"
        with small.raw() as third:
            assert _all(third).startswith(b"HTTP/1.1 503 ")
        first.close()

        def served() -> bool:
            with small.raw() as fourth:
                fourth.sendall(_request("GET /"))
                return fourth.recv(12) == b"HTTP/1.1 200"

        wait_until(served, "the place that was given back")
        second.close()


def test_a_connection_that_breaks_is_no_fault_and_a_fault_is_told(
    site: Site, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Half a request, and a reset; then an answer that fails."""
    with site.raw() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.sendall(_request("POST /api/save", "Content-Length: 10"))
    monkeypatch.setattr(site.hub, "history", lambda: 1 // 0)
    with pytest.raises(http.client.RemoteDisconnected):
        site.ask("GET", "/api/history")
    wait_until(lambda: "ZeroDivisionError" in caplog.text, "the fault")
    assert caplog.text.count("a request failed") == 1


def test_connections_that_drip_keep_nobody_out(site: Site) -> None:
    """Sixty of one address ask for nothing; of another address, and of the same one, a request is answered."""
    dripping = [socket.create_connection(("127.0.0.1", site.port), source_address=("127.0.0.2", 0)) for _ in range(60)]
    for connection in dripping:
        with suppress(OSError):  # the oldest have given way already
            connection.sendall(b"GET /api/")
    for address in ("127.0.0.1", "127.0.0.2"):
        start_s = time.monotonic()
        with socket.create_connection(("127.0.0.1", site.port), source_address=(address, 0)) as late:
            late.sendall(_request("GET /api/history"))
            assert late.recv(12) == b"HTTP/1.1 200"
        assert time.monotonic() - start_s < connections.IDLE_S / 2  # none of the sixty had to end first
    for connection in dripping:
        connection.close()


def test_who_has_shown_the_token_does_not_give_way(site: Site) -> None:
    """However many come after it."""
    with site.raw() as viewer:
        viewer.sendall(_request("GET /api/history"))
        assert viewer.recv(12) == b"HTTP/1.1 200"
        others = [site.raw() for _ in range(2 * connections.MOST)]
        assert site.ask("GET", "/api/history").status == 200
        viewer.sendall(_request("GET /api/history", "Connection: close"))
        assert _all(viewer).count(b"HTTP/1.1 200") == 1
        for other in others:
            other.close()


def test_a_viewer_that_never_reads_delays_no_other(site: Site, daemon: MadeUpDaemon) -> None:
    """Ten of them have asked for a hundred pictures each."""
    site.state_once("up")
    stalled = [site.raw() for _ in range(10)]
    for connection in stalled:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.sendall(_request("GET /api/frame") * 100)
    seqs = []
    number = -1
    for _ in range(5):
        shown = site.frame(after=number)
        number = shown["number"]
        seqs.append(shown["seq"])
    assert seqs == sorted(set(seqs))
    for connection in stalled:
        connection.close()


def test_nothing_is_asked_or_encoded_while_nobody_watches(site: Site, daemon: MadeUpDaemon) -> None:
    """The state alone needs no picture."""
    site.state_once("up")
    for _ in range(10):
        site.ask("GET", "/api/state?after=-1")
    time.sleep(0.3)
    assert daemon.asked("picture") == []
    assert site.hub.pictures.came_so_far == 0


def test_a_picture_is_encoded_once_for_all_viewers_and_15_times_a_second_at_most(
    site: Site, daemon: MadeUpDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four watch as fast as they can; the daemon has 50 frames a second."""
    encoded: list[int] = []
    plain = pictures.as_jpeg
    monkeypatch.setattr(pictures, "as_jpeg", lambda pixels: encoded.append(1) or plain(pixels))
    site.state_once("up")
    start_s = time.monotonic()
    seen: list[int] = []

    def watch() -> None:
        number = -1
        for _ in range(15):
            shown = site.frame(after=number)
            number = shown["number"]
            seen.append(number)

    viewers = [threading.Thread(target=watch) for _ in range(4)]
    for viewer in viewers:
        viewer.start()
    for viewer in viewers:
        viewer.join(limit_s())
    took_s = time.monotonic() - start_s
    assert len(seen) == 60
    assert len(encoded) == len(set(seen))
    assert len(daemon.asked("picture")) <= 15 * took_s + 2


def _request(first: str, *headers: str) -> bytes:
    lines = [f"{first} HTTP/1.1", "Host: localhost", f"Authorization: Bearer {TOKEN}", *headers]
    return "".join(f"{line}\r\n" for line in [*lines, ""]).encode()


def _all(connection: socket.socket) -> bytes:
    """Until the server closes it."""
    got = b""
    try:
        while data := connection.recv(65536):
            got += data
    except ConnectionResetError:  # what was sent and not read is lost with the connection
        pass
    return got


def test_metrics_are_read_by_prometheus_own_parser(site: Site, daemon: MadeUpDaemon) -> None:
    """Counters, reasons, state, versions, what was read; without a daemon nothing of its health."""
    parser = pytest.importorskip("prometheus_client.parser")
    site.state_once("up")
    wait_until(lambda: b"ledpi_markers_total{" in site.ask("GET", "/metrics").body)
    answer = site.ask("GET", "/metrics")
    assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
    found = {
        (sample.name, *sample.labels.values()): sample.value
        for family in parser.text_string_to_metric_families(answer.body.decode())
        for sample in family.samples
    }
    assert found["ledpi_up",] == 1.0
    assert found["ledpi_decoded_frames_total",] == 100.0
    assert found["ledpi_latency_seconds", "worst"] == 0.006
    assert found["ledpi_serial_connected",] == 1.0
    assert found["ledpi_state", "running", "no_map"] == 1.0
    assert found["ledpi_build_info", __version__, "0.0.0"] == 1.0
    assert found["ledpi_markers_total", "7"] >= 1.0
    assert found["ledpi_fixes_total",] == 0.0
    daemon.close()
    site.state_once("down")
    assert site.ask("GET", "/metrics").body.decode().splitlines()[-1] == "ledpi_up 0"


def test_metrics_need_the_token(site: Site) -> None:
    """As all that is told; or one of their own, which opens nothing else."""
    assert site.ask("GET", "/metrics", {}).status == 401
    assert site.ask("GET", "/metrics").status == 200
    own = {"Authorization": f"Bearer {metrics_token(TOKEN)}"}
    assert site.ask("GET", "/metrics", own).status == 200
    assert site.ask("GET", "/api/state", own).status == 401
    assert site.ask("POST", "/api/save", own).status == 401


# ---- Recordings


def test_a_take_is_passed_on_piece_by_piece(site: Site, daemon: MadeUpDaemon) -> None:
    """60 MB arrive as the daemon gave them, while this process takes less than a fifth of that more."""
    site.state_once("up")
    assert site.ask("GET", "/api/takes").json() == [{"name": TAKE, "frames": 9, "written": False}]
    tracemalloc.start()
    try:
        with closing(http.client.HTTPConnection("127.0.0.1", site.port, timeout=limit_s())) as connection:
            connection.request("GET", f"/api/take.tar?name={TAKE}", headers=RIGHT)
            answer = connection.getresponse()
            assert (answer.status, answer.getheader("Content-Type")) == (200, "application/x-tar")
            assert answer.length == TAKE_BYTES
            got = 0
            while piece := answer.read(PIECE_BYTES):
                assert piece == bytes((got // PIECE_BYTES % 251,)) * len(piece)
                got += len(piece)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert got == TAKE_BYTES
    assert most < TAKE_BYTES / 5


def test_a_take_that_goes_meanwhile_ends_the_answer_short(site: Site, daemon: MadeUpDaemon) -> None:
    """So that a browser does not take it for whole; the page lives on."""
    site.state_once("up")
    daemon.take_breaks_at = 5 * PIECE_BYTES
    with pytest.raises(http.client.IncompleteRead):
        site.ask("GET", f"/api/take.tar?name={TAKE}")
    assert site.ask("GET", "/api/takes").status == 200


@pytest.mark.parametrize("name", ["", "..", "../../etc/passwd", "%2e%2e%2f", "a" * 100, "%00", "%F0%9F%92%A9"])
def test_a_name_is_the_daemons_to_judge(site: Site, daemon: MadeUpDaemon, name: str) -> None:
    """It is passed on as text, and what the daemon says of it comes back; never a file."""
    site.state_once("up")
    answer = site.ask("GET", f"/api/take.tar?name={name}")
    assert answer.status == 503
    assert answer.json()["error"].startswith("take: no ")
    assert {request["name"] for request in daemon.asked("take")} == {unquote(name)}
