"""The pictures of the live page in docs/pictures: a daemon on the simulated drive, `ledpi view`, Debian's Chromium."""

from __future__ import annotations

import argparse
import base64
import io
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from view_material import PHONE, browser, ended, start_daemon, view, wait_for  # noqa: E402

SHOW_S = 14.0  # of the drive, for a track and some points in the charts
MAX_BYTES = 200_000


def main() -> int:
    """Exit status 0 if both pictures are there, and none is too large."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--kind", default="plain", choices=("plain", "bands", "whynot"))
    parser.add_argument(
        "--dark", action="store_true", help="the phone's picture in light colours, the desktop's in dark"
    )
    arguments = parser.parse_args()
    out: Path = arguments.out
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ended(start_daemon(folder)), view(folder) as page:
            for file, size, phone in (("desktop", (1280, 900), False), ("phone", PHONE, True)):
                with browser(size, phone=phone) as chromium:
                    colours = "dark" if arguments.dark != phone else "light"
                    shown = shoot(chromium, page.address, arguments.kind, colours, SHOW_S if not phone else 4.0)
                    write(out / f"view-{file}.png", shown)
    return 0 if all((out / f"view-{file}.png").stat().st_size < MAX_BYTES for file in ("desktop", "phone")) else 1


def shoot(chromium: Any, address: str, kind: str, colours: str, seconds: float) -> bytes:
    """The page once it has been watched for so long, as PNG."""
    features = [{"name": "prefers-color-scheme", "value": colours}]
    chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    chromium.get(address)
    wait_for(lambda: chromium.execute_script("return document.querySelector('.panel') !== null"), "a panel")
    chromium.execute_script(f"document.querySelector('input[value={kind}]').click()")
    time.sleep(seconds)
    wait_for(lambda: chromium.execute_script("return document.querySelectorAll('polygon.panel').length > 1"), "panels")
    return base64.b64decode(chromium.get_screenshot_as_base64())


def write(path: Path, png: bytes) -> None:
    """In 256 colours, which are enough, and a third of the bytes."""
    picture = Image.open(io.BytesIO(png)).convert("RGB").quantize(256, kmeans=3, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    print(f"{path}: {picture.width} × {picture.height}, {path.stat().st_size} bytes")


if __name__ == "__main__":
    sys.exit(main())
