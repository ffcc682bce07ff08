"""`ledpi doctor`, and the live page, of the daemon that runs: what is wrong with it, and what to do."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from ledpi.config.origins import values_of
from ledpi.config.settings import load_config
from ledpi.core.records import Pixels
from ledpi.daemon.tap.client import connect
from ledpi.workshop.doctor.finding import ok
from ledpi.workshop.doctor.running import checks, connected, examine, other_file, other_settings
from tests.builders.made_up_daemon import HEALTH, HELLO, PANEL, MadeUpDaemon


def found(hello: dict[str, Any] | None = None, health: dict[str, Any] | None = None) -> dict[str, tuple[str, str]]:
    return {f.name: (f.state, f.said) for f in checks(HELLO | (hello or {}), HEALTH | (health or {}))}


def wire(**recent: int) -> dict[str, Any]:
    """Makes that of a daemon that has sent much before its last 5 s."""
    counts = {"seconds": 5, "sent": 0, "replaced": 0, "stale": 0, "refused": 0} | recent
    return {"packets": 100_000, "dropped": 0, "connected": True, "error": None, "recent": counts}


def test_a_line_that_loses_few_poses_is_well() -> None:
    """Finds no fault now in what was lost long ago."""
    assert found({}, {"wire": wire(sent=290, replaced=10) | {"dropped": 5000}})["serial port"] == (
        "ok",
        "58 packets a second; 10 of 300 of the last 5 s were dropped",
    )


def test_a_daemon_that_is_well_has_nothing_to_put_right() -> None:
    """Without a map it sends no place, which may be meant so."""
    states = {name: state for name, (state, _) in found().items()}
    assert states == dict.fromkeys(("camera", "lens", "exposure", "serial port", "processor"), "ok") | {
        "map": "unknown"
    }


@pytest.mark.parametrize(
    ("hello", "health", "name", "said"),
    [
        ({"camera": HELLO["camera"] | {"fx": None}}, {}, "lens", "is not calibrated"),
        ({"camera": HELLO["camera"] | {"exposure_us": 8000.0}}, {}, "exposure", "at a null of 1250 Hz"),
        ({}, {"state": "camera_lost"}, "camera", "is lost"),
        ({}, {"no_fix": "behind"}, "frames", "decoding is too slow"),
        ({}, {"wire": {"connected": False, "error": "no such port"}}, "serial port", "no such port"),
        ({}, {"wire": wire(sent=0, replaced=300)}, "serial port", "takes nothing: none of 300 packets of the last 5 s"),
        ({}, {"wire": wire(sent=0)}, "serial port", "takes nothing"),
        ({}, {"wire": wire(sent=100, stale=200)}, "serial port", "200 of 300 packets of the last 5 s were older than"),
        ({}, {"wire": wire(sent=200, replaced=100)}, "serial port", "100 of 300 packets of the last 5 s found"),
        ({}, {"wire": wire(sent=200, refused=100)}, "serial port", "out of the packet's range"),
        ({}, {"throttled": 1}, "processor", "voltage is too low"),
        ({}, {"temperature_c": 85.0}, "processor", "too hot"),
    ],
)
def test_what_is_wrong_is_told_with_what_to_do(hello: Any, health: Any, name: str, said: str) -> None:
    """As `ledpi doctor` does."""
    state, told = found(hello, health)[name]
    assert state == "bad"
    assert said in told
    assert all(f.remedy for f in checks(HELLO | hello, HEALTH | health) if f.state == "bad")


def test_a_daemon_with_other_settings_than_these_is_told() -> None:
    """With both values, and how to make it take these; the page's own settings are no daemon's."""
    daemon = load_config(None, ("panels.side_m=0.16", "panels.overrides={7: {side_m: 0.3}}", "view.token=secretsecret"))
    here = load_config(None, ("panels.side_m=0.08", "panels.overrides={7: {side_m: 0.3}}"))
    (finding,) = other_settings(values_of(daemon), here)
    assert (finding.state, finding.said) == ("bad", "the daemon runs with panels.side_m 0.16, not 0.08")
    assert "systemctl reload ledpi" in finding.remedy
    assert other_settings(values_of(daemon), daemon) == []


def test_without_a_configuration_a_daemon_is_asked_whatever_its_camera(tmp_path: Path) -> None:
    """Its own values are no other ones then: nobody has written any."""
    here = load_config(None, ("panels.side_m=1", "camera.source=v4l2:/dev/video9", f"tap.socket={tmp_path}/tap.sock"))
    with closing(MadeUpDaemon(tmp_path / "tap.sock")):
        assert connected(here) is None
        tap = connected(here, any_camera=True)
        assert tap is not None
        with tap:
            assert "settings" not in [finding.name for finding in examine(tap, None)]


def test_a_daemon_with_another_file_is_told(tmp_path: Path) -> None:
    """With the command that looks at that one, whatever its camera; of the same file there is nothing to tell."""
    file = tmp_path / "config.yaml"
    file.write_text(f"panels: {{side_m: 0.16}}\ntap: {{socket: {tmp_path}/tap.sock}}\n")
    for path, others in ((file, []), (tmp_path / "front.yaml", [f"ledpi doctor --config {tmp_path}/front.yaml"])):
        with closing(MadeUpDaemon(tmp_path / "tap.sock", hello={"config_path": str(path)})):
            found = other_file(load_config(file))
        assert ([found.remedy.removeprefix("to see that one: ")] if found else []) == others


class Flickering(MadeUpDaemon):
    """Two pictures: one shows its panel, and the other only that something is there."""

    def picture(self, seq: int) -> Pixels:
        """Also what the rest of this answer, and the next one, tell."""
        was_read = "markers" not in self.frame
        dropped = {"corners_px": PANEL["corners_px"], "why": "identify.not_in_dictionary"}
        self.extra = {} if was_read else {"rejected": [dropped]}
        self.frame = {"markers": []} if was_read else {}
        return super().picture(seq)


def test_a_panel_that_one_of_the_pictures_shows_is_read(tmp_path: Path) -> None:
    """Tells nothing that the other lacks: a panel is not read and not read at once."""
    with closing(Flickering(tmp_path / "tap.sock")), connect(str(tmp_path / "tap.sock")) as tap:
        findings = list(examine(tap, load_config(None, ("panels.side_m=0.16",))))
    assert [finding for finding in findings if finding.name == "panels"] == [ok("panels", "ID 7 read")]
