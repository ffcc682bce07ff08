"""The tap: real clients on a real socket, good ones and bad ones; the decode thread is played by the test."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path
from statistics import median
from types import SimpleNamespace

import numpy as np
import pytest

from ledpi.config.panels import PanelOverride, PanelSettings
from ledpi.core.errors import ConfigError, DiskFullError, TapAgainError, TapError
from ledpi.core.records import MapPanel
from ledpi.daemon.tap.client import connect
from ledpi.daemon.tap.crowd import MOST_FOLLOWERS
from ledpi.daemon.tap.frames import camera_of, frame_of, settings_of
from ledpi.daemon.tap.protocol import MAX_REQUEST_BYTES, Request
from ledpi.daemon.tap.server import CLIENTS_SHARE, MOST_WAITING_BYTES, PACE_S, Tap
from ledpi.pipeline.trace import Trace
from ledpi.state.inputs import Odometry
from tests.builders import ROOT
from tests.builders.tap import CAMERA, HEIGHT, SETUP, WIDTH, Raw, decoded, frame, show, tap_at
from tests.builders.waiting import limit_s, wait_until

FLOOD = 500  # requests


@pytest.fixture(autouse=True)
def _no_client_is_left() -> Iterator[None]:
    yield
    Raw.close_all()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "tap.sock"


@pytest.fixture
def tap(path: Path) -> Iterator[Tap]:
    with tap_at(path) as tap:
        yield tap


def follow(tap: Tap) -> Raw:
    """A client that has its hello, and that frames are shown to."""
    client = Raw(tap.path)
    assert client.line()["type"] == "hello"
    wait_until(lambda: tap.is_followed)
    return client


class Stream:
    """A decoder that shows a frame each few milliseconds, while a test does something else."""

    def __init__(self, tap: Tap, period_s: float = 0.005) -> None:
        self._tap, self._period_s = tap, period_s
        self._stop = threading.Event()
        self.shown = 0
        self.took_s: list[float] = []  # of the calls
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            self.shown += 1
            one = frame(self.shown)
            result, trace = decoded(one), self._tap.trace()
            began_s = time.perf_counter()
            self._tap.show(one, result, trace)
            self.took_s.append(time.perf_counter() - began_s)

    def __enter__(self) -> Stream:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


# ---- What a follower gets


def test_the_first_line_says_what_daemon_it_is(tap: Tap) -> None:
    """Its camera, its panels, and what this client may do."""
    for do in ("save", "record", "record_stop"):
        tap.offer(do, lambda request: {})
    hello = Raw(tap.path).line()
    assert (hello["type"], hello["tap"], hello["pid"]) == ("hello", 1, 1)
    assert (hello["camera"]["width"], hello["camera"]["height"], hello["camera"]["fx"]) == (WIDTH, HEIGHT, None)
    assert hello["panels"]["side_m"] == 0.16
    assert hello["may"] == ["save", "record"]  # the daemon's own user


def test_each_frame_is_a_line_with_its_times(tap: Tap) -> None:
    """Exposed is the middle of the centre row's exposure; decoded is later, and before it is read."""
    client, one = follow(tap), frame(7)
    tap.show(one, decoded(one))
    line = client.next("decoded")
    middle_ns = one.row0_readout_ns + (HEIGHT - 1) / 2 * 20e3 - 500e3
    assert line["exposed_ns"] == pytest.approx(middle_ns, abs=1)
    assert one.row0_readout_ns <= line["decoded_ns"] <= time.monotonic_ns()
    assert (line["seq"], line["rejected"], line["dropped"]) == (7, {"fit.misfit": 1}, 0)


def test_health_comes_with_its_latency_and_the_newest_warnings(tap: Tap, caplog: pytest.LogCaptureFixture) -> None:
    """As the daemon's log had them."""
    client = follow(tap)
    for number in range(25):
        logging.getLogger("ledpi").warning("fault %d\nof two lines", number)
    show(tap, 1)
    client.next("decoded")
    tap.tell({"state": "running"})
    health = client.next("health")
    assert [fault["text"] for fault in health["faults"]] == [rf"fault {n}\nof two lines" for n in range(5, 25)]
    assert health["latency_ms"]["worst"] >= health["latency_ms"]["median"]
    assert len(caplog.records) == 25


def test_a_picture_is_that_of_its_line(tap: Tap) -> None:
    """Every pixel of the frame whose number the line says."""
    with connect(tap.path) as client, Stream(tap):
        answer = client.picture()
    assert answer["pixels"].shape == (HEIGHT, WIDTH)
    assert (answer["pixels"] == answer["decoded"]["seq"] % 256).all()
    assert "rejected" not in answer
    assert "looks" not in answer


def test_saturation_is_counted(tap: Tap) -> None:
    """The share of pixels that are as bright as pixels can be."""
    client = follow(tap)
    client.send({"do": "picture", "id": 1, "with": ["rejected"]})
    wait_until(lambda: tap.trace() is not None)
    one = frame(0)
    pixels = one.pixels.copy()
    pixels[: HEIGHT // 4] = 255
    bright = dataclasses.replace(one, pixels=pixels)
    tap.show(bright, decoded(bright), Trace(searched=True))
    assert client.next("picture")["pixels_max_share"] == 0.25


def test_nothing_is_copied_nor_traced_unless_somebody_asks(tap: Tap) -> None:
    """For the decoder that is what a picture costs; with extras it traces, and only then."""
    client = follow(tap)
    assert tap.trace() is None
    client.send({"do": "picture", "id": 1, "with": ["rejected"]})
    wait_until(lambda: tap.trace() is not None)
    one = frame(1)
    tap.show(one, decoded(one), Trace(searched=True))
    assert client.next("picture")["rejected"] == []
    assert tap.trace() is None


@pytest.mark.parametrize(("searched", "sent"), [(3, 3), (None, 4)])
def test_what_was_rejected_is_told_of_a_frame_that_was_searched(tap: Tap, searched: int | None, sent: int) -> None:
    """A stream searches the whole picture now and then; three frames are passed over for such a one, and no more."""
    client = follow(tap)
    client.send({"do": "picture", "id": 1, "with": ["rejected"]})
    wait_until(lambda: tap.trace() is not None)
    for seq in range(1, 6):
        if tap.trace() is not None:
            one = frame(seq)
            tap.show(one, decoded(one), Trace(searched=seq == searched))
    assert client.next("picture")["decoded"]["seq"] == sent


# ---- Who reads slowly, or not at all


def test_a_slow_client_gets_the_newest_and_is_told_what_it_missed(tap: Tap) -> None:
    """Gets what was in the system's buffer first; then the last frame of all."""
    client = follow(tap)
    for seq in range(500):
        show(tap, seq)
        time.sleep(0.0005)
    lines = [client.next("decoded")]
    while lines[-1]["seq"] != 499:
        tap.tell({})  # it is looked at again, whether there is room
        lines.append(client.next("decoded"))
    assert len(lines) < 100
    assert lines[-1]["dropped"] == 500 - len(lines)


def test_clients_that_never_read_do_not_delay_the_decoder(path: Path) -> None:
    """Handing over takes as long with ten stalled clients as with one that reads; what waits for them is bounded."""
    with tap_at(path) as tap:
        reader = follow(tap)
        drain = threading.Thread(target=reader.is_closed)
        drain.start()
        with Stream(tap, 0.002) as alone:
            wait_until(lambda: alone.shown >= 200)
        stalled = [Raw(path) for _ in range(10)]
        for client in stalled:
            for number in range(20):
                client.send({"do": "picture", "id": number})
        with Stream(tap, 0.002) as crowded:
            wait_until(lambda: crowded.shown >= 400)
            waiting = tap.waiting_bytes
        assert crowded.shown == len(crowded.took_s)
    drain.join()
    assert median(crowded.took_s) < 3 * median(alone.took_s) + 20e-6
    assert waiting < 10 * 2 * (HEIGHT * WIDTH + 4096)
    assert waiting < MOST_WAITING_BYTES


def test_a_client_that_takes_nothing_is_given_up(tap: Tap, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that read go on."""
    monkeypatch.setattr("ledpi.daemon.tap.follower.GIVEN_UP_S", 0.3)
    dead, alive = follow(tap), follow(tap)
    with Stream(tap):
        wait_until(lambda: alive.next("decoded")["seq"] > 0 and dead.is_hung_up())
        assert alive.next("decoded")
    assert dead.is_closed()


def test_one_that_only_asks_no_more_is_still_answered(tap: Tap) -> None:
    """As a shell's pipe ends: `echo … | socat`."""
    client = Raw(tap.path)
    client.send({"do": "config", "id": 5})
    client.socket.shutdown(socket.SHUT_WR)
    assert client.next("config")["id"] == 5
    wait_until(lambda: tap.is_followed)
    show(tap, 3)
    assert client.next("decoded")["seq"] == 3


# ---- What is no request


@pytest.mark.parametrize("garbage", [b"\x00\xff\n", b"GET / HTTP/1.1\r\n", b"{}\n", b"[[[[\n"])
def test_after_garbage_the_connection_stays(tap: Tap, garbage: bytes) -> None:
    """The answer says what is wrong; the next request is answered."""
    client = follow(tap)
    client.send(garbage)
    assert client.next("error")["id"] is None
    client.send({"do": "config", "id": 2})
    assert client.next("config")["id"] == 2


def test_a_line_without_end_ends_the_connection(tap: Tap) -> None:
    """Ten megabytes are not read: an error, and closed. Others notice nothing."""
    client, other = follow(tap), follow(tap)
    with pytest.raises((BrokenPipeError, ConnectionResetError)):
        client.send(b"x" * 10_000_000)
    assert f"{MAX_REQUEST_BYTES} bytes" in client.next("error")["error"]
    assert client.is_closed()
    show(tap, 1)
    assert other.next("decoded")["seq"] == 1


def test_the_longest_line_that_is_allowed_is_read(tap: Tap) -> None:
    """One byte more is not."""
    client = follow(tap)
    text = json.dumps({"do": "config", "id": 1})
    client.send(text + " " * (MAX_REQUEST_BYTES - len(text) - 1) + "\n")
    assert client.next("config")
    client.send(text + " " * (MAX_REQUEST_BYTES - len(text)) + "\n")
    assert "without an end" in client.next("error")["error"]


@pytest.mark.slow
def test_a_flood_of_requests_waits_in_its_own_buffer(tap: Tap) -> None:
    """Each is answered at last, no sooner than one a turn, and at no time are more than a few kept here."""
    client, began_s = follow(tap), time.monotonic()
    sender = threading.Thread(target=lambda: [client.send({"do": "config", "id": n}) for n in range(FLOOD)])
    sender.start()
    most = 0
    for number in range(FLOOD):
        assert client.next("config")["id"] == number
        most = max(most, tap.waiting_bytes)
    sender.join()
    assert most < 10 * MAX_REQUEST_BYTES
    assert time.monotonic() - began_s > (FLOOD - 1) * PACE_S


FLOOD_OF = {
    "questions": """
clients = [connected() for _ in range(40)]
while True:
    for client in clients:
        try: client.send(b'{"do": "config", "id": 1}\\n' * 8)
        except BlockingIOError: pass
        try: client.recv(1 << 16)
        except BlockingIOError: pass
""",
    "pictures": """
clients = [connected() for _ in range(40)]
while True:
    for client in clients:
        try: client.send(b'{"do": "picture", "id": 1, "with": ["rejected", "evidence"]}\\n' * 8)
        except BlockingIOError: pass
        try: client.recv(1 << 20)
        except BlockingIOError: pass
""",
    "connections": """
while True: connected().close()
""",
}
_ONLY_READ = """
import time
clients = [connected() for _ in range(40)]
while True:
    time.sleep(0.01)
    for client in clients:
        try: client.recv(1 << 16)
        except BlockingIOError: pass
"""
_FLOODING = """
import socket, sys
def connected():
    client = socket.socket(socket.AF_UNIX)
    client.connect(sys.argv[1])
    client.setblocking(False)
    return client
print(flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", FLOOD_OF)
def test_a_flood_takes_little_more_than_clients_that_only_read(tap: Tap, kind: str) -> None:
    """Whatever clients ask for, however often they come: the share that is meant for them.

    What passing frames on takes hangs on what else the machine does: it is measured twice.
    """
    reading = max(share_beside(tap, _ONLY_READ) for _ in range(2))
    assert share_beside(tap, FLOOD_OF[kind]) < reading + CLIENTS_SHARE


def share_beside(tap: Tap, clients: str) -> float:
    """Returns the share of a processor that the tap takes beside such clients; each frame is passed on in its turn."""
    client = follow(tap)
    command = [sys.executable, "-c", _FLOODING + clients, str(tap.path)]
    with Stream(tap, 0.02), subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as flood:
        assert flood.stdout is not None
        flood.stdout.readline()
        time.sleep(0.5)
        worked_s, began_s = processor_s(), time.monotonic()
        seqs = [client.line()["seq"] for _ in range(100)]
        share = (processor_s() - worked_s) / (time.monotonic() - began_s)
        flood.kill()
    client.close()
    assert seqs == sorted(set(seqs))
    return share


def processor_s() -> float:
    """Returns what the tap's thread has used so far."""
    (thread,) = (thread for thread in threading.enumerate() if thread.name == "tap")
    assert thread.ident is not None
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def test_the_65th_client_is_sent_away(tap: Tap) -> None:
    """And may come when another has gone."""
    clients = [follow(tap) for _ in range(MOST_FOLLOWERS)]
    late = Raw(tap.path)
    assert f"{MOST_FOLLOWERS} clients are here" in late.line()["error"]
    assert late.is_closed()
    with pytest.raises(TapError, match="64 clients are here"):
        connect(tap.path)
    clients[0].close()
    wait_until(lambda: Raw(tap.path).line()["type"] == "hello")
    for client in clients[1:]:
        client.close()


# ---- Commands


def test_a_command_is_done_beside_all_else(tap: Tap) -> None:
    """It takes its time; meanwhile frames go on, and a second one of its kind is put off."""
    gate = threading.Event()
    tap.offer("save", lambda request: {"path": f"/saved/{gate.wait(limit_s())}"})
    client = follow(tap)
    client.send({"do": "save", "id": 1})
    client.send({"do": "save", "id": 2})
    assert "is not done yet" in client.next("error")["error"]
    show(tap, 1)
    assert client.next("decoded")["seq"] == 1
    gate.set()
    assert client.next("done") == {"type": "done", "id": 1, "path": "/saved/True"}


def test_odometry_is_taken_at_once_and_states_are_told(tap: Tap) -> None:
    """A hundred messages, in their order; only what has an id, or is wrong, is answered."""
    taken: list[Request] = []

    def take(request: Request) -> dict[str, str]:
        taken.append(request)
        return {}

    tap.offer("odometry", take)
    client = follow(tap)
    for n in range(100):
        client.send({"do": "odometry", "t_ns": n, "left_m": 0.5 * n, "right_m": 0} | ({"id": 7} if n == 99 else {}))
    client.send({"do": "odometry", "t_ns": -1})
    assert client.next("done") == {"type": "done", "id": 7}
    assert "t_ns" in client.next("error")["error"]
    told = [request.odometry for request in taken]
    assert told == [Odometry(t_ns=n, left_m=0.5 * n, right_m=0) for n in range(100)]
    tap.tell_state({"type": "robot_state", "t_ns": 5})
    assert client.next("robot_state")["t_ns"] == 5


@pytest.mark.parametrize(("failure", "said"), [(OSError(28, "No space left"), "No space"), (KeyError("x"), "KeyError")])
def test_a_command_that_fails_says_so(tap: Tap, failure: Exception, said: str) -> None:
    """To who asked; the tap goes on."""

    def fail(request: object) -> dict[str, str]:
        raise failure

    tap.offer("save", fail)
    with connect(tap.path) as client:
        with pytest.raises(TapError, match=said):
            client.ask("save")
        assert client.ask("config")


def test_a_command_that_may_succeed_later_says_so(tap: Tap) -> None:
    """As where the disk is full; the client's program then ends with status 1."""

    def fail(request: object) -> dict[str, str]:
        raise DiskFullError("no room")

    tap.offer("save", fail)
    with connect(tap.path) as client, pytest.raises(TapAgainError, match="no room"):
        client.ask("save")


def test_what_the_daemon_does_not_offer_is_refused(tap: Tap) -> None:
    """With the reason."""
    tap.offer("takes", lambda request: {})
    with connect(tap.path) as client, pytest.raises(TapError, match="rewind is off"):
        client.ask("save")


AS_NOBODY = """
import json, os, socket, sys
os.setgroups([int(g) for g in sys.argv[2:]]); os.setgid(65534); os.setuid(65534)
s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1]); f = s.makefile("rb")
print(json.loads(f.readline())["may"])
s.sendall(b'{"do": "record", "id": 1}\\n')
print(json.loads(f.readline()))
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be somebody else")
@pytest.mark.parametrize("is_member", [False, True])
def test_only_who_may_gives_commands(is_member: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another user who can connect may look; a member of the group, if only by a supplementary one, may command."""
    monkeypatch.setattr("grp.getgrnam", lambda name: SimpleNamespace(gr_gid=54321))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        path = Path(folder) / "tap.sock"
        with tap_at(path) as tap:
            path.chmod(0o666)
            tap.offer("record", lambda request: {"path": "/saved"})
            groups = ["4", "54321"] if is_member else ["4"]
            command = [sys.executable, "-c", AS_NOBODY, str(path), *groups]
            done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s(30), cwd="/", check=True)
    may, answer = done.stdout.splitlines()
    assert may == ("['record']" if is_member else "[]")
    assert ("'/saved'" in answer) is is_member
    assert ("not permitted; root, the daemon's own user and members of the group ledpi may" in answer) is not is_member


# ---- The client


def test_a_client_comes_back_when_the_daemon_does(path: Path) -> None:
    """It says when it has lost it, and goes on with the new one's hello."""
    with tap_at(path):
        client = connect(path)
        lines = client.lines(reconnect=True, tick_s=0.05)
        assert next(lines)["type"] == "hello"
    kinds = {next(lines)["type"] for _ in range(8)}
    assert kinds == {"lost", "tick"}
    with tap_at(path) as tap:
        while (line := next(lines))["type"] != "hello":
            pass
        wait_until(lambda: tap.is_followed)
        show(tap, 9)
        while (line := next(lines))["type"] == "tick":
            pass
        assert line["seq"] == 9
        client.close()


def test_without_reconnection_the_lines_end_with_the_daemon(path: Path) -> None:
    """As a file does."""
    with tap_at(path):
        client = connect(path)
        lines = client.lines()
        next(lines)
    assert list(lines) == []
    client.close()


def test_no_daemon_is_said_with_where_it_was_looked_for(path: Path) -> None:
    """Each place, and why not."""
    with pytest.raises(TapError, match=r"no running daemon answers \(.*tap.sock: No such file or directory\); start"):
        connect(path)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be somebody else")
def test_who_may_not_connect_is_told_of_the_group() -> None:
    """As a user on the Pi who is not in it."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        path = Path(folder) / "tap.sock"
        script = f"import os; from ledpi.daemon.tap.client import connect; os.setuid(65534); connect({str(path)!r})"
        with tap_at(path):
            done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "tap.sock: Permission denied (are you in the group ledpi?)" in done.stderr


def test_another_programs_socket_is_no_daemon(path: Path) -> None:
    """Takes what it says for no tap's."""
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(path))
        other.listen()

        def answer() -> None:
            with other.accept()[0] as connection:
                connection.sendall(b"220 mail ready\n")

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(TapError, match="no line of a tap"):
            connect(path)
        thread.join()


def test_a_picture_that_does_not_come_is_said(tap: Tap) -> None:
    """A daemon whose camera is lost decodes nothing."""
    with connect(tap.path) as client, pytest.raises(TapError, match=r"no answer within 0.2 s; does its camera deliver"):
        client.picture(timeout_s=0.2)


def test_a_records_camera_comes_back_whole(tap: Tap) -> None:
    """Finds enough in the hello to decode a picture again."""
    with connect(tap.path) as client, Stream(tap):
        again = frame_of(client.hello, client.picture())
    assert camera_of(client.hello) == CAMERA
    assert settings_of(client.hello).panels.side_m == 0.16
    assert (again.exposure_us, again.row_time_us, again.transfer) == (1000.0, 20.0, "linear")


def test_a_daemons_settings_come_back_whole(tap: Tap) -> None:
    """The section `panels`, the method and the mount. A side that the map gives is the panel's; --set is on top."""
    panels = PanelSettings(
        side_m=0.16,
        ids=(3, 7, 9),
        upright=True,
        search_frequencies=True,
        overrides={7: PanelOverride(black_hz=1262.0, measured=date(2026, 11, 25)), 9: PanelOverride(side_m=0.2)},
    )
    at = np.eye(4)
    panel_map = {3: MapPanel(map_from_marker=at, side_m=0.3), 7: MapPanel(map_from_marker=at, side_m=0.08)}
    values = {"decode.method": "uemura", "robot.camera_mount.rpy_deg": [0.0, -90.0, 0.0]}
    tap.begin(replace(SETUP, panels=panels, panel_map=panel_map, values=values, config_path="/etc/ledpi/config.yaml"))
    with connect(tap.path) as client:
        settings, wider = settings_of(client.hello), settings_of(client.hello, ["panels.overrides.9.side_m=0.4"])
        assert client.hello["config_path"] == "/etc/ledpi/config.yaml"
    own = {3: PanelOverride(side_m=0.3), 7: panels.overrides[7].model_copy(update={"side_m": 0.08})}
    assert settings.panels == panels.model_copy(update={"overrides": {**panels.overrides, **own}})
    assert (settings.decode.method, settings.robot.camera_mount.rpy_deg) == ("uemura", (0.0, -90.0, 0.0))
    assert wider.panels.overrides[9].side_m == 0.4


def test_a_daemons_settings_that_cannot_be_used_here_are_said(tap: Tap) -> None:
    """As a dictionary that only the daemon may read; a mistake of --set is the user's own."""
    with connect(tap.path) as client:
        hidden = client.hello | {"panels": client.hello["panels"] | {"dictionary": "/srv/words.yaml"}}
        with pytest.raises(TapError, match=r"the daemon's panels cannot be used here: .*words\.yaml"):
            settings_of(hidden)
        with pytest.raises(ConfigError, match=r"panels\.ids: must be a list"):
            settings_of(client.hello, ["panels.ids=7"])
