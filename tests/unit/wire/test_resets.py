"""Numbers by which a receiver knows that fixes of before and after do not belong together."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

from ledpi.pose.panel_map import MapPanel, PanelMap
from ledpi.wire import FixMessage
from ledpi.wire.resets import Resets
from tests.builders.daemon import SIMULATED_YAML, Controller, controller, daemon, end, wait_for_log


def panels(**x_m: float) -> PanelMap:
    """By `p` and ID: where each is along x."""
    return {int(name[1:]): MapPanel(map_from_marker=place(x)) for name, x in x_m.items()}


def place(x_m: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 3] = x_m
    return matrix


@pytest.mark.parametrize(
    ("now", "maps"),
    [
        (panels(p7=1.0, p9=2.0), 0),
        (panels(p7=1.0), 0),
        (panels(p7=1.0, p8=5.0), 0),
        (panels(p7=1.1, p9=2.0), 1),
        (panels(p8=1.0), 1),
        (None, 0),
    ],
    ids=["the same", "one less", "another one beside", "one that has moved", "others", "none"],
)
def test_a_map_is_another_one_where_panels_are_elsewhere(now: PanelMap | None, maps: int) -> None:
    """One that was surveyed further is still the same frame; of two without a common panel nobody knows."""
    resets = Resets()
    for seen in (panels(p7=1.0, p9=2.0), now):
        resets.update_map(seen)
    assert resets.maps == maps


def test_a_time_without_a_map_hides_no_change() -> None:
    """Counts against the map before."""
    resets = Resets()
    for seen in (panels(p7=1.0), None, panels(p7=2.0), panels(p7=2.0)):
        resets.update_map(seen)
    assert resets.maps == 1


def fixes(line: Controller) -> list[FixMessage]:
    return [message for _, message in line.got if isinstance(message, FixMessage)]


def test_a_reload_with_another_map_is_reported_with_each_fix(tmp_path: Path) -> None:
    """The panel hangs ten metres further, as no drive goes: fixes jump, and say so; with the same map they do not."""
    file, map_file = tmp_path / "config.yaml", tmp_path / "markers.yaml"

    def hang(x_m: float) -> None:
        map_file.write_text(f"panels: {{7: {{position_m: [{x_m}, 0, 1], quaternion_wxyz: [0.5, 0.5, 0.5, 0.5]}}}}\n")

    with controller() as line:
        file.write_text(
            f"panels: {{side_m: 0.16, upright: true}}\nmap: markers.yaml\n{SIMULATED_YAML}serial: {{port: {line.port}}}"
        )
        hang(3.0)
        with daemon(options=("--config", str(file))) as process:
            wait_for_log(process, "INFO start ")
            for x_m in (3.0, 13.0):
                line.wait_for(lambda c: bool(fixes(c)))
                hang(x_m)
                process.send_signal(signal.SIGHUP)
                wait_for_log(process, "INFO start ")
                seen = len(fixes(line))
                line.wait_for(lambda c, seen=seen: len(fixes(c)) > seen + 3)  # type: ignore[misc]
            assert end(process, signal.SIGTERM).status == 0
        line.close()
    counted = [fix.map_resets for fix in fixes(line)]
    assert set(counted) == {0, 1}
    assert counted == sorted(counted)
    before, after = fixes(line)[counted.count(0) - 1], fixes(line)[counted.count(0)]
    assert after.pose.position_m[0] > before.pose.position_m[0] + 5.0
