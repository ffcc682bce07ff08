"""/var/lib/ledpi, into which every member of the group `video` may write: what root writes there goes nowhere else."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ledpi.cli.pictures import write_drawn
from ledpi.workshop.calibrate.files import check_writable, write_keeping_old
from tests.builders.waiting import wait_until

VIDEO, SOMEBODY = 44, 61_234  # the group's number on Debian; a user that need not exist
# Links under every name that root may write to first, at once and wherever one appears.
ATTACK = """
cd "$1" || exit
for name in camera.yaml camera.png shot.png; do ln -s "$2" $name.new; ln -s "$2" .$name.new; done
touch ready
until [ -e "$3" ]; do for name in *.new .*.new; do [ -L "$name" ] || ln -sf "$2" "$name"; done; done
"""

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be another user beside")


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder that everybody can reach, with `shared` as scripts/install makes it, and root's file `secret`."""
    place = Path(tempfile.mkdtemp())
    place.chmod(0o755)
    (place / "secret").write_text("root's own")
    (place / "shared").mkdir()
    os.chown(place / "shared", 0, VIDEO)
    (place / "shared").chmod(0o2775)
    yield place
    shutil.rmtree(place)


@pytest.fixture
def shared(place: Path) -> Iterator[Path]:
    """`shared`, with another user of the group at work in it."""
    command = ["/bin/sh", "-c", ATTACK, "attack", place / "shared", place / "secret", place / "stop"]
    with subprocess.Popen(command, user=SOMEBODY, group=SOMEBODY, extra_groups=[VIDEO]):
        wait_until((place / "shared/ready").exists, "the folder")
        yield place / "shared"
        (place / "stop").touch()  # it ends by itself: killed, the shell leaves an `ln` behind that still writes
    assert (place / "secret").read_text() == "root's own"


@pytest.mark.slow
def test_a_calibration_follows_no_link(shared: Path) -> None:
    """The files are written as ever, and again and again; what the links lead to stays."""
    for number in range(200):
        check_writable(shared / "camera.yaml")
        write_keeping_old(shared / "camera.yaml", f"take: {number}")
        write_keeping_old(shared / "camera.png", b"PNG")
        for kept in shared.glob("*.bak-*"):
            kept.unlink()


def test_a_drawing_follows_no_link(shared: Path) -> None:
    """As of `ledpi snapshot --out` there."""
    for _ in range(50):
        write_drawn(shared / "shot.png", np.zeros((8, 8), np.uint8), "--out")


def test_the_service_may_read_what_is_written(place: Path) -> None:
    """It is another user, too: the file has the rights that the folder and the umask give."""
    write_keeping_old(place / "shared/camera.yaml", "image_width: 640")
    command = ["/bin/cat", str(place / "shared/camera.yaml")]
    read = subprocess.run(command, user=SOMEBODY, group=SOMEBODY, extra_groups=[VIDEO], stdout=-1, check=False)
    assert read.stdout == b"image_width: 640"
