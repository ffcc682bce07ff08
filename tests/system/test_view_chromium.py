"""The live page in Debian's Chromium: a real daemon, `ledpi view` and the page, as a person has them."""

from __future__ import annotations

import math
import re
import signal
import tarfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.simulate.scenes import DRIVE_IDS, MAP_FROM_SCENE
from ledpi.camera.simulated import simulated_drive, simulated_sensor
from ledpi.config.check import mistakes_in
from ledpi.config.settings import load_config
from ledpi.daemon.tap.client import Client, connect
from tests.builders.daemon import slowness
from tests.builders.faults import ASIDE_M, AWAY_M, PLACE_PX
from tests.builders.view import (
    CHROMIUM,
    DRIVER,
    PHONE,
    Page,
    browser,
    ended,
    start_daemon,
    start_still_daemon,
    view,
)
from tests.builders.waiting import limit_s, wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.alone,  # a page waits for pictures that are made in time
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="Debian's chromium and chromium-driver are not here"),
    # Selenium closes what it has opened when it is collected.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
BACK_S = 2.0  # after a new daemon answers, its picture is shown


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("view")


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[Page]:
    """The page of a daemon on the simulated drive with a map."""
    with ended(start_daemon(folder)), view(folder) as served:
        yield served


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as driver:
        yield driver


@pytest.fixture
def opened(chromium: Any, page: Page) -> Any:
    """The page with its first picture, as who has opened the printed address sees it."""
    chromium.get("about:blank")
    chromium.get(page.address)
    wait_until(lambda: js(chromium, "return document.querySelector('#overlay .panel') !== null"), "a panel's outline")
    return chromium


def js(driver: Any, script: str) -> Any:
    return driver.execute_script(script)


def text(driver: Any, element: str) -> str:
    """As it is seen."""
    return str(driver.find_element("id", element).text)


def choose(driver: Any, kind: str) -> None:
    js(driver, f"document.querySelector('input[value={kind}]').click()")


OUTLINES = """return {seq: Number(document.getElementById('figure').dataset.seq),
  panels: [...document.querySelectorAll('#overlay .panel')].map(
    p => [Number(p.dataset.id), [...p.points].map(c => [c.x, c.y])])}"""


# ---- What it shows


def test_the_outlines_are_the_taps(opened: Any, folder: Path) -> None:
    """Within 2 px of what the tap tells of the same frame; it is drawn in the picture's coordinates."""
    told: dict[int, dict[int, Any]] = {}
    with connect(folder / "tap.sock") as tap:
        threading.Thread(target=_listen, args=(tap, told), daemon=True).start()
        shown = wait_until(lambda: _shown_of(opened, told), "a frame that both have told")
    for marker_id, corners in shown["panels"]:
        assert np.abs(np.array(corners) - np.array(told[shown["seq"]][marker_id])).max() < 2.0
    boxes = "const r = e => document.getElementById(e).getBoundingClientRect().toJSON();"
    picture, overlay = js(opened, boxes + "return [r('picture'), r('overlay')]")
    assert all(abs(picture[side] - overlay[side]) < 1.0 for side in ("left", "top", "width", "height"))


def _listen(tap: Client, told: dict[int, dict[int, Any]]) -> None:
    for line in tap.lines():
        if line["type"] == "decoded":
            told[line["seq"]] = {marker["id"]: marker["corners_px"] for marker in line["markers"]}


def _shown_of(driver: Any, told: dict[int, dict[int, Any]]) -> Any:
    """Returns what the page shows, if it is panels of a frame that the tap has told (not all are: the newest wins)."""
    shown = js(driver, OUTLINES)
    end_s = time.monotonic() + 0.3
    while shown["seq"] not in told and time.monotonic() < end_s:
        time.sleep(0.01)
    return shown if shown["seq"] in told and shown["panels"] else None


def test_the_map_shows_the_robot_where_it_is(opened: Any) -> None:
    """Within 5 cm and, as it is 15 times as large as that, on its own path; both panels are there."""
    wait_until(lambda: js(opened, "return document.querySelector('#map .robot') !== null"), "the robot")
    config = load_config(None, ("panels.side_m=0.16",))
    sensor = simulated_sensor(config.camera, config.panels)
    drive = simulated_drive(sensor, {i: config.panels.spec(i) for i in DRIVE_IDS}, "DICT_4X4_50")
    for _ in range(5):
        seen = js(opened, "const r = document.querySelector('#map .robot'); return r && {...r.dataset}")
        if seen:
            moment_s = (sensor.row0_readout_ns(int(seen["seq"])) + sensor.readout_end_ns(int(seen["seq"]))) * 0.5e-9
            true = MAP_FROM_SCENE @ drive.camera_motion.scene_from_body(moment_s)
            assert math.dist((float(seen["x"]), float(seen["y"])), true[:2, 3]) < 0.05
        time.sleep(0.4)
    walls = js(opened, "return [...document.querySelectorAll('#map .wall')].map(w => Number(w.dataset.id))")
    assert sorted(walls) == [7, 23]
    assert text(opened, "place").startswith("Robot at x ")


def test_age_focus_and_light_are_told(opened: Any) -> None:
    """With numbers; the age is between the exposure's half and what the slowest machine takes."""
    assert 5.0 < float(js(opened, "return document.getElementById('age').dataset.ms")) < 60_000.0
    assert float(text(opened, "focus")) > 0
    assert text(opened, "best")
    assert text(opened, "exposure") == "9.97 ms"
    assert js(opened, "return document.getElementById('histogram').getAttribute('aria-label')")


def test_a_key_is_changed_applied_and_undone(chromium: Any, tmp_path: Path) -> None:
    """A wrong value is refused in the file's words; once the file forbids it, nothing is offered."""
    file, before = (
        tmp_path / "config.yaml",
        "# mine\npanels: {side_m: 0.16}\nserial: {max_age_ms: 95}\nview: {edit: true}\n",
    )
    file.write_text(before, encoding="utf-8")
    row = "document.querySelector('#keys [data-key=\"serial.max_age_ms\"]')"

    def enter(value: str) -> None:
        field = wait_until(lambda: js(chromium, f"return {row}.querySelector('input')"), "the field")
        field.clear()
        field.send_keys(value + "\n")

    def shows(value: str, *, waits: bool) -> None:
        seen = f"return {row} && !{row}.querySelector('form') && {row}.querySelector('.value').textContent"
        wait_until(lambda: js(chromium, seen) == value, f"the value {value}")
        wait_until(
            lambda: js(chromium, f"return {row}.querySelector('.waits') !== null") is waits, "what the daemon has"
        )

    def of_daemon() -> Any:
        with connect(tmp_path / "tap.sock") as tap:
            return tap.ask("config", limit_s())["values"]["serial.max_age_ms"]

    with ended(start_daemon(tmp_path)), view(tmp_path) as page:
        wait_until(lambda: _answers(tmp_path), "the daemon")
        chromium.get("about:blank")
        chromium.get(page.address)
        js(chromium, "document.getElementById('config').open = true")
        shows("95", waits=False)
        js(chromium, f"{row}.querySelector('button').click()")
        enter("0")
        (mistake,) = mistakes_in(file, ["serial.max_age_ms=0"], with_files=False)
        wrong = f"return {row}.querySelector('.wrong').textContent"
        wait_until(lambda: js(chromium, wrong) == f"Not done: {mistake}", "what is wrong")
        enter("90")
        shows("90", waits=True)
        assert file.read_text(encoding="utf-8") == before.replace("95", "90")
        assert of_daemon() == 95
        chromium.find_element("id", "reload").click()
        shows("90", waits=False)
        assert of_daemon() == 90
        chromium.find_element("id", "undo").click()
        assert "serial.max_age_ms: 90 → 95" in chromium.switch_to.alert.text
        chromium.switch_to.alert.accept()
        shows("95", waits=True)
        assert file.read_text(encoding="utf-8") == before
        file.write_text(before.replace("true", "false"), encoding="utf-8")
        js(chromium, "document.getElementById('config').open = false")
        js(chromium, "document.getElementById('config').open = true")
        wait_until(lambda: not js(chromium, "return document.querySelector('#keys button') !== null"), "no buttons")
        assert not chromium.find_element("id", "editing").is_displayed()
        chromium.get("about:blank")  # before the page's server ends
        severe = [entry["message"] for entry in chromium.get_log("browser") if entry["level"] == "SEVERE"]
        assert [message for message in severe if "status of 400" not in message] == []  # that is the refused value


def test_bands_are_amplified(opened: Any) -> None:
    """Another picture than as seen: middle grey on the whole, with full black and white at the panels."""
    choose(opened, "bands")
    grey = (
        "const c = document.getElementById('picture'); const d = c.getContext('2d').getImageData(0, 0, 640, 480).data; "
        "let sum = 0; for (let i = 0; i < d.length; i += 4) sum += d[i]; return 4 * sum / d.length"
    )
    wait_until(lambda: "bands ±" in text(opened, "seq"), "amplified bands")
    assert js(opened, grey) == pytest.approx(127, abs=12)
    choose(opened, "plain")


def test_nothing_is_wrong_in_the_browsers_eyes(opened: Any) -> None:
    """No error, and nothing that the page's own security policy forbids."""
    time.sleep(1.0)
    assert [entry for entry in opened.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_the_token_does_not_stay_in_the_address(opened: Any, page: Page) -> None:
    """It was after a #, which is sent to nobody, and is taken out."""
    assert page.token not in opened.current_url


# ---- A panel at rest, and one with its frequencies swapped


@pytest.fixture(scope="module")
def still(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The page of a daemon that sees panel 7 and, beside it, panel 11 built wrongly."""
    folder = tmp_path_factory.mktemp("still")
    with ended(start_still_daemon(folder, "swapped")), view(folder) as served:
        chromium.get("about:blank")
        chromium.get(served.address)
        yield chromium


def test_a_row_shows_id_and_distance(still: Any) -> None:
    """Within 1 % of the truth."""
    row = wait_until(
        lambda: js(
            still,
            "const r = document.querySelector('#panels tr[data-id=\"7\"]');"
            "return r && [...r.cells].map(c => c.textContent)",
        ),
        "panel 7's row",
    )
    assert row[0] == "7"
    assert float(row[1].removesuffix(" m")) == pytest.approx(math.hypot(ASIDE_M, AWAY_M), rel=0.01)


def test_why_not_says_that_frequencies_are_swapped(still: Any) -> None:
    """In words with what helps, at the panel's place, and first in the list."""
    choose(still, "whynot")
    script = """const q = document.querySelector('#overlay .dropped.panel'), i = document.querySelector('#reasons li');
      return q && i ? [i.innerText, [...q.points].map(c => [c.x, c.y])] : null"""
    told, corners = wait_until(lambda: _with_words(js(still, script), "ID 11 with its two frequencies swapped"), "why")
    assert "What helps: exchange" in told
    assert np.mean(corners, axis=0) == pytest.approx(PLACE_PX, abs=8.0)
    labels = js(still, "return [...document.querySelectorAll('#overlay .dropped-text')].map(t => t.textContent)")
    assert labels[0].startswith("1")
    choose(still, "plain")


def _with_words(found: Any, words: str) -> Any:
    return found if found and words in found[0] else None


def test_shapes_that_are_no_panels_are_not_told_of(still: Any) -> None:
    """The wall has some: they are outlined faintly, and counted by reason behind a line that opens."""
    choose(still, "whynot")
    wait_until(lambda: js(still, "return document.querySelector('#overlay .dropped.shape') !== null"), "a shape")
    assert js(still, "return document.querySelectorAll('#reasons li').length") == 1
    js(still, "document.getElementById('shapes').open = true")
    wait_until(lambda: "find.at_picture_border" in text(still, "shape-counts"), "the counts")
    choose(still, "plain")


# ---- Buttons


def test_each_button_says_what_it_has_done(opened: Any) -> None:
    """The last seconds are saved; recording begins and ends; the picture goes to the browser; the best is forgotten."""
    wait_until(lambda: re.fullmatch(r"Save the last \d+ s", text(opened, "save")), "some seconds")
    opened.find_element("id", "save").click()
    wait_until(lambda: re.search(r"machine: \S+-asked$", text(opened, "done")), "the last seconds")
    opened.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "deny"})
    opened.find_element("id", "record").click()
    wait_until(lambda: text(opened, "record") == "Stop the recording", "that it records")
    time.sleep(1.0)
    opened.find_element("id", "record").click()
    wait_until(
        lambda: re.search(r"Recorded on the daemon's machine: \S+-recorded$", text(opened, "done")), "the recording"
    )
    wait_until(lambda: text(opened, "record") == "Start a recording", "that it has ended")
    opened.find_element("id", "keep").click()
    wait_until(lambda: re.search(r"Saved by this browser as ledpi-frame-\d+\.png", text(opened, "done")), "the picture")
    before = float(text(opened, "best"))
    js(opened, "document.getElementById('forget').click()")
    assert 0 < wait_until(lambda: float(text(opened, "best")), "a new best") <= before


def test_a_recording_is_listed_downloaded_and_deleted(opened: Any, folder: Path, tmp_path: Path) -> None:
    """Gets a tar file of the take; a question comes before it is gone."""
    takes = folder / "state/ledpi/takes"
    with connect(folder / "tap.sock") as tap:
        name = Path(tap.ask("record", limit_s(), seconds=1)["path"]).name
    opened.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    js(opened, "document.getElementById('takes').open = true")
    row = f"document.querySelector('#takes-rows tr[title=\"{name}\"]')"
    wait_until(lambda: js(opened, f"return {row} !== null"), "the recording's row")
    assert js(opened, f"return [...{row}.cells].slice(1, 4).map(c => c.textContent)") == [
        "recording",
        str(len(list((takes / name / "frames").iterdir()))),
        "complete",
    ]
    js(opened, f"{row}.querySelectorAll('button')[0].click()")
    wait_until((tmp_path / f"{name}.tar").exists, "the download")
    with tarfile.open(tmp_path / f"{name}.tar") as archive:
        file = archive.extractfile(f"{name}/live.jsonl")
        assert file is not None
        assert file.read() == (takes / name / "live.jsonl").read_bytes()
    opened.find_element("xpath", f"//button[@aria-label='Delete {name}']").click()
    opened.switch_to.alert.dismiss()
    assert (takes / name).is_dir()
    opened.find_element("xpath", f"//button[@aria-label='Delete {name}']").click()
    opened.switch_to.alert.accept()
    wait_until(lambda: js(opened, f"return {row} === null"), "that the row is gone")
    assert not (takes / name).exists()


# ---- Who may, and what goes wrong


def test_a_wrong_token_gets_a_question_and_no_picture(chromium: Any, tmp_path: Path) -> None:
    """On the network the token is wanted; with the right one the page opens."""
    with (
        ended(start_daemon(tmp_path, "camera.width=320", "camera.height=240")),
        view(tmp_path, "view.listen=0.0.0.0:0") as page,
    ):
        chromium.get("about:blank")
        chromium.get(f"http://127.0.0.1:{page.port}/#token=wrong-token-here")
        wait_until(lambda: chromium.find_element("id", "login").is_displayed(), "the question for the token")
        assert not chromium.find_element("id", "page").is_displayed()
        chromium.find_element("id", "token").send_keys(page.token + "\n")
        wait_until(lambda: js(chromium, "return document.getElementById('figure').dataset.seq"), "a picture")
        assert chromium.find_element("id", "page").is_displayed()


def test_without_the_token_it_is_asked_for_on_this_machine_too(chromium: Any, page: Page) -> None:
    """Another user of it opens the bare address, and sees nothing."""
    chromium.get("about:blank")
    chromium.get(f"http://localhost:{page.port}/")  # another origin than the others' 127.0.0.1: it holds no token
    wait_until(lambda: chromium.find_element("id", "login").is_displayed(), "the question for the token")
    assert not chromium.find_element("id", "page").is_displayed()


def test_every_control_has_a_name_and_is_reached_by_keyboard(opened: Any) -> None:
    """As a screen reader tells it."""
    controls = [
        e for e in opened.find_elements("css selector", "button, input, summary, canvas[role]") if e.is_displayed()
    ]
    assert len(controls) > 8
    assert [control.get_attribute("outerHTML") for control in controls if not control.accessible_name] == []
    opened.find_element("css selector", "input[value=plain]").send_keys("\ue014")  # arrow to the right
    assert js(opened, "return document.querySelector('input[name=kind]:checked').value") == "bands"
    choose(opened, "plain")


def test_a_phone_shows_it_without_scrolling_sideways(page: Page) -> None:
    """At the smallest width that there is; however far away, turned and old a panel is."""
    longest = ["1023", "12.345 m", "−45.6°?", "1999 ms", "60/s", "12345"]
    fill = "const [row] = document.querySelectorAll('#panels tbody tr'); "
    fill += "arguments[0].forEach((text, k) => { row.cells[k].textContent = text; });"
    with browser((320, PHONE[1]), phone=True) as phone:
        phone.get(page.address)
        wait_until(
            lambda: js(phone, "return document.querySelectorAll('#panels tbody tr').length > 1"), "the panels' rows"
        )
        js(phone, "document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        for kind in ("plain", "whynot"):
            choose(phone, kind)
            time.sleep(1.0)
            seen = phone.execute_script(f"{fill} return [innerWidth, document.documentElement.scrollWidth]", longest)
            assert seen == [320, 320]


def test_a_daemon_that_was_killed_and_started_again(chromium: Any, tmp_path: Path) -> None:
    """The page says that it is gone, and shows the new one's pictures 2 s after that answers, at most."""
    with view(tmp_path) as page:
        with ended(start_daemon(tmp_path)) as first:
            chromium.get("about:blank")
            chromium.get(page.address)
            wait_until(lambda: js(chromium, "return document.querySelector('#overlay .panel') !== null"), "a panel")
            first.send_signal(signal.SIGKILL)
            wait_until(lambda: "ended" in text(chromium, "notice"), "that it has ended")
            assert text(chromium, "state") == "no daemon"
        with ended(start_daemon(tmp_path)):
            wait_until(lambda: _answers(tmp_path), "the new daemon")
            answered_s = time.monotonic()
            wait_until(lambda: not chromium.find_element("id", "blank").is_displayed(), "a picture")
            assert time.monotonic() - answered_s < BACK_S * slowness()
            wait_until(lambda: "has restarted" in text(chromium, "notice"), "that it is back")


def _answers(folder: Path) -> bool:
    from ledpi.core.errors import TapError

    try:
        with connect(folder / "tap.sock") as tap:
            return any(line["type"] == "decoded" for line in tap.lines())
    except TapError:
        return False
