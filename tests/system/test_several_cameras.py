"""Two cameras on one machine: a daemon each, and nothing that they share by accident."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.request import ProxyHandler, Request, build_opener

import pytest

from ledpi.camera.factory import open_camera
from ledpi.camera.picamera import model_of
from ledpi.config.settings import load_config
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.daemon.tap.client import connect
from ledpi.daemon.tap.of_config import of_config
from tests.builders import ROOT
from tests.builders.bridges import free_port
from tests.builders.command import LEDPI
from tests.builders.daemon import COMMAND, SIMULATED, SIMULATED_YAML, daemon, wait_for_log
from tests.builders.systemd import assert_closed_in, needs_systemd, said_of
from tests.builders.tap import reach
from tests.builders.waiting import limit_s, wait_until
from tests.system.test_install import FUNCTIONS

NAMES = ("front", "rear")
SIDES_M = {"front": 0.16, "rear": 0.2}  # which tells them apart


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, Path]:
    """The folders that systemd gives each: one for its tap and one for its takes."""
    for name in NAMES:
        for kind in ("run", "takes"):
            (tmp_path / f"{kind}-{name}").mkdir(mode=0o700)
    return {name: tmp_path / f"run-{name}" for name in NAMES}


@pytest.fixture
def both(folders: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Path]]:
    """Two simulated cameras, with tap.socket: auto; the taps."""
    with ExitStack() as stack:
        for name in NAMES:
            monkeypatch.setenv("RUNTIME_DIRECTORY", str(folders[name]))
            monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / f"takes-{name}"))
            settings = (*SIMULATED, f"panels.side_m={SIDES_M[name]}", "serial.port=null")
            stack.enter_context(daemon(*settings))
        taps = {name: folder / "tap.sock" for name, folder in folders.items()}
        for tap in taps.values():
            reach(tap).close()
        yield taps


@pytest.mark.slow
def test_taps_and_takes_are_apart(both: dict[str, Path], tmp_path: Path) -> None:
    """Each client gets its own camera; each save lies in its own folder."""
    pids = set()
    for name, tap in both.items():
        with connect(tap) as client:
            pids.add(client.hello["pid"])
            assert client.hello["panels"]["side_m"] == SIDES_M[name]
            wait_until(lambda client=client: "pixels" in client.picture(timeout_s=limit_s()))  # a frame is kept
            path = Path(client.ask("save", timeout_s=limit_s())["path"])
            assert path.parent == tmp_path / f"takes-{name}"
    assert len(pids) == 2


@pytest.mark.slow
def test_both_pages_are_open_at_a_time(both: dict[str, Path]) -> None:
    """Each shows its own camera."""
    with ExitStack() as stack:
        for name, tap in both.items():
            port = free_port()
            command = [*LEDPI, "view", "--set", f"view.listen=127.0.0.1:{port}", "--set", f"tap.socket={tap}"]
            page = stack.enter_context(subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True))
            stack.callback(page.kill)
            assert page.stdout is not None
            found = re.match(rf"open http://127.0.0.1:{port}/#token=(\S+)", page.stdout.readline())
            assert found is not None
            assert shown(port, found[1])["panels"]["side_m"] == SIDES_M[name]


@pytest.mark.slow
def test_a_bridge_sends_nothing_of_another_cameras_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two are started by hand, and the second one's tap is off: its poses would be the first one's."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for name in NAMES:
        outputs = "{far: {kind: stdout}}"
        (tmp_path / f"{name}.yaml").write_text(
            f"{SIMULATED_YAML}panels: {{side_m: 0.16}}\nserial: {{port: null}}\noutputs: {outputs}\n", encoding="utf-8"
        )
    run = [*COMMAND, "--config", str(tmp_path / "front.yaml")]
    with daemon(command=run) as front:
        wait_for_log(front, "tap=")
        told = {}
        for name, sign in (("front", "target_open"), ("rear", "other_daemon")):
            command = [*LEDPI, "bridge", "far", "--config", str(tmp_path / f"{name}.yaml")]
            with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as one:
                said = wait_for_log(one, sign)
                assert one.stdout is not None
                while name == "front" and json.loads(one.stdout.readline())["type"] != "decoded":
                    pass  # there are frames to send
                one.terminate()
                output, log = one.communicate(timeout=limit_s())
                told[name] = (said, log.splitlines()[-1], '"decoded"' in output)
    assert " sent=0 " not in told["front"][1]
    assert f"is of the daemon with {tmp_path}/front.yaml, not {tmp_path}/rear.yaml" in told["rear"][0]
    assert " sent=0 " in told["rear"][1]
    assert not told["rear"][2]


def shown(port: int, token: str) -> dict[str, Any]:
    """Returns what a page says of its daemon, as soon as it has one."""
    asked = Request(f"http://127.0.0.1:{port}/api/state", headers={"Authorization": f"Bearer {token}"})

    def told() -> dict[str, Any] | None:
        with build_opener(ProxyHandler({})).open(asked, timeout=limit_s()) as answer:
            found: dict[str, Any] | None = json.loads(answer.read())["daemon"]
            return found

    return wait_until(told, "a daemon on its page") or {}


def test_a_services_configuration_leads_to_its_own_tap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """/etc/ledpi/front.yaml to ledpi@front's; any other file as ever, and a path that is given as it is."""
    monkeypatch.setattr("ledpi.daemon.tap.of_config.CAMERAS", tmp_path)
    for name, text, wanted in (
        ("front", "", "/run/ledpi-front/tap.sock"),
        ("config", "", "auto"),
        ("rear", "tap: {socket: /x/tap.sock}\n", "/x/tap.sock"),
        ("side", "tap: {socket: null}\n", None),
    ):
        path = tmp_path / f"{name}.yaml"
        path.write_text(f"panels: {{side_m: 0.16}}\n{text}", encoding="utf-8")
        assert of_config(load_config(path)) == wanted
    (tmp_path / "elsewhere").mkdir()
    path = tmp_path / "elsewhere/front.yaml"
    path.write_text("panels: {side_m: 0.16}\n", encoding="utf-8")
    assert of_config(load_config(path)) == "auto"


@pytest.mark.parametrize("unit", ["ledpi.service", "ledpi-view.service"])
def test_the_units_of_several_cameras_differ_in_names_alone(unit: str) -> None:
    """Configuration, user, tap, takes and token have the camera's name in them; every other line is the same."""
    text = (ROOT / "systemd" / unit).read_text(encoding="utf-8")
    made = for_several(text).splitlines()
    changed = {new for old, new in zip(text.splitlines(), made, strict=True) if old != new and not new.startswith("#")}
    keys = {line.partition("=")[0] for line in changed}
    own = "RuntimeDirectory" if unit == "ledpi.service" else "After"
    assert keys == {"Description", "ExecStart", "User", "StateDirectory", own}
    assert all("%i" in line for line in changed)
    assert "/etc/ledpi/config.yaml" not in "\n".join(made)


@needs_systemd
@pytest.mark.parametrize("unit", ["ledpi.service", "ledpi-view.service"])
def test_the_units_of_several_cameras_are_clean_and_closed_in(unit: str, tmp_path: Path) -> None:
    """As systemd reads them."""
    text = for_several((ROOT / "systemd" / unit).read_text(encoding="utf-8"))
    path = tmp_path / unit.replace(".service", "@front.service")
    path.write_text(text.replace("/usr/local/bin/ledpi ", "/bin/true "), encoding="utf-8")
    assert said_of(path) == ""
    assert_closed_in(path)


def for_several(text: str) -> str:
    """By the installer's own function."""
    done = subprocess.run(
        ["bash", "-c", FUNCTIONS + "for_several"],
        input=text,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ,
    )
    return done.stdout


def test_a_v4l2_camera_may_be_named_by_a_link(tmp_path: Path) -> None:
    """As those below /dev/v4l/by-id; what it leads to is opened."""
    link = tmp_path / "usb-camera-index0"
    link.symlink_to("/dev/null")
    given = ("panels.side_m=0.16", f"camera.source=v4l2:{link}", "camera.row_time_us=30")
    with pytest.raises(CameraError, match=rf"{link} is no video device"):
        open_camera(load_config(None, given))


def test_a_pi_camera_is_named_by_picamera2s_number() -> None:
    """libcamera lists them in any order; picamera2 sorts by id, the last first. One that is not there is told."""

    class Model:
        name = "Model"

    def camera(name: str, model: str) -> Any:
        return SimpleNamespace(id=name, properties={Model(): model})

    found = [camera("/base/i2c@70000/ov5647@36", "ov5647"), camera("/base/i2c@88000/imx219@10", "imx219")]
    manager = SimpleNamespace(singleton=lambda: SimpleNamespace(cameras=found))
    libcamera: Any = SimpleNamespace(CameraManager=manager)
    assert [model_of(libcamera, number) for number in (0, 1)] == ["imx219", "ov5647"]
    with pytest.raises(
        CameraLostError, match=r"picamera2:2: .* there is picamera2:0 \(imx219\), picamera2:1 \(ov5647\)"
    ):
        model_of(libcamera, 2)
    assert load_config(None, ("panels.side_m=0.16", "camera.source=picamera2:1")).camera.source == "picamera2:1"
