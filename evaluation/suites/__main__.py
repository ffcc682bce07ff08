"""`python -m evaluation.suites`: recognition rates of simulated panels, of prints, and of decoys.

Its options are those that `--help` lists. Results go to a folder; docs/evaluating.md explains them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import typer

from evaluation.suites.conditions import Method, Suite
from evaluation.suites.keep import keep_wild, write_take
from evaluation.suites.plan import Plan
from evaluation.suites.readers import has_apriltag
from evaluation.suites.units import code_version, run_on_cluster, run_on_processes
from evaluation.suites.wild_rows import TAKES
from ledpi.cli import main, progress
from ledpi.cli.evaluate import SIDE, method_option, panel_options
from ledpi.cli.simulate import TransferName
from ledpi.config.overrides import METHODS
from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError
from ledpi.core.wording import StrEnum
from ledpi.workshop.evaluate import page
from ledpi.workshop.evaluate.table import TableRow, wilson


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


app = typer.Typer(
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"max_content_width": 120, "help_option_names": ["-h", "--help"]},
)


_TITLES = {
    "paper": "The paper's experiment",
    "beyond": "Beyond the paper",
    "robustness": "Robustness",
    "decoys": "Decoys: nothing may be reported",
    "wild": "Wild: everything varied at once",
}


def section(rows: Sequence[TableRow]) -> list[str]:
    """The title and the tables of the rows of one suite."""
    title = _TITLES[rows[0].suite]
    if rows[0].suite != "decoys":
        return [title, *page.recognised_tables(rows)]
    return [title, page.pivot([*rows, *_totals(rows)], result), *page.false_ids(rows)]


def result(row: TableRow) -> str:
    """The rate; of decoys the false IDs, as if the frames of a take were one: the interval is no promise of less."""
    if row.suite != "decoys":
        return page.rate(row)
    most = 100 * wilson(min(row.false_ids, row.trials), row.trials)[1]
    count = f"**{row.false_ids} false**" if row.false_ids else "0"
    return f"{count} in {row.frames} frames of {row.trials} scenes (below {most:.2g} % of scenes)"


def _totals(rows: Sequence[TableRow]) -> list[TableRow]:
    """One a method, over all kinds of decoys."""
    return [
        replace(
            own[0],
            case="all",
            frames=sum(row.frames for row in own),
            trials=sum(row.trials for row in own),
            false_ids=sum(row.false_ids for row in own),
        )
        for own in page.groups(rows, lambda row: row.method)
    ]


_METHOD = method_option(MethodName, METHODS | {"told": "oracle"}, "all that the suite is for")


@app.command()
def suites(
    out: Path = typer.Option(
        Path("evaluated"), "--out", metavar="DIR", help="Folder for the results. An interrupted run there resumes."
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
    method: list[MethodName] = _METHOD,
    workers: int = typer.Option(0, min=0, help="Processes. Default: one for each core. Only the times depend on it."),
    scheduler: str | None = typer.Option(None, metavar="ADDRESS", help="Run on this dask.distributed cluster."),
    take: int | None = typer.Option(None, min=0, help="Write this take of one condition to DIR, as a recording."),
    keep: Path | None = typer.Option(None, metavar="DIR", help="Write all takes of wild to DIR, as recordings."),
    config: Path | None = typer.Option(
        None, "--config", help="Take the panels from this file. Default: the paper's, 16 cm."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """Measure how often and how exactly simulated panels are read, and what else is taken for one.

    Frames are rendered from a seed. Results go to DIR: results.csv, evaluation.md, plots. An interrupted run resumes.

    Example: python -m evaluation.suites --out far --suite beyond --frames 300 --method likelihood --method stream
    """
    settings = load_config(config, tuple(set_), without_file=(SIDE,))
    chosen: tuple[Suite, ...] = tuple(s.value for s in suite or (SuiteName.PAPER, SuiteName.BEYOND))
    methods: tuple[Method, ...] = tuple(m.value for m in method)
    plan = Plan(
        suites=chosen,
        frames=frames or (TAKES if chosen == ("wild",) else 300),
        seed=seed,
        transfers=tuple(t.value for t in transfer),
        exposures_us=tuple(exposure_us),
        distances_m=tuple(distance),
        angles_deg=tuple(angle),
        cases=tuple(case),
        methods=methods,
        any_roll=roll,
        apriltag=has_apriltag(),
        panels=settings.panels,
        frame_duration_us=None if settings.camera.frame_duration_us == "auto" else settings.camera.frame_duration_us,
        panel_options=tuple(panel_options(config, set_)),
        code=code_version(),
    )
    plan.check()
    if keep is not None:
        _keep(keep, plan)
    elif take is not None:
        _write_take(out, plan, take)
    else:
        _run(out, plan, workers or _cores(), scheduler)


def _run(out: Path, plan: Plan, workers: int, scheduler: str | None) -> None:
    units = plan.units()
    folder = page.ResultsFolder(out, plan.as_json())
    left = [unit for unit in units if unit.key not in folder.finished]
    with progress("evaluating", len(units)) as advance:
        advance(len(units) - len(left))
        with closing(run_on_cluster(left, scheduler) if scheduler else run_on_processes(left, workers)) as records:
            for record in records:
                folder.add(record)
                advance(1)
    rows = plan.rows(folder.finished)
    intro = f"Seed {plan.seed}, {plan.frames} frames a condition, code {plan.code}."
    if not plan.apriltag and any(row.method == "aruco" for row in rows):
        intro += " AprilTag is left out: pupil-apriltags is not installed."
    for note in page.write_results(out, rows, intro, plan.commands, section):
        print(f"ledpi: {note}", file=sys.stderr)
    print(page.summary(rows, result))
    print(f"The tables and the plots: {out / page.PAGE_FILE}")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _write_take(out: Path, plan: Plan, number: int) -> None:
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
    if plan.suites != ("wild",):
        raise ConfigError("--keep: writes the takes of --suite wild, and of no other")
    rows = [condition.case for condition in plan.conditions()]
    with progress("writing", len(rows) * plan.frames) as advance:
        for row in rows:
            keep_wild(out, row, plan.panels, seed=plan.seed, takes=plan.frames, advance=advance)


if __name__ == "__main__":
    main(command=app, name="python -m evaluation.suites")
