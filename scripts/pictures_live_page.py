"""The pictures of the live page in docs/pictures: daemons on simulated cameras, `ledpi view`, Debian's Chromium."""

from __future__ import annotations

import base64
import io
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

from tests.builders.view import PHONE, browser, ended, start_daemon, start_still_daemon, view
from tests.builders.waiting import wait_until

SHOW_S = 14.0  # of the drive, for a track and some points in the charts


def draw(into: Path) -> None:
    """Light on a computer, dark on a phone; and why a panel with swapped frequencies is not read. Into a folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ended(start_daemon(folder)), view(folder) as page:
            with browser((1280, 900)) as chromium:
                write(into / "view-desktop.png", shoot(chromium, page.address, "light", SHOW_S))
            with browser(PHONE, phone=True) as chromium:
                write(into / "view-phone.png", shoot(chromium, page.address, "dark", 4.0))

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ended(start_still_daemon(folder, "swapped")), view(folder) as page, browser((1280, 1010)) as chromium:
            shoot(chromium, page.address, "light", 0.0, panels=1)
            chromium.execute_script("document.querySelector('input[value=whynot]').click()")
            wait_until(lambda: "swapped" in chromium.find_element("id", "reasons").text, "the reason")
            write(into / "view-why-not.png", shot(chromium))


def shoot(chromium: Any, address: str, colours: str, seconds: float, *, panels: int = 2) -> bytes:
    """The page once it has been watched for so long, as PNG."""
    features = [{"name": "prefers-color-scheme", "value": colours}]
    chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    chromium.get(address)
    wait_until(lambda: chromium.execute_script("return document.querySelector('.panel') !== null"), "a panel")
    time.sleep(seconds)
    count = "return document.querySelectorAll('polygon.panel').length"
    wait_until(lambda: chromium.execute_script(count) >= panels, "panels")
    return shot(chromium)


def shot(chromium: Any) -> bytes:
    """As it is now, as PNG."""
    return base64.b64decode(chromium.get_screenshot_as_base64())


def write(path: Path, png: bytes) -> None:
    """In 256 colours, which are enough, and a third of the bytes."""
    picture = Image.open(io.BytesIO(png)).convert("RGB").quantize(256, kmeans=3, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    print(f"{path}: {picture.width} × {picture.height}, {path.stat().st_size} bytes")
