"""`ledpi evaluate`: recognition rates of simulated panels, of prints, of decoys, or of a real panel's recording."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli import app
from ledpi.cli.evaluate_recording import read_recording
from ledpi.cli.evaluate_results import show
from ledpi.cli.progress import progress
from ledpi.cli.simulate import TransferName
from ledpi.core.errors import ConfigError
from ledpi.core.str_enum import StrEnum

if TYPE_CHECKING:
    from ledpi.tools.evaluate.conditions import Suite
    from ledpi.tools.evaluate.plan import Plan
    from ledpi.tools.evaluate.reading import Method

_SIDE = "panels.side_m=0.16"


class SuiteName(StrEnum):
    """The values of --suite."""

    PAPER = "paper"
    BEYOND = "beyond"
    ROBUSTNESS = "robustness"
    DECOYS = "decoys"
    WILD = "wild"


class MethodName(StrEnum):
    """The values of --method."""

    UEMURA = "uemura"
    LIKELIHOOD = "likelihood"
    STREAM = "stream"
    ARUCO = "aruco"
    APRILTAG = "apriltag"
    LEDPI = "ledpi"
    ORACLE = "oracle"


_METHODS = f"[{'|'.join(MethodName)}]"


def _method(name: str) -> MethodName:
    """The method of this name, or of one that it had before."""
    from ledpi.config.renamed import EVALUATED, current_name

    try:
        return MethodName(current_name(name, EVALUATED, "--method"))
    except ValueError:
        known = ", ".join(f"'{known}'" for known in MethodName)
        raise typer.BadParameter(f"'{name}' is not one of {known}.") from None


@app.command()
def evaluate(
    out: Path = typer.Option(
        Path("evaluation"), "--out", metavar="DIR", help="Folder for the results. An interrupted run there resumes."
    ),
    suite: list[SuiteName] = typer.Option([], help="May be repeated. Default: paper and beyond."),
    frames: int | None = typer.Option(
        None, min=1, help="Takes for each condition (decoys: frames). Default: 300; wild: 400."
    ),
    seed: int = typer.Option(1, min=0, help="Seed of all that is random: the same seed gives the same results."),
    exposure_us: list[float] = typer.Option(
        [], min=1, help="May be repeated. Default: 10000 and 150; robustness: 10000."
    ),
    transfer: list[TransferName] = typer.Option([TransferName.SRGB], help="May be repeated."),
    distance: list[float] = typer.Option(
        [], min=0.05, max=1000, help="Distances in metres, instead of the suite's own."
    ),
    angle: list[float] = typer.Option([], min=-88, max=88, help="Angles in degrees, instead of the suite's own."),
    case: list[str] = typer.Option([], help="Only this case of robustness, decoys or wild; may be repeated."),
    roll: bool = typer.Option(False, "--roll", help="Roll panels by any angle. Default: within 3°."),
    method: list[MethodName] = typer.Option(
        [],
        parser=_method,
        metavar=_METHODS,
        help="May be repeated. Default: all that the suite is for.",
    ),
    workers: int = typer.Option(0, min=0, help="Processes. Default: one for each core. Only the times depend on it."),
    scheduler: str | None = typer.Option(None, metavar="ADDRESS", help="Run on this dask.distributed cluster."),
    take: int | None = typer.Option(None, min=0, help="Write this take of one condition to DIR, as a recording."),
    keep: Path | None = typer.Option(None, metavar="DIR", help="Write all takes of wild to DIR, as recordings."),
    recording: Path | None = typer.Option(None, metavar="DIR", help="Read these frames of a real panel instead."),
    id_: int | None = typer.Option(None, "--id", min=0, help="With --recording: the panel's ID."),
    config: Path | None = typer.Option(
        None, "--config", help="Take the panels from this file. Default: the paper's, 16 cm."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """Measure how often and how exactly panels are read.

    Frames are rendered from a seed, or come from a recording whose panel's distance and angle you give. Results go to
    DIR: results.csv, evaluation.md, plots. An interrupted run resumes.

    Example: ledpi evaluate --out far --suite beyond --frames 300 --method likelihood --method stream

    Example: ledpi evaluate --out mine --recording take1 --id 7 --distance 0.6
    """
    from ledpi.config.settings import load_config

    settings = load_config(config, tuple(set_), without_file=(_SIDE,))
    panel_options = [] if config is None else ["--config", str(config)]
    panel_options += [word for item in set_ for word in ("--set", item)]
    methods: list[Method] = [m.value for m in method]
    if recording is not None:
        place = _one("--distance", distance), _one("--angle", angle or [0.0])
        read_recording(out, recording, id_, *place, methods, settings, panel_options)
        return
    if id_ is not None:
        raise ConfigError("--id: goes with --recording DIR; rendered panels draw their IDs")
    from ledpi.tools.evaluate.plan import Plan
    from ledpi.tools.evaluate.prints import has_apriltag
    from ledpi.tools.evaluate.units import code_version
    from ledpi.tools.evaluate.wild_rows import TAKES

    suites: tuple[Suite, ...] = tuple(s.value for s in suite or (SuiteName.PAPER, SuiteName.BEYOND))
    plan = Plan(
        suites=suites,
        frames=frames or (TAKES if suites == ("wild",) else 300),
        seed=seed,
        transfers=tuple(t.value for t in transfer),
        exposures_us=tuple(exposure_us),
        distances_m=tuple(distance),
        angles_deg=tuple(angle),
        cases=tuple(case),
        methods=tuple(methods),
        any_roll=roll,
        apriltag=has_apriltag(),
        panels=settings.panels,
        frame_duration_us=None if settings.camera.frame_duration_us == "auto" else settings.camera.frame_duration_us,
        panel_options=tuple(panel_options),
        code=code_version(),
    )
    plan.check()
    if keep is not None:
        _keep(keep, plan)
    elif take is not None:
        _write_take(out, plan, take)
    else:
        _run(out, plan, workers, scheduler)


def _one(name: str, values: list[float]) -> float:
    if len(values) != 1:
        raise ConfigError(f"{name}: must be given once with --recording: where its panel was")
    return values[0]


def _run(out: Path, plan: Plan, workers: int, scheduler: str | None) -> None:
    from contextlib import closing

    from ledpi.tools.evaluate.folder import ResultsFolder
    from ledpi.tools.evaluate.workers import run_on_cluster, run_on_processes

    units = plan.units()
    folder = ResultsFolder(out, plan.as_json())
    left = [unit for unit in units if unit.key not in folder.finished]
    with progress("evaluating", len(units)) as advance:
        advance(len(units) - len(left))
        records = run_on_cluster(left, scheduler) if scheduler else run_on_processes(left, workers or _cores())
        with closing(records):
            for record in records:
                folder.add(record)
                advance(1)
    rows = plan.rows(folder.finished)
    intro = f"Seed {plan.seed}, {plan.frames} frames a condition, code {plan.code}."
    if not plan.apriltag and any(row.method == "aruco" for row in rows):
        intro += " AprilTag is left out: pupil-apriltags is not installed."
    show(out, rows, intro, plan.commands)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _write_take(out: Path, plan: Plan, number: int) -> None:
    from ledpi.tools.evaluate.replay import write_take

    conditions = plan.conditions()
    if plan.suites == ("wild",):
        raise ConfigError("--take: --suite wild writes its takes with --keep DIR")
    if len(conditions) != 1:
        raise ConfigError(
            f"--take: is of one condition, asked for are {len(conditions)}; "
            "narrow them with --suite, --case, --distance, --angle and --exposure-us"
        )
    write_take(out, conditions[0], plan.panels, plan.seed, number, plan.frame_duration_us)


def _keep(out: Path, plan: Plan) -> None:
    from ledpi.tools.evaluate.keep import keep_wild

    if plan.suites != ("wild",):
        raise ConfigError("--keep: writes the takes of --suite wild, and of no other")
    rows = [condition.case for condition in plan.conditions()]
    with progress("writing", len(rows) * plan.frames) as advance:
        for row in rows:
            keep_wild(out, row, plan.panels, seed=plan.seed, takes=plan.frames, advance=advance)
