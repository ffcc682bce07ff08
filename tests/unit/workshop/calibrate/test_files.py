"""Files that are replaced: they stay whose and what they were, and nobody's change is lost."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ledpi.core.errors import ConfigError
from ledpi.core.files import read_yaml
from ledpi.workshop.calibrate.files import change_config, write_keeping_old

WRITER = """
import sys; from pathlib import Path; from ledpi.workshop.calibrate.files import change_config
for number in range(int(sys.argv[2])):
    change_config(Path("config.yaml"), {("panels", "overrides", int(sys.argv[1]), f"key_{number}"): number})
    print(number, flush=True)
"""


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "config.yaml"
    path.write_text("panels: {side_m: 0.16}\n")
    return path


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_mode_and_owner_stay(config: Path, umask: int) -> None:
    """A token that only a group may read stays so, and a file that the service reads stays readable."""
    config.chmod(0o640)
    if os.geteuid() == 0:
        os.chown(config, 1234, 4321)
    before = config.stat()
    old = os.umask(umask)
    try:
        change_config(config, {("panels", "ids"): [7]})
    finally:
        os.umask(old)
    for file in (config, config.with_name("config.yaml.bak-1")):
        after = file.stat()
        assert (stat.S_IMODE(after.st_mode), after.st_uid, after.st_gid) == (0o640, before.st_uid, before.st_gid)


def test_a_link_stays_one(config: Path) -> None:
    """The file to which it leads is changed; the older one is a file beside the link."""
    (config.parent / "repo").mkdir()
    real = config.rename(config.parent / "repo/real.yaml")
    config.symlink_to("repo/real.yaml")
    kept = change_config(config, {("panels", "ids"): [7]})
    assert config.is_symlink()
    assert read_yaml(real, ConfigError) == {"panels": {"side_m": 0.16, "ids": [7]}}
    assert kept == config.with_name("config.yaml.bak-1")
    assert not kept.is_symlink()


def test_the_last_five_are_kept(config: Path) -> None:
    """Any number of changes leaves no more."""
    for number in range(8):
        write_keeping_old(config, str(number))
    kept = sorted(config.parent.glob("*.bak-*"))
    assert [(file.name[-1], file.read_text()) for file in kept] == [(str(n), str(n - 2)) for n in range(4, 9)]


def test_who_changes_beside_others_loses_nothing(config: Path) -> None:
    """Each change that was acknowledged is there, though half of the writers were killed; nothing else is left."""
    command = [sys.executable, "-c", WRITER]
    writers = [subprocess.Popen([*command, str(n), "6"], stdout=subprocess.PIPE, text=True) for n in range(4)]
    for killed in writers[::2]:
        assert killed.stdout is not None
        killed.stdout.readline()
        killed.kill()
    acknowledged = [len(writer.communicate()[0].split()) for writer in writers]
    acknowledged = [count + (n % 2 == 0) for n, count in enumerate(acknowledged)]  # the line that was read above
    change_config(config, {("panels", "ids"): [7]})
    overrides = read_yaml(config, ConfigError)["panels"]["overrides"]
    assert [len(overrides[n]) for n in (1, 3)] == [6, 6]
    assert all(len(overrides[n]) >= acknowledged[n] for n in (0, 2))
    assert all(file.name.startswith("config.yaml") for file in config.parent.iterdir())


def test_what_a_killed_writer_left_is_removed(config: Path) -> None:
    """It may hold the page's token. A file of a like name that is not such stays."""
    left, other = config.with_name(".config.yaml.0123456789abcdef.new"), config.with_name(".config.yaml.mine.new")
    left.write_text("view: {token: secret}")
    other.write_text("mine")
    change_config(config, {("panels", "ids"): [7]})
    assert not left.exists()
    assert other.exists()
