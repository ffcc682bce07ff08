"""`ledpi evaluate --recording`: how often a real panel is read, from a place that is given."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ledpi.cli.evaluate_results import show
from ledpi.cli.progress import progress
from ledpi.core.errors import ConfigError

if TYPE_CHECKING:
    from ledpi.config.panels import PanelSettings
    from ledpi.config.settings import Config
    from ledpi.tools.evaluate.folder import ResultsFolder
    from ledpi.tools.evaluate.reading import Method, PanelMethod
    from ledpi.tools.evaluate.table import TableRow


def read_recording(
    out: Path,
    recording: Path,
    marker_id: int | None,
    distance_m: float,
    angle_deg: float,
    methods: list[Method],
    settings: Config,
    panel_options: list[str],
) -> None:
    from ledpi.config.camera_yaml import lens_of
    from ledpi.recording.overrides import load_recording_with
    from ledpi.tools.evaluate.folder import ResultsFolder
    from ledpi.tools.evaluate.reading import PANEL_METHODS
    from ledpi.tools.evaluate.recorded import evaluate_recording
    from ledpi.tools.evaluate.units import code_version

    if marker_id is None:
        raise ConfigError("--id: must be given with --recording: its panel's")
    unable = [m for m in methods if m not in PANEL_METHODS]
    if unable:
        raise ConfigError(f"--method {unable[0]}: a recording is of a panel; must be one of {', '.join(PANEL_METHODS)}")
    folder = ResultsFolder(out, {"recordings": True, "code": code_version()})
    loaded = load_recording_with(settings, recording)
    lens = lens_of(loaded.camera, settings.camera.intrinsics)
    with progress("evaluating", len(loaded.frames)) as advance:
        record = evaluate_recording(
            loaded,
            marker_id=marker_id,
            distance_m=distance_m,
            angle_deg=angle_deg,
            methods=_panel_methods(methods, settings.panels.override_with(loaded.panel_values)),
            intrinsics=lens,
            panels=settings.panels,
            advance=advance,
        )
    place = ["--id", str(marker_id), "--distance", f"{distance_m:g}", "--angle", f"{angle_deg:g}"]
    chosen = [word for m in methods for word in ("--method", m)] + panel_options
    words = ["ledpi", "evaluate", "--out", "DIR", "--recording", str(recording), *place, *chosen]
    folder.add(record | {"command": shlex.join(words)})
    _show_recordings(out, folder)


def _panel_methods(asked: list[Method], panels: PanelSettings) -> list[PanelMethod]:
    """Those asked for, else all that can read such panels. Raises ConfigError where one that is asked for cannot."""
    from ledpi.config.settings import check_method
    from ledpi.tools.evaluate.reading import PANEL_METHODS

    if "uemura" in asked:
        check_method("uemura", panels, "--method")
    able = [m for m in PANEL_METHODS if m != "uemura" or not panels.has_antiphase()]
    return [m for m in able if m in (asked or able)]


def _show_recordings(out: Path, folder: ResultsFolder) -> None:
    """The table of all places that the folder holds."""
    from ledpi.tools.evaluate.recorded import rows_of_recordings
    from ledpi.tools.evaluate.units import code_version

    records = folder.finished.values()

    def commands(row: TableRow) -> list[str]:
        return [r["command"] for r in records if (r["exposure_us"], r["transfer"]) == (row.exposure_us, row.transfer)]

    show(out, rows_of_recordings(records), f"Read from recordings, code {code_version()}.", commands)
