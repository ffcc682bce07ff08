"""The tap of a real daemon: what `monitor`, `snapshot` and the page's own examples read from it."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import pytest

from ledpi.core.errors import TapError
from ledpi.daemon.tap.client import connect
from tests.builders.command import complaint, in_process, ledpi
from tests.builders.daemon import ROOT, SIMULATED, SIMULATED_YAML, controller, daemon, end, write_recording
from tests.builders.tap import Raw, at, reach
from tests.builders.waiting import limit_s

pytestmark = pytest.mark.slow  # each has a daemon
FOR_EVER = ("--frames", "1000000")  # round and round


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The socket of one that replays a panel of ID 7 at 1 m, 12 frames a second, over and over."""
    folder = tmp_path_factory.mktemp("tap")
    write_recording(folder / "take", 30, rows=5 * 504)
    path = folder / "tap.sock"
    source = f"camera.source=recording:{folder / 'take'}"
    with daemon(source, at(path), "serial.port=/dev/nothing", options=FOR_EVER) as process:
        reach(path).close()
        yield path
        assert process.poll() is None


@pytest.fixture(autouse=True)
def _no_client_is_left() -> Iterator[None]:
    yield
    Raw.close_all()


# ---- What it tells


def test_the_lines_are_those_of_decode(tmp_path: Path) -> None:
    """Frame by frame, to the last digit; only the tap knows when a pose was true on this machine's clock."""
    write_recording(tmp_path / "take", 30)
    said = ledpi("decode", str(tmp_path / "take")).stdout.splitlines()
    wanted = {line["seq"]: line for line in map(json.loads, said)}
    path = tmp_path / "tap.sock"
    source = f"camera.source=recording:{tmp_path / 'take'}"
    with daemon(source, at(path), options=("--unpaced", "--frames", "30")), reach(path) as client:
        lines = [line for line in client.lines() if line["type"] == "decoded"]
    assert len(lines) > 10
    for line in lines:
        times_ns = [marker.pop("exposed_ns") for marker in line["markers"]]
        assert all(abs(time_ns - line["exposed_ns"]) < 9e6 for time_ns in times_ns)  # half a picture's read-out
        same = wanted[line["seq"]].keys() - {"recording", "decode_ms"}
        assert {key: line[key] for key in same} == {key: wanted[line["seq"]][key] for key in same}
        assert line["exposed_ns"] < line["decoded_ns"]


def test_a_picture_shows_what_its_line_says(running: Path) -> None:
    """Within the corners there is light; each look has a number for each cell."""
    with connect(running) as client:
        answer = client.picture("rejected", "evidence")
    (marker,) = answer["decoded"]["markers"]
    assert marker["id"] == 7
    xs, ys = zip(*marker["corners_px"], strict=True)
    inside = answer["pixels"][int(min(ys)) : int(max(ys)), int(min(xs)) : int(max(xs))]
    assert inside.mean() > 1.2 * answer["pixels"].mean()
    look = next(look for look in answer["looks"] if look["id"] == 7)
    assert (len(look["cells_nats"]), look["why"]) == (16, None)


# ---- Its life


def test_a_reload_keeps_the_connection_and_says_hello_again(tmp_path: Path) -> None:
    """The new daemon's camera is in it."""
    config, path = tmp_path / "config.yaml", tmp_path / "tap.sock"
    text = "panels: {side_m: 0.16}\n" + SIMULATED_YAML
    config.write_text(text, encoding="utf-8")
    with daemon(at(path), options=("--config", str(config))) as process, reach(path) as client:
        lines = client.lines()
        before = next(lines)
        config.write_text(text.replace("source", "exposure_us: 5000, source"), encoding="utf-8")
        process.send_signal(signal.SIGHUP)
        after = next(line for line in lines if line["type"] == "hello")
        assert next(line for line in lines if line["type"] == "decoded")
        assert end(process, signal.SIGTERM).status == 0
        assert list(lines)[-1]["type"] in ("decoded", "health")
    assert after["camera"]["exposure_us"] < before["camera"]["exposure_us"]
    assert after["pid"] == before["pid"]
    assert not path.exists()


def test_a_client_hears_what_became_of_a_reload(tmp_path: Path) -> None:
    """The mistake, or that the new configuration is in force."""
    config, path = tmp_path / "config.yaml", tmp_path / "tap.sock"
    text = "panels: {side_m: 0.16}\n" + SIMULATED_YAML
    config.write_text(text, encoding="utf-8")
    with daemon(at(path), options=("--config", str(config))), reach(path) as client:
        config.write_text(text.replace("0.16", "160"), encoding="utf-8")
        with pytest.raises(TapError, match=r"panels\.side_m: must be in .*; the old configuration stays"):
            client.ask("reload", limit_s())
        config.write_text(text.replace("0.16", "0.158"), encoding="utf-8")
        client.ask("reload", limit_s())
        assert client.ask("config", limit_s())["values"]["panels.side_m"] == 0.158
        client.ask("reload", limit_s())  # of the next daemon, too


def test_a_reload_may_move_the_socket(tmp_path: Path) -> None:
    """The old one is gone when the new one answers; a place that cannot be leaves all as it was."""
    config, places = tmp_path / "config.yaml", [tmp_path / f"{name}.sock" for name in ("first", "second")]
    (tmp_path / "mine").write_text("mine", encoding="utf-8")
    text = "panels: {side_m: 0.16}\n" + SIMULATED_YAML + "tap: {socket: %s}\n"
    config.write_text(text % "first.sock", encoding="utf-8")
    with daemon(options=("--config", str(config))) as process:
        reach(places[0]).close()
        config.write_text(text % "mine", encoding="utf-8")
        process.send_signal(signal.SIGHUP)
        with reach(places[0]) as client:
            lines = client.lines()
            refused = next(
                line for line in lines if line["type"] == "health" and "reload_refused" in str(line["faults"])
            )
        config.write_text(text % "second.sock", encoding="utf-8")
        process.send_signal(signal.SIGHUP)
        reach(places[1]).close()
        assert not places[0].exists()
    assert "is no socket" in str(refused["faults"])
    assert (tmp_path / "mine").read_text(encoding="utf-8") == "mine"


def test_a_reload_makes_a_socket_that_was_cleared_away_again(tmp_path: Path) -> None:
    """As by what clears /tmp now and then: nobody could reach the daemon any more."""
    config, path = tmp_path / "config.yaml", tmp_path / "tap.sock"
    config.write_text("panels: {side_m: 0.16}\ncamera: {source: simulated}\n", encoding="utf-8")
    with daemon(at(path), options=("--config", str(config))) as process:
        reach(path).close()
        path.unlink()
        process.send_signal(signal.SIGHUP)
        with reach(path) as client:
            assert next(client.lines())["type"] == "hello"
        assert end(process, signal.SIGTERM).status == 0
    assert not path.exists()


def test_where_auto_finds_no_place_the_daemon_runs_without(tmp_path: Path) -> None:
    """The poses matter more; it says so once."""
    (tmp_path / "ledpi").write_text("in the way", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        with daemon(*SIMULATED, options=("--unpaced", "--frames", "20")) as process:
            ended = end(process)
    assert ended.status == 0
    assert len([line for line in ended.log if "WARNING tap_off" in line]) == 1


# ---- Who reads it


def test_monitor_shows_a_line_for_each_panel(running: Path) -> None:
    """ID, distance, yaw, age, rate, margin; and how the daemon is."""
    done = ledpi("monitor", "--tap", str(running), "--seconds", "3")
    assert (done.returncode, done.stderr) == (0, "")
    row = re.search(r"^ *7 +([\d.]+) m +([-+\d.]+)° +\d+ ms +\d+/s +\d+$", done.stdout, re.MULTILINE)
    assert row is not None, done.stdout
    assert float(row[1]) == pytest.approx(1.0, abs=0.05)
    assert abs(float(row[2])) == pytest.approx(20.0, abs=2.0)
    assert "no fix: " in done.stdout
    assert re.search(r"\d+ frames/s, \d+ decoded/s, \d+ dropped", done.stdout)
    assert "no port" in done.stdout


def test_monitor_prints_a_line_a_second_into_a_pipe(running: Path) -> None:
    """Prints what it sees, why there is no fix, and how the daemon is; the table comes at the end."""
    done = ledpi("monitor", "--tap", str(running), "--seconds", "4")
    lines = [line for line in done.stdout.splitlines() if re.match(r"ID 7 1\.0\d\d m [-+][\d.]+° \| no fix: ", line)]
    assert 2 <= len(lines) <= 5, done.stdout
    assert re.search(r"\| (running|camera lost)", lines[-1])  # a busy machine's camera may be late for a moment


def test_monitor_without_a_daemon_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line and exit status 2."""
    run = in_process(monkeypatch, capsys, "monitor")
    for options in ((), ("--json",)):
        said = complaint(run("--tap", tmp_path / "tap.sock", *options))
        assert "no running daemon answers" in said
        assert "start `ledpi run`" in said


def test_snapshot_takes_the_daemons_frame_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without PATH; it needs no configuration of its own."""
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    with daemon(*SIMULATED) as process:
        reach(tmp_path / "run/ledpi/tap.sock").close()
        done = ledpi("snapshot", "--out", "x.png", cwd=tmp_path)
        assert re.match(rf"x.png: running daemon \(pid {process.pid}\), frame \d+: ID \d+ at .* m, margin", done.stdout)
        assert (tmp_path / "x.png").stat().st_size > 10_000


def test_snapshot_of_the_camera_itself_asks_no_daemon(
    running: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Takes a frame's number, or another configuration than the daemon's for that."""
    (tmp_path / "ledpi").mkdir(mode=0o700)
    (tmp_path / "ledpi/tap.sock").symlink_to(running)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    config = tmp_path / "config.yaml"
    config.write_text("panels: {side_m: 0.16}\n" + SIMULATED_YAML, encoding="utf-8")
    for asks in (("--frame", "3"), ()):
        done = ledpi("snapshot", "--config", str(config), *asks, "--out", str(tmp_path / "x.png"))
        assert "x.png: simulated, frame" in done.stdout


# ---- The page's own lines


def page_block(language: str, containing: str) -> str:
    page = (ROOT / "docs/tap.md").read_text(encoding="utf-8")
    (block,) = (text for text in re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL) if containing in text)
    return str(block)


def test_the_pages_ten_lines_of_python_read_it(running: Path) -> None:
    """As printed, but for the socket's place; without ledpi."""
    script = page_block("python", "makefile")
    assert len(script.strip().splitlines()) == 10
    assert "ledpi." not in script
    script = script.replace("/run/ledpi/tap.sock", str(running))
    process = subprocess.Popen([sys.executable, "-u", "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert re.fullmatch(r"\d+ 7 \[.*\]\n", process.stdout.readline())
    process.kill()
    process.communicate()


def test_the_pages_lines_with_the_client_read_it(running: Path) -> None:
    """As printed, with the socket's place."""
    script = page_block("python", "connect_tap").replace("connect_tap()", f"connect_tap({str(running)!r})")
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30))
    assert re.match(r"\d+ [\d.]+ \[", done.stdout), done.stderr


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_the_pages_line_for_curl_reads_it(running: Path) -> None:
    """As printed, until the first line has come."""
    page = (ROOT / "docs/tap.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^    (curl .*)$", page, re.MULTILINE)
    command = command.replace("/run/ledpi/tap.sock", str(running)) + " --max-count=1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=limit_s(30))
    assert json.loads(done.stdout)["markers"][0]["id"] == 7


def test_the_page_names_every_key(running: Path) -> None:
    """Looks at each kind of line."""
    page = (ROOT / "docs/tap.md").read_text(encoding="utf-8")
    with connect(running) as client:
        health = next(line for line in client.lines() if line["type"] == "health")
        picture = client.picture("rejected", "evidence")
    keys = {*client.hello, *client.hello["camera"], *client.hello["panels"], *health, *health["wire"], *picture}
    keys |= {*picture["looks"][0], *(picture["decoded"].keys() - {"type"})}
    documented_with_decode = {"seq", "decode_ms", "markers", "robot"}
    named = set(re.findall(r"[`\"]([a-z_]+)[`\"]", page)) | documented_with_decode | {"pixels"}
    assert keys - named == set()


@pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile
def test_poses_leave_as_soon_with_a_crowd_as_without(tmp_path: Path) -> None:
    """Two that watch with pictures, ten that ask and never read, one that sends garbage: in turns with none of them."""
    write_recording(tmp_path / "take", 120)
    path = tmp_path / "tap.sock"
    taken: dict[bool, list[int]] = {False: [], True: []}
    with (
        controller() as line,
        daemon(
            f"camera.source=recording:{tmp_path / 'take'}",
            f"serial.port={line.port}",
            at(path),
            options=("--frames", "1000000"),
        ) as process,
    ):
        reach(path).close()
        line.wait_for(lambda line: len(line.markers) > 30)
        for crowded in (False, True) * 3:
            ending = threading.Event()
            crowd = [threading.Thread(target=watch, args=(path, ending)) for _ in range(2 * crowded)]
            for thread in crowd:
                thread.start()
            stalled = [stall(path) for _ in range(10 * crowded)]
            seen = len(line.markers)
            line.wait_for(lambda line, seen=seen: len(line.markers) > seen + 60)  # type: ignore[misc]
            taken[crowded] += [marker.age_us for marker in line.markers[seen:]]
            ending.set()
            for thread in crowd:
                thread.join()
            for client in stalled:
                client.close()
        assert process.poll() is None
    assert median(taken[True]) < 1.3 * median(taken[False]) + 1000


def watch(path: Path, ending: threading.Event) -> None:
    """As a page does, as often as it is served."""
    with connect(path) as client:
        while not ending.is_set():
            client.picture("rejected", "evidence")


def stall(path: Path) -> Raw:
    """Asks for more than it can get, and for nonsense, and reads nothing."""
    client = Raw(path)
    for number in range(20):
        client.send({"do": "picture", "id": number})
    client.send(b"nonsense\n")
    return client
