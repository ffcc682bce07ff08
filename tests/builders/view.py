"""The live page as its user has it: a daemon on the simulated drive, `ledpi view`, and Debian's Chromium."""

from __future__ import annotations

import http.client
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import ProxyHandler, Request, build_opener

from ledpi.camera.simulate.scenes import drive_map
from ledpi.config.map_yaml import map_text
from ledpi.page.connections import MOST
from ledpi.page.pictures import KINDS
from tests.builders.waiting import limit_s

REPOSITORY = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-c", "from ledpi.cli import main; main()"]
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
PHONE = (360, 740)


@dataclass(frozen=True)
class Page:
    """A page: where `ledpi view` serves, and the token that it has printed."""

    process: subprocess.Popen[str]
    address: str  # with the token
    port: int
    token: str

    def ask(self, path: str) -> Any:
        """A JSON answer of the page's server."""
        return json.loads(self.asked(path))

    def asked(self, path: str) -> bytes:
        """The answer as it comes."""
        request = Request(f"http://127.0.0.1:{self.port}{path}", headers={"Authorization": f"Bearer {self.token}"})
        with build_opener(ProxyHandler({})).open(request, timeout=limit_s()) as answer:
            return bytes(answer.read())

    @property
    def resident_mb(self) -> float:
        """Returns what the process holds of the machine's memory."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1024


def watched(page: Page, viewers: int, seconds: float, pause_s: float = 0.0) -> list[int]:
    """Counts the pictures that each of so many viewers gets, one after the other of one kind; `pause_s` between two.

    It lasts longer where by then not all that have a place have seen something.
    """
    began_s, got = time.monotonic(), [0] * viewers

    def is_on() -> bool:
        lasted_s, served = time.monotonic() - began_s, sum(count > 0 for count in got)
        return lasted_s < seconds or (served < min(viewers, MOST) and lasted_s < seconds + limit_s())

    def watch(viewer: int) -> None:
        kind, headers = KINDS[viewer % len(KINDS)], {"Authorization": f"Bearer {page.token}"}
        while is_on():
            connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=limit_s())
            with suppress(OSError, http.client.HTTPException):  # there are fewer places than viewers
                while is_on():
                    connection.request("GET", f"/api/frame?kind={kind}", headers=headers)
                    answer = connection.getresponse()
                    answer.read()
                    got[viewer] += answer.status == 200
                    time.sleep(pause_s)
            connection.close()
            time.sleep(0.2)

    threads = [threading.Thread(target=watch, args=(k,), daemon=True) for k in range(viewers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return got


@contextmanager
def ended(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Killed when the block is left, if it still runs."""
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def start_daemon(folder: Path, *settings: str) -> subprocess.Popen[str]:
    """`ledpi run` on the simulated drive with its map; the tap is `folder`/tap.sock."""
    (folder / "markers.yaml").write_text(map_text(drive_map(), "The drive."), encoding="utf-8")
    given = ("panels.side_m=0.16", "camera.source=simulated", f"map={folder}/markers.yaml", *settings)
    given += (f"serial.port={folder}/none", f"tap.socket={folder}/tap.sock")
    return _start([*COMMAND, "run", *(part for item in given for part in ("--set", item))], folder)


def start_still_daemon(folder: Path, fault: str) -> subprocess.Popen[str]:
    """A daemon on a camera at rest, of which one panel has a fault of `tests.builders.faults`."""
    return _start([sys.executable, "-m", "tests.builders.still_daemon", str(folder), fault], REPOSITORY, folder)


def _start(command: list[str], at: Path, folder: Path | None = None) -> subprocess.Popen[str]:
    """Starts it; what it saves is saved in `folder`, where nobody's own recordings are."""
    environment = os.environ | {"XDG_STATE_HOME": str((folder or at) / "state")}
    return subprocess.Popen(command, cwd=at, env=environment, stderr=subprocess.DEVNULL, text=True)


@contextmanager
def view(folder: Path, *settings: str, before: Sequence[str] = ()) -> Iterator[Page]:
    """`ledpi view` of the daemon whose tap is in `folder`, at any free port. `before` its command stands another."""
    given = (f"tap.socket={folder}/tap.sock", "view.listen=127.0.0.1:0", *settings)
    options = [part for item in given for part in ("--set", item)]
    command = [*before, *COMMAND, "view", *options]
    with ended(subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        found = re.fullmatch(r"open (http://\S+:(\d+)/#token=(\S+))\n", said)
        assert found is not None, said
        yield Page(process, found[1], int(found[2]), found[3])


@contextmanager
def browser(size: tuple[int, int] = (1280, 900), *, phone: bool = False, dark: bool = False) -> Iterator[Any]:
    """Headless Chromium with a window of that size; `phone`: a touch screen, as wide as `size` says."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    # As root, and where /dev/shm is small, as in a container. It asks nobody for updates or names.
    for argument in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "disable-gpu", "no-proxy-server"):
        options.add_argument(f"--{argument}")
    options.add_argument("--disable-background-networking")
    options.add_argument(f"--window-size={size[0]},{size[1]}")
    if dark:
        options.add_argument("--force-dark-mode")
    if phone:
        metrics = {"width": size[0], "height": size[1], "pixelRatio": 2.0}
        options.add_experimental_option("mobileEmulation", {"deviceMetrics": metrics})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=str(DRIVER)))
    try:
        driver.set_script_timeout(limit_s())
        yield driver
    finally:
        with suppress(Exception):  # one that has crashed cannot be told to end
            driver.quit()
