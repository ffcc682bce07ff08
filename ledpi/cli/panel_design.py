"""`ledpi panel design`: which two frequencies a panel should blink at, and with which frame period."""

from __future__ import annotations

from pathlib import Path

import typer

from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulated import shortest_frame_rows
from ledpi.cli import CONFIG, SET, progress
from ledpi.cli.panel import OWN_SIZE, panel, require_extra
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.overrides import overrides_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import CameraSettings, Config, find_config, load_config
from ledpi.core.codewords import Dictionary
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError, raising
from ledpi.workshop.panel.design import (
    Proposal,
    Task,
    antiphase_proposals,
    auto_rows,
    candidate_pairs,
    farthest_m,
    proposal_at,
    ranked,
    views_of,
)
from ledpi.workshop.panel.design_text import (
    Finding,
    antiphase_text,
    config_lines,
    findings,
    legend,
    summary_line,
    table,
    task_text,
)
from ledpi.workshop.panel.frequencies import Flicker
from ledpi.workshop.panel.information import View
from ledpi.workshop.panel.reach import Reach, reach_of, reach_views

_SHOWN = 5
# Of the farthest distance at which cells can be sampled; for a panel of 16 cm 0.6, 1, 1.4, 2, 3, 5, 8 and 12 m.
_DISTANCE_SHARES = (0.048, 0.08, 0.11, 0.16, 0.24, 0.4, 0.64, 0.95)


@panel.command()
def design(
    check: tuple[float, float] | None = typer.Option(None, metavar="BLACK WHITE", help="Judge this pair, in Hz."),
    exposure_us: float | None = typer.Option(None, min=1, help="Exposure, in whole rows. Default: camera.exposure_us."),
    row_time_us: float | None = typer.Option(
        None, min=1, help="Default: camera.row_time_us; for auto 33.67, an OV5647's."
    ),
    fps: float | None = typer.Option(None, min=1, help="Frames a second. Default: from camera.frame_duration_us."),
    side: float | None = typer.Option(None, min=0.01, max=10, metavar="M", help="Default: panels.side_m."),
    distance: list[float] = typer.Option(
        [], min=0.05, max=1000, metavar="M", help="Distance to judge. May be repeated. Default: near to farthest."
    ),
    tolerance_ppm: float = typer.Option(
        100, min=0, max=200_000, help="Tolerance of the oscillators; a crystal's is 100."
    ),
    own_light: float = typer.Option(
        1.0,
        min=0.01,
        max=1,
        metavar="SHARE",
        help="Share of the panel's own light. The rest is room light that it reflects.",
    ),
    flicker: Flicker = typer.Option(Flicker.LOW_RISK, help="IEEE 1789's class: from 1250 Hz, or from 3000 Hz."),
    out: Path | None = typer.Option(None, metavar="FOLDER", help="Writes panel.yaml, antiphase.yaml and plots there."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Rank pairs of frequencies by how well panels are read.


    Each pair comes with a frame period. The table has the best five and the configured pair, and how far each is
    read; below are the lines for config.yaml. --check judges one pair instead. Exit status 1, with the reasons, if
    that pair cannot be used.

    Example: ledpi panel design --side 0.3 --distance 2 --distance 10 --out design

    Example: ledpi panel design --check 1000 2000
    """
    if out is not None and check is not None:
        raise ConfigError(f"--out {out}: is for a design; --check writes nothing")
    options = {"camera.exposure_us": exposure_us, "camera.row_time_us": row_time_us, "panels.side_m": side}
    options["camera.frame_duration_us"] = None if fps is None else 1e6 / fps
    settings = load_config(find_config(config), overrides_of(set_, options), without_file=OWN_SIZE)
    task = _task(settings, distance, tolerance_ppm, flicker, own_light)
    if check is not None:
        _check(task, settings, check)
    else:
        if out is not None:
            _make_folder(out)
        _design(task, settings, out)


def _task(settings: Config, distances_m: list[float], tolerance_ppm: float, flicker: Flicker, own_light: float) -> Task:
    panels, sensor = settings.panels, _sensor(settings.camera)
    cells = load_dictionary(panels.dictionary).cells_per_side
    farthest = farthest_m(sensor, panels.side_m, cells)
    return Task(
        sensor=sensor,
        period_given=settings.camera.frame_duration_us != "auto",
        side_m=panels.side_m,
        cells=cells,
        duty=panels.duty,
        distances_m=tuple(sorted(distances_m or (float(f"{share * farthest:.2g}") for share in _DISTANCE_SHARES))),
        tolerance=tolerance_ppm * 1e-6,
        flicker=flicker,
        own_light=own_light,
    )


def _sensor(camera: CameraSettings) -> SimulatedSensor:
    """The configured camera; what it leaves open is an OV5647's. Raises ConfigError."""
    row_time_us = OV5647_ROW_TIME_US if camera.row_time_us == "auto" else camera.row_time_us
    exposure_us = whole_rows_us(camera.exposure_us, row_time_us)
    rows = shortest_frame_rows(camera.height, exposure_us, row_time_us)
    if camera.frame_duration_us != "auto":
        given = round(camera.frame_duration_us / row_time_us)
        if given < rows and camera.row_time_us == "auto":
            # Its frames are shorter than those of the row time that is taken for granted: then its rows are too.
            row_time_us = camera.frame_duration_us / rows
            exposure_us = whole_rows_us(camera.exposure_us, row_time_us)
        elif given < rows:
            raise ConfigError(
                f"a frame of {camera.frame_duration_us:.0f} µs is {given} rows of {row_time_us:g} µs; must be at least "
                f"{rows}, at most {1e6 / (rows * row_time_us):.2f} fps"
            )
        rows = max(rows, given)
    lens = camera.intrinsics
    with raising("camera", ConfigError):
        return SimulatedSensor(
            intrinsics=ov5647_lens(camera.width, camera.height) if lens is None else load_intrinsics(lens),
            exposure_us=exposure_us,
            row_time_us=row_time_us,
            frame_length_rows=rows,
            transfer="srgb" if camera.transfer == "auto" else camera.transfer,
            gain=1.0 if camera.analogue_gain == "auto" else camera.analogue_gain,
        )


def _check(task: Task, settings: Config, pair: tuple[float, float]) -> None:
    """Says what is wrong with a pair, or how far it carries. Exit status 1 where it cannot be used."""
    black_hz, white_hz = pair
    if not all(10 <= hz <= 100_000 for hz in pair):  # as in the configuration
        raise ConfigError(f"--check {black_hz:g} {white_hz:g}: must be of 10 to 100000 Hz")
    rows = auto_rows(task, pair)
    found = findings(task, black_hz, white_hz, rows, settings.panels.phase)
    if any(finding.unusable for finding in found):
        typer.echo(f"{black_hz:g} and {white_hz:g} Hz cannot be used:")
        _say_findings(task, found)
        raise typer.Exit(1)
    proposal = proposal_at(task, black_hz, white_hz, rows, views_of(task))
    dictionary = load_dictionary(settings.panels.dictionary)
    (row,) = _add_reach(task, dictionary, reach_views(task), [("checked", proposal)])
    typer.echo(summary_line("good are", row[1:]))
    _say_findings(task, found)
    _say_unreported(settings.panels)
    typer.echo(table(task, [row]))
    typer.echo(legend())


def _say_findings(task: Task, found: list[Finding]) -> None:
    typer.echo(task_text(task))
    for finding in found:
        typer.echo(f"{'unusable' if finding.unusable else 'note'}: {finding.text}")


def _say_unreported(panels: PanelSettings) -> None:
    """Which IDs to do without, as long as none were chosen."""
    if panels.ids is None and (note := panels.unreported_note(range(len(panels.words.codewords)))):
        typer.echo(f"note: {note}")


def _design(task: Task, settings: Config, out: Path | None) -> None:
    panels = settings.panels
    pair = (panels.black_hz, panels.white_hz)
    views = views_of(task)
    present = proposal_at(task, *pair, auto_rows(task, pair), views)
    with progress("trying pairs", len(candidate_pairs(task))) as advance:
        proposals = [("pair", p) for p in ranked(task, present, views, advance)[:_SHOWN]]
    proposals += [("antiphase", p) for p in antiphase_proposals(task, views)[:_SHOWN]]
    dictionary = load_dictionary(panels.dictionary)
    drawn = _add_reach(task, dictionary, reach_views(task), [*proposals, ("present", present)])
    own = drawn[-1]
    pairs, antiphases = (farthest_first(drawn, kind, own) for kind in ("pair", "antiphase"))
    rows = [*((str(n), p, r) for n, (_, p, r) in enumerate(pairs, 1)), *antiphases[:1], own]
    antiphase = antiphases[0] if antiphases else None
    best = pairs[0] if pairs[0][2].is_beyond(own[2]) else own
    if best is own:
        typer.echo(f"{summary_line('keep yours,', own[1:])}; no pair is read further without loss")
    else:
        typer.echo(summary_line("best are", best[1:], own[1:]))
    typer.echo(task_text(task))
    typer.echo(table(task, rows))
    typer.echo(legend())
    for finding in findings(task, *pair, present.frame_length_rows, panels.phase):
        typer.echo(f"present: {'unusable' if finding.unusable else 'note'}: {finding.text}")
    _say_unreported(panels)
    lines = {"panel.yaml": config_lines(task, best[1], panels.dictionary, settings.camera.exposure_us)}
    typer.echo(f"\nFor config.yaml:\n\n{lines['panel.yaml']}", nl=False)
    if antiphase is not None:
        typer.echo("\n" + antiphase_text(antiphase[1], antiphase[2], best[2], dictionary))
        lines["antiphase.yaml"] = config_lines(task, antiphase[1], panels.dictionary, settings.camera.exposure_us)
        typer.echo(f"For config.yaml, instead:\n\n{lines['antiphase.yaml']}", nl=False)
    if out is not None:
        _write(out, task, rows, lines)


def farthest_first(
    rows: list[tuple[str, Proposal, Reach]], kind: str, present: tuple[str, Proposal, Reach]
) -> list[tuple[str, Proposal, Reach]]:
    """By how far they carry, to two digits, as the draws tell no more; equals as they came.

    Those that are read less far than the present pair in some respect come last.
    """
    of_kind = [row for row in rows if row[0] == kind]
    return sorted(of_kind, key=lambda row: (not row[2].is_beyond(present[2]), -float(f"{row[2].carries_m2():.2g}")))


def _add_reach(
    task: Task, dictionary: Dictionary, views: list[View], proposals: list[tuple[str, Proposal]]
) -> list[tuple[str, Proposal, Reach]]:
    with progress("drawing panels", len(views) * len(proposals)) as advance:
        return [(name, p, reach_of(task, p, dictionary, views, advance)) for name, p in proposals]


def _make_folder(out: Path) -> None:
    """Before the minutes that a design takes."""
    require_extra(f"--out {out}: the plots", "matplotlib")
    with raising(f"--out {out}: cannot be written", ConfigError, OSError):
        out.mkdir(parents=True, exist_ok=True)


def _write(out: Path, task: Task, rows: list[tuple[str, Proposal, Reach]], lines: dict[str, str]) -> None:
    with raising(f"--out {out}: cannot be written", ConfigError, OSError):
        for name, text in lines.items():
            (out / name).write_text(text, encoding="utf-8")
    from ledpi.workshop.panel.design_plots import contrast_figure, reach_figure, save

    save(contrast_figure(task, rows[0][1]), out / "contrast.png")
    save(reach_figure(rows), out / "reach.png")
    typer.echo(f"{out}: {', '.join(lines)}, contrast.png, reach.png")
