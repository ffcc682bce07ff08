"""scripts/install, as far as it goes without changing this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ledpi import __version__
from tests.builders import ROOT

INSTALL = ROOT / "scripts/install"


def test_it_is_a_valid_script() -> None:
    """As bash reads it."""
    subprocess.run(["bash", "-n", str(INSTALL)], check=True)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_an_argument_that_is_not_known_changes_nothing() -> None:
    """The message says what there is."""
    done = subprocess.run([str(INSTALL), "--purge"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--purge: must be --uninstall, --with EXTRAS, --wheels FOLDER, or nothing" in done.stderr


def test_every_system_that_is_named_has_constraints() -> None:
    """The script takes the file of the system's name."""
    assert {path.stem for path in (ROOT / "constraints").glob("*.txt")} == {"bookworm", "trixie"}


# Everything but its last part, which acts; pip and the environment it is in are made up.
FUNCTIONS = (
    INSTALL.read_text(encoding="utf-8").rpartition("[[ $EUID == 0 ]]")[0].replace('$(dirname "$0")/..', str(ROOT))
)
PIP = """#!/bin/sh
for last; do :; done
cd "${last%\\[calibrate]}" && find -L "$PWD" -name '*.py' -o -name '*.c' -o -name pyproject.toml >"$SEEN"
"""


def run(script: str, **variables: str) -> str:
    """Returns what it says, in an environment with these variables."""
    done = subprocess.run(
        ["bash", "-c", FUNCTIONS + script], env=os.environ | variables, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_the_clone_is_left_as_it_is(tmp_path: Path) -> None:
    """It is built elsewhere, from all that it needs; that is gone afterwards."""
    pip = tmp_path / "home/bin/pip"
    pip.parent.mkdir(parents=True)
    pip.write_text(PIP, encoding="utf-8")
    pip.chmod(0o755)
    (tmp_path / "temporary").mkdir()
    made_up = f"home={tmp_path}/home; command={tmp_path}/ledpi; python3() {{ :; }}; constraints() {{ echo none; }}; "
    run(made_up + "install_program", SEEN=f"{tmp_path}/seen", TMPDIR=f"{tmp_path}/temporary")
    seen = (tmp_path / "seen").read_text(encoding="utf-8").splitlines()
    assert not any(path.startswith(str(ROOT)) for path in seen)
    for part in (
        "pyproject.toml",
        "setup.py",
        "build_core.py",
        "ledpi/pipeline/pipeline.py",
        "ledpi/decode/finding/find.c",
    ):
        assert any(path.endswith(f"/{part}") for path in seen)
    assert any(path.endswith("/ledpi/workshop/panel/sources/two_outputs.c") for path in seen)
    assert list((tmp_path / "temporary").iterdir()) == []


def test_extras_stay_for_updates(tmp_path: Path) -> None:
    """Those of an earlier call beside the new ones; one that does not exist changes nothing, and is named."""
    etc = f"etc={tmp_path}; "
    run(etc + "remember_extras mqtt,nt; remember_extras ''; remember_extras bags")
    assert (tmp_path / "extras").read_text().split() == ["bags", "calibrate", "mqtt", "nt"]
    said = run(etc + "(remember_extras nt,mqqt) 2>&1 || echo status $?")
    assert "--with mqqt: must be of " in said
    assert "status 2" in said
    made_up = f"home={tmp_path}/home; command={tmp_path}/ledpi; make_environment() {{ :; }}; "
    pip = tmp_path / "home/bin/pip"
    pip.parent.mkdir(parents=True)
    pip.write_text('#!/bin/sh\necho "pip $@"\n', encoding="utf-8")
    pip.chmod(0o755)
    built = run(etc + made_up + "python3() { :; }; constraints() { echo none; }; install_program")
    assert "[bags,calibrate,mqtt,nt]" in built
    (tmp_path / f"ledpi-{__version__}-any.whl").touch()
    offline = run(etc + made_up + f"constraints() {{ echo none; }}; wheels={tmp_path}; install_program").splitlines()
    assert all("--no-index" in line for line in offline if line.startswith("pip "))
    assert f"ledpi[bags,calibrate,mqtt,nt]=={__version__}" in offline[-2]


def test_a_32_bit_system_is_refused_with_the_reason() -> None:
    """Raspberry Pi OS has it below a 64-bit kernel."""
    said = run("getconf() { echo 32; }; dpkg() { echo armhf; }; (check_bits) 2>&1 || echo status $?")
    assert "32 bits (armhf), for which OpenCV and numpy have no packages" in said
    assert said.endswith("status 2\n")


@pytest.mark.slow
def test_the_demo_keeps_its_environment_in_an_activated_shell(tmp_path: Path) -> None:
    """A `python3` that is the environment's own: that is neither cleared nor made of itself."""
    stubs = "bring_compiler() { :; }; install_into() { echo installed; }; "
    script = f"source scripts/venv.sh; {stubs} make_venv {tmp_path}/v ''"
    for python, said in ((sys.executable, "installed\n"), (f"{tmp_path}/v/bin/python3", "")):
        environment = os.environ | {"PYTHON": python}
        done = subprocess.run(
            ["bash", "-ec", script], env=environment, cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert done.stdout == said


@pytest.mark.parametrize(
    ("before", "cleared"), [((), False), (("3.13",), False), (("3.11",), True), (("3.11", "3.13"), True)]
)
def test_after_an_upgrade_of_python_the_old_packages_go(tmp_path: Path, before: tuple[str, ...], cleared: bool) -> None:
    """The environment is begun anew where another Python has packages in it, and only there."""
    for version in before:
        (tmp_path / f"home/lib/python{version}/site-packages").mkdir(parents=True)
    python = f'python3() {{ if [[ $1 == -c ]]; then echo 3.13; else echo "$@"; fi; }}; home={tmp_path}/home; '
    said = run(python + "make_environment").split()
    assert said[:3] == ["-m", "venv", "--system-site-packages"]
    assert ("--clear" in said) is cleared


def test_what_takes_long_is_announced(tmp_path: Path) -> None:
    """Before apt and pip, which are silent themselves."""
    made_up = "apt-get() { :; }; apt-cache() { :; }; "
    assert "scripts/install: the system's packages" in run(made_up + "install_packages")
    made_up = f"home={tmp_path}; make_environment() {{ exit; }}; constraints() {{ echo none; }}; "
    assert "takes some minutes on a Pi" in run(made_up + "install_program")


@pytest.mark.parametrize(("there", "running"), [(False, False), (False, True), (True, True)])
def test_the_group_of_the_tap_is_made_once(tmp_path: Path, there: bool, running: bool) -> None:
    """Stops a running service of an older version before, and starts it again, where only that has it.

    Else the group would go with it.
    """
    groups = tmp_path / "group"
    groups.write_text("video:x:44:\nledpi-view:x:999:\n" + "ledpi:x:998:\n" * there, encoding="utf-8")
    made_up = (
        f"unit={tmp_path}/unit; rules={tmp_path}/rules; group_file={groups}; has_systemd() {{ true; }}; "
        f'udevadm() {{ :; }}; groupadd() {{ echo "groupadd $@"; }}; '
        f'systemctl() {{ [[ $1 != is-active ]] || {"true" if running else "return 1"}; echo "systemctl $@"; }}; '
    )
    said = [line for line in run(made_up + "install_service").splitlines() if "is-active" not in line]
    made = ["systemctl stop --quiet ledpi", "groupadd --system ledpi"]
    assert [line for line in said if line in made] == ([] if there else made)
    assert said[-1] == ("systemctl restart ledpi" if running else "systemctl enable --quiet ledpi")


@pytest.mark.parametrize("changed", [False, True])
def test_uninstalling_keeps_a_rule_that_was_changed(tmp_path: Path, changed: bool) -> None:
    """Like the configuration; it is named."""
    rules = tmp_path / "61-ledpi.rules"
    rules.write_text((ROOT / "systemd/61-ledpi.rules").read_text(encoding="utf-8") + "# mine\n" * changed)
    (tmp_path / "home").mkdir()
    for folder in ("ledpi", "private/ledpi-view-front"):
        (tmp_path / "states" / folder).mkdir(parents=True)
    paths = f"home={tmp_path}/home; command={tmp_path}/ledpi; unit={tmp_path}/unit; rules={rules}; "
    said = run(f"{paths} states={tmp_path}/states; uninstall")
    assert sorted(path.name for path in (tmp_path / "states").rglob("*")) == ["ledpi", "private"]  # no page's token
    assert (rules.exists(), str(rules) in said, (tmp_path / "home").exists()) == (changed, changed, False)


@pytest.mark.parametrize("new_is_there", [False, True])
def test_a_rule_of_an_older_version_moves_to_the_name_that_works(tmp_path: Path, new_is_there: bool) -> None:
    """As its owner has changed it. Beside a newer one it stays, and is named."""
    old, new = tmp_path / "60-ledpi.rules", tmp_path / "61-ledpi.rules"
    old.write_text("# mine")
    if new_is_there:
        new.write_text("# newer")
    said = run(f"rules={new}; move_rule; move_rule")
    assert new.read_text() == ("# newer" if new_is_there else "# mine")
    assert old.exists() is new_is_there
    assert str(old) in said
