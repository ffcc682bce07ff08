"""`ledpi config`, `backup` and `restore`: a configuration is written, shown, checked, changed, saved and put back."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from ledpi.config.settings import load_config
from ledpi.workshop import backup
from tests.builders import ROOT
from tests.builders.certificates import AUTHORITY
from tests.builders.command import LEDPI, complaint, in_process

LENS = """image_width: 640
image_height: 480
camera_matrix: {data: [640, 0, 320, 0, 640, 240, 0, 0, 1]}
distortion_coefficients: {data: [0, 0, 0, 0, 0]}
"""
MAP = "panels: {7: {position_m: [0, 0, 2], quaternion_wxyz: [1, 0, 0, 0]}}\n"
RULE = (ROOT / "systemd/61-ledpi.rules").read_text().replace("# ENV", "ENV").replace("75833353035351E0D1A1", "A5-1")


class Done(NamedTuple):
    """The results of a command."""

    status: int
    out: str
    err: str


Ledpi = Callable[..., Done]


@pytest.fixture
def ledpi(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Ledpi:
    run = in_process(monkeypatch, capsys)
    return lambda *arguments: Done(*run(*arguments))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, and no service's configuration."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ledpi.config.settings.SEARCH_PATH", (Path("config.yaml"),))
    monkeypatch.setattr(backup, "RULES", tmp_path / "rules.d")
    return tmp_path


# ---- init


def test_init_writes_every_key_with_its_comment(here: Path, ledpi: Ledpi) -> None:
    """The file that the project shows, and the next step."""
    done = ledpi("config", "init")
    assert done.status == 0
    assert (here / "config.yaml").read_text() == (ROOT / "config.yaml").read_text()
    assert "ledpi config set panels.side_m=" in done.out


def test_init_sets_what_it_is_told(here: Path, ledpi: Ledpi) -> None:
    """With all comments; and copies what belongs to the service."""
    assert ledpi("config", "init", "--set", "panels.ids=[7, 23]", "--files", "extra").status == 0
    text = (here / "config.yaml").read_text()
    assert "ids: [7, 23]" in text
    assert text.count("#") == (ROOT / "config.yaml").read_text().count("#")
    assert (here / "extra/systemd/ledpi.service").read_bytes() == (ROOT / "systemd/ledpi.service").read_bytes()
    assert (here / "extra/examples/linux_robot.py").exists()


def test_init_overwrites_nothing(here: Path, ledpi: Ledpi) -> None:
    """Neither a file nor a folder, and writes no configuration that is wrong."""
    (here / "config.yaml").write_text("mine")
    assert "is there already" in complaint(ledpi("config", "init"))
    assert (here / "config.yaml").read_text() == "mine"
    assert "panels.side_m: must be in metres" in complaint(
        ledpi("config", "init", "new.yaml", "--set", "panels.side_m=160")
    )
    assert "no folder" in complaint(ledpi("config", "init", "nowhere/new.yaml"))
    assert [path.name for path in here.iterdir()] == ["config.yaml"]


@pytest.mark.slow
@pytest.mark.parametrize("command", [("run",), ("config", "show"), ("config", "check"), ("backup", "b"), ("doctor",)])
def test_without_a_configuration_init_is_named(command: tuple[str, ...], ledpi: Ledpi) -> None:
    """By every command that needs one."""
    done = ledpi(*command)
    assert "`ledpi config init` writes one" in done.out + done.err


# ---- show


def test_show_says_where_each_value_is_from(here: Path, ledpi: Ledpi) -> None:
    """The file, --set or the default; a token is not shown."""
    (here / "config.yaml").write_text("panels: {side_m: 0.2}\nview: {token: abcdefghijkl}\n")
    done = ledpi("config", "show", "--set", "serial.baud=9600")
    rows = {line.split()[0]: line.split(maxsplit=1)[1] for line in done.out.splitlines()}
    assert rows["panels.side_m"].split() == ["0.2", str(here / "config.yaml")]
    assert rows["serial.baud"].split() == ["9600", "--set"]
    assert rows["panels.duty"].split() == ["0.5", "default"]
    assert "abcdefghijkl" not in done.out
    told = json.loads(ledpi("config", "show", "--json").out)
    assert told["panels.side_m"] == {"value": 0.2, "from": str(here / "config.yaml")}


# ---- check


def test_check_tells_all_mistakes_at_once(here: Path, ledpi: Ledpi) -> None:
    """Each with the file and the key; a misspelt key first, as it may be the cause of another."""
    (here / "config.yaml").write_text("panel: {}\ncamera: {width: 3, exposure_us: long}\npanels: {side_m: 160}\n")
    done = ledpi("config", "check")
    assert done.status == 2
    lines = done.out.splitlines()
    assert lines[0].startswith("config.yaml: panel: unknown key; did you mean panels?")
    assert [line.split(": ")[1] for line in lines[1:-1]] == ["camera.width", "camera.exposure_us", "panels.side_m"]
    assert lines[-1] == "config.yaml: 4 mistakes"


def test_check_looks_into_the_files_that_are_named(here: Path, ledpi: Ledpi) -> None:
    """And at values that contradict each other."""
    (here / "config.yaml").write_text("panels: {side_m: 0.16, ids: [77]}\nmap: m.yaml\ncamera: {intrinsics: c.yaml}\n")
    said = ledpi("config", "check").out
    assert "panels.ids: DICT_4X4_50 has only the IDs 0 to 49, not 77" in said
    assert f"{here}/m.yaml: cannot be read" in said
    assert f"{here}/c.yaml: cannot be read" in said
    (here / "config.yaml").write_text("panels: {side_m: 0.16}\nmap: m.yaml\ncamera: {intrinsics: c.yaml}\n")
    (here / "m.yaml").write_text(MAP)
    (here / "c.yaml").write_text(LENS)
    done = ledpi("config", "check")
    assert (done.status, done.out) == (0, "config.yaml: OK\n")


def test_check_looks_into_the_files_of_outputs(here: Path, ledpi: Ledpi) -> None:
    """A bridge would find it only when it starts."""
    output = "{kind: mqtt, host: x, tls: true, ca_file: ca.pem, user: u, password_file: p}"
    (here / "config.yaml").write_text(f"panels: {{side_m: 0.16}}\noutputs: {{b: {output}}}\n")
    (here / "ca.pem").write_text("none")
    said = ledpi("config", "check").out
    assert f"outputs.b.ca_file: {here}/ca.pem: no certificates can be read from it" in said
    assert f"outputs.b.password_file: {here}/p: cannot be read: No such file" in said
    (here / "ca.pem").write_text(AUTHORITY)
    (here / "p").write_text("secret")
    assert "outputs.b.password_file: " in ledpi("config", "check").out  # everybody may read it
    (here / "p").chmod(0o640)
    assert ledpi("config", "check").status == 0


# ---- set


def test_set_changes_keys_and_nothing_else(here: Path, ledpi: Ledpi) -> None:
    """Comments stay, and so does the older file."""
    ledpi("config", "init")
    before = (here / "config.yaml").read_text()
    done = ledpi("config", "set", "panels.side_m=0.158", "panels.overrides.7.black_hz=1262", "panels.ids=[7]")
    assert done.status == 0, done.err
    after = (here / "config.yaml").read_text()
    assert [line for line in before.splitlines() if line not in after.splitlines()] == [
        line for line in before.splitlines() if line.startswith(("  side_m:", "  ids:", "  overrides:"))
    ]
    assert load_config(Path("config.yaml")).panels.spec(7).black_hz == 1262
    assert (here / "config.yaml.bak-1").read_text() == before
    assert "systemctl" not in done.out


def test_after_a_change_of_the_services_file_the_service_must_read_it(
    here: Path, ledpi: Ledpi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command says so."""
    monkeypatch.setattr("ledpi.cli.config.SERVICE_FILE", here / "config.yaml")
    ledpi("config", "init")
    assert ledpi("config", "set", "panels.ids=[7]").out.splitlines()[-1] == "Next: sudo systemctl reload ledpi"


@pytest.mark.parametrize(
    ("item", "said"),
    [
        ("panels.side=0.2", "panels.side: unknown key; did you mean side_m?"),
        ("panels.side_m=160", "must be in metres"),
        ("panels.ids=[99]", "has only the IDs 0 to 49"),
        ("panels.side_m", "must be KEY=VALUE"),
    ],
)
def test_set_writes_nothing_that_is_wrong(here: Path, item: str, said: str, ledpi: Ledpi) -> None:
    """Though another key of the same call is right."""
    ledpi("config", "init")
    before = (here / "config.yaml").read_bytes()
    assert said in complaint(ledpi("config", "set", "serial.baud=9600", item))
    assert (here / "config.yaml").read_bytes() == before
    assert not (here / "config.yaml.bak-1").exists()


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("unshare") is None, reason="not root, or not installed: unshare")
def test_set_says_what_a_reboot_loses(here: Path) -> None:
    """On an overlay whose upper layer is in memory, as raspi-config makes it."""
    script = (
        "mkdir low up etc; mount -t tmpfs none up; mkdir up/u up/w; echo 'panels: {side_m: 0.16}' >low/config.yaml; "
        'mount -t overlay overlay -o lowerdir=low,upperdir=$PWD/up/u,workdir=up/w etc && exec "$@"'
    )
    command = [*LEDPI, "config", "set", "--config", "etc/config.yaml", "panels.ids=[7]"]
    done = subprocess.run(
        ["unshare", "-m", "bash", "-c", script, "", *command],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    if "mount:" in done.stderr:
        pytest.skip("this system mounts no overlay")
    assert "etc/config.yaml: lies on an overlay in memory" in done.stdout


# ---- backup, restore


@pytest.fixture
def robot(here: Path, ledpi: Ledpi) -> Path:
    """A folder with all that a robot has."""
    folder = here / "robot"
    (folder / "lens").mkdir(parents=True)
    (here / "rules.d").mkdir()
    (folder / "config.yaml").write_text(
        "# mine\npanels: {side_m: 0.2, overrides: {7: {black_hz: 1262, measured: 2026-11-25}}}\n"
        "camera: {intrinsics: lens/camera.yaml}\nmap: markers.yaml\n"
        "outputs: {b: {kind: mqtt, host: x, tls: true, ca_file: ca.pem, user: u, password_file: b.password}}\n"
    )
    (folder / "lens/camera.yaml").write_text(LENS)
    (folder / "markers.yaml").write_text(MAP)
    (folder / "config.yaml").chmod(0o600)
    (folder / "markers.yaml").chmod(0o755)
    (folder / "ca.pem").write_text(AUTHORITY)
    (folder / "b.password").write_text("secret")
    (folder / "b.password").chmod(0o600)
    (here / "rules.d/60-ledpi.rules").write_text(RULE)
    assert ledpi("backup", "robot.ledpi", "--config", folder / "config.yaml").status == 0
    return folder


def test_what_was_saved_comes_back_to_the_byte(here: Path, robot: Path, ledpi: Ledpi) -> None:
    """On another computer, say, at another place: lens and map go where the configuration names them.

    What only its owner may read, as for its token, stays so; and nobody runs what an archive says is a program.
    """
    (here / "other/lens").mkdir(parents=True)
    (here / "rules.d/60-ledpi.rules").unlink()
    done = ledpi("restore", "robot.ledpi", "--config", here / "other/config.yaml")
    assert done.status == 0, done.err
    for name in ("config.yaml", "lens/camera.yaml", "markers.yaml", "ca.pem"):
        assert (here / "other" / name).read_bytes() == (robot / name).read_bytes()
        assert (here / "other" / name).stat().st_mode & 0o777 == (0o600 if name == "config.yaml" else 0o644)
    assert (here / "rules.d/60-ledpi.rules").read_text() == RULE
    assert "udevadm control --reload" in done.out
    assert f"Missing: {here}/other/b.password, the password of outputs.b.password_file: sudo install" in done.out
    assert "Everything is there already." in ledpi("restore", "robot.ledpi", "--config", here / "other/config.yaml").out


def test_what_is_replaced_is_kept(here: Path, robot: Path, ledpi: Ledpi) -> None:
    """Beside it; and only its owner reads a backup, as the page's token is in it."""
    (robot / "markers.yaml").write_text("panels: {}\n")
    done = ledpi("restore", "robot.ledpi", "--config", robot / "config.yaml")
    assert done.status == 0, done.err
    assert (robot / "markers.yaml").read_text() == MAP
    assert (robot / "markers.yaml.bak-1").read_text() == "panels: {}\n"
    assert f"{robot}/markers.yaml; the older one is {robot}/markers.yaml.bak-1\n" in done.out
    assert not (robot / "config.yaml.bak-1").exists()  # it was the same
    assert (here / "robot.ledpi").stat().st_mode & 0o077 == 0


def _changed(path: Path, name: str, content: str, method: int = zipfile.ZIP_STORED) -> None:
    """The archive, with another file of this name; packed by this method."""
    with zipfile.ZipFile(path) as archive:
        files = {each: archive.read(each) for each in archive.namelist()}
    with zipfile.ZipFile(path, "w", method) as archive:
        for each, old in (files | {name: content.encode()}).items():
            archive.writestr(each, old)


def test_a_backup_of_a_newer_version_is_named(here: Path, robot: Path, ledpi: Ledpi) -> None:
    """And nothing is written."""
    _changed(here / "robot.ledpi", backup.CONTENTS, '{"ledpi_backup": 2, "ledpi": "9.0.0", "made": "", "files": []}')
    said = complaint(ledpi("restore", "robot.ledpi", "--config", here / "new.yaml"))
    assert "is a backup of version 2, made by ledpi 9.0.0; this ledpi reads version 1" in said
    assert not (here / "new.yaml").exists()


def test_what_is_no_whole_backup_is_refused(here: Path, robot: Path, ledpi: Ledpi) -> None:
    """Cut off, something else, or with a file in it that is wrong: nothing is written."""
    whole = (here / "robot.ledpi").read_bytes()
    (here / "cut").write_bytes(whole[: len(whole) // 2])
    (here / "text").write_text("no archive")
    for name in ("cut", "text"):
        assert "is no whole backup" in complaint(ledpi("restore", name, "--config", here / "new.yaml"))
    _changed(here / "robot.ledpi", "2-markers.yaml", "panels: [")
    assert "not valid YAML" in complaint(ledpi("restore", "robot.ledpi", "--config", here / "new.yaml"))
    _changed(here / "robot.ledpi", "2-markers.yaml", MAP, zipfile.ZIP_BZIP2)  # of 2 kB it may unpack gigabytes at once
    assert "is no whole backup" in complaint(ledpi("restore", "robot.ledpi", "--config", here / "new.yaml"))
    rule = {"kind": "udev rule", "path": "../../passwd", "name": "0-config.yaml"}
    head = json.dumps({"ledpi_backup": 1, "ledpi": "", "made": "", "files": [rule]})
    _changed(here / "robot.ledpi", backup.CONTENTS, head)
    assert "is no whole backup" in complaint(ledpi("restore", "robot.ledpi", "--config", here / "new.yaml"))
    assert not (here / "new.yaml").exists()


@pytest.mark.parametrize(
    ("index", "changes", "said"),
    [
        (1, {"path": "../../escaped.yaml"}, "names no such lens"),
        (1, {"kind": "map"}, "names no such map"),
        (1, {"kind": "map", "path": "markers.yaml"}, "is no whole backup"),  # two for one place
        (4, {"name": "1-camera.yaml"}, "60-ledpi.rules: line 1 is not of ledpi's own udev rule"),
    ],
)
def test_an_archive_writes_nowhere_else(
    index: int, changes: dict[str, str], said: str, here: Path, robot: Path, ledpi: Ledpi
) -> None:
    """Another path than the configuration says, two files for one place, a rule that is none of ours."""
    with zipfile.ZipFile(here / "robot.ledpi") as archive:
        head = json.loads(archive.read(backup.CONTENTS))
    head["files"][index] |= changes
    _changed(here / "robot.ledpi", backup.CONTENTS, json.dumps(head))
    before = sorted(here.rglob("*"))
    assert said in complaint(ledpi("restore", "robot.ledpi", "--config", here / "new/config.yaml"))
    assert sorted(here.rglob("*")) == before


def test_a_configuration_from_an_archive_names_files_below_its_folder(here: Path, robot: Path, ledpi: Ledpi) -> None:
    """As root, else, a lens could be any file of the machine. `backup` leaves such a one out, and says so."""
    outside = here / "outside.yaml"
    outside.write_text(LENS)
    ledpi("config", "set", f"camera.intrinsics={outside}", "--config", robot / "config.yaml")
    said = ledpi("backup", "b", "--config", robot / "config.yaml").out
    assert f"{outside} (camera.intrinsics): is not in the backup, as `ledpi restore` writes only below" in said
    with zipfile.ZipFile(here / "b") as archive:
        head = json.loads(archive.read(backup.CONTENTS))
    head["files"].append({"kind": "lens", "path": str(outside), "name": "lens"})
    _changed(here / "b", backup.CONTENTS, json.dumps(head))
    _changed(here / "b", "lens", LENS)
    outside.unlink()
    assert "camera.intrinsics" in complaint(ledpi("restore", "b", "--config", robot / "config.yaml"))
    assert not outside.exists()


def test_a_backup_of_the_service_has_all_its_cameras_and_units(
    here: Path, robot: Path, ledpi: Ledpi, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each camera's configuration with its lens; what is enabled, and a changed unit, are said."""
    monkeypatch.setattr(backup, "CAMERAS", robot)
    monkeypatch.setattr(backup, "UNITS", here / "system")
    (here / "system/multi-user.target.wants").mkdir(parents=True)
    for name in ("ledpi@front", "ledpi-bridge@b", "ssh"):
        (here / "system/multi-user.target.wants" / f"{name}.service").symlink_to("/nowhere")
    (here / "system/sockets.target.wants").mkdir()
    (here / "system/sockets.target.wants/ledpi-edit.socket").symlink_to("/nowhere")
    (here / "system/ledpi-bridge@b.service.d").mkdir()
    (here / "system/ledpi-bridge@b.service.d/override.conf").touch()
    (robot / "front.yaml").write_text("panels: {side_m: 0.2}\ncamera: {intrinsics: front_lens.yaml}\n")
    (robot / "front_lens.yaml").write_text(LENS)
    (robot / "config.example.yaml").write_text("panels: {side_m: 0.2}\n")
    (robot / "rear.yaml").write_text("panels: {side_m: 200}\n")
    said = ledpi("backup", "all", "--config", robot / "config.yaml").out
    assert "enabled units: ledpi-bridge@b, ledpi-edit.socket, ledpi@front" in said
    assert "override.conf: what you have changed of a unit is not in the backup" in said
    assert "rear.yaml: is not in the backup" in said
    for name in ("front.yaml", "front_lens.yaml", "config.yaml"):
        (robot / name).rename(here / name)
    done = ledpi("restore", "all", "--config", robot / "config.yaml")
    for name in ("front.yaml", "front_lens.yaml"):
        assert (robot / name).read_bytes() == (here / name).read_bytes()
    assert "sudo systemctl enable ledpi-bridge@b ledpi-edit.socket ledpi@front; sudo systemctl restart" in done.out
    assert f"sudo chgrp ledpi {robot}/config.yaml; sudo chmod 640" in done.out  # only root could read it
    assert "certificates" not in done.out  # it was the same
