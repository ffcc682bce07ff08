"""Reading beside its bound: the share of panels that are read, and that of decoders that are told more.

    python -m evaluation.accuracy.bound SET [--single] [--skip N]
    python -m evaluation.accuracy.bound [--takes 24] [--stream] [DISTANCE…]

Of the recordings with truth in and below the folder SET: how many panels are read with the true corners given, in
single frames, or in streams of which the first N frames do not count; and how many were when that was frozen, so that
a worse evidence lowers no bar. Of simulated panels, at each distance:

`ledpi`: the whole path. `true corners`: the same decision on the light within the true corners. `and bands`: also told
how deep the bands are and where in their period, as the true word shows them best, and with all patterns weighed one by
one; what a frame does not tell such a decoder, it tells nobody who knows no more of a panel's cells and diffuser.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from evaluation.suites.conditions import Condition
from evaluation.suites.draw import draw_take
from evaluation.suites.readers import codebook, observed, read_with_oracle
from evaluation.suites.units import photographed
from ledpi.camera.recording.reader import FrameEntry, Recording, find_recordings, load_recording
from ledpi.camera.simulate.render import scene_truth
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.errors import LedpiError, RecordingError
from ledpi.core.records import Floats
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify import decision, hypotheses
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE, PanelReader
from ledpi.workshop.evaluate.table import frame_of

SHOWN = (4, 12)  # of a stream's frames
RUN_GAP_NS = 60_000_000  # frames that are further apart belong to two takes
FROZEN = Path(__file__).with_name("bound_frozen.yaml")
DECODERS = ("ledpi", "true corners", "and bands")


def oracle_bands(evidence: Evidence, book: Codebook, true: int, rate: float) -> bool:
    """Tells whether the true word stands against every other pattern of the cells, given the bands that fit it best."""
    cells = book.white.shape[1]
    patterns = (np.arange(2**cells)[:, None] >> np.arange(cells) & 1).astype(np.float64)
    bands = rank_codewords(evidence, book.white[true : true + 1]).bands
    shown = (band_shares(patterns, len(bands)) * bands).reshape(len(patterns), -1)
    information = evidence.information.reshape(shown.shape[1], -1)
    likelihood = shown @ evidence.score.reshape(-1) - 0.5 * ((shown @ information) * shown).sum(axis=1)
    differ = np.abs(patterns - book.white[true]).sum(axis=1)
    own = likelihood[differ == 0][0]
    other = np.logaddexp.reduce(likelihood[differ > book.correctable])
    return bool(own - other + hypotheses.prior_odds_of_codeword(book) >= decision.odds_needed(rate))


def read(condition: Condition, panels: PanelSettings, number: int, *, stream: bool) -> Iterator[dict[str, bool]]:
    """Returns of each frame of a take, or of one, what each decoder reads."""
    take = draw_take(condition, panels, 1, number)
    sensor, spec, (panel,) = take.scene.sensor, panels.spec(), take.scene.panels
    book = codebook(panels.dictionary, spec)
    reader = PanelReader("stream" if stream else "likelihood", sensor_info(sensor, 1.0), panels)
    frames = photographed(take, take.scene, FRAMES_A_TAKE if stream else 1)
    views = [(frame, scene_truth(take.scene, frame.seq)[0].corners_px) for frame in frames]
    told = (views, sensor.intrinsics, panels.dictionary, spec)
    # True corners begin at the word's own.
    (own,) = np.flatnonzero((book.ids == panel.marker_id) & (book.quarter_turns == 0))
    memory, weigher = PanelMemory(spec), LightWeigher(len(panel.codeword), sensor.intrinsics)
    for (frame, _), marker_id, seen in zip(views, read_with_oracle(*told), observed(*told), strict=True):
        found = {
            "ledpi": any(each.id == panel.marker_id for each in reader.read(frame).found),
            "true corners": marker_id == panel.marker_id,
        }
        if seen is not None:
            memory, _ = memory.add_frame(seen, weigher)
            if isinstance(evidence := memory.evidence(weigher), Evidence):
                found["and bands"] = oracle_bands(evidence, book, int(own), decision.FALSE_ID_RATE)
        yield found


class Bound(NamedTuple):
    """Counts of panels wholly in view in the frames that count: how many are read, how many as another's ID."""

    read: int
    wrong: int
    total: int


def bound_of(recording: Recording, *, single: bool, skip: int = 0) -> Bound:
    """`single`: each frame by itself; else by all of its take until then. The first `skip` of a take do not count.

    Raises RecordingError where there is no truth, and where a picture cannot be read.
    """
    right = wrong = total = 0
    told = (recording.camera.intrinsics, recording.dictionary, recording.panel)
    for marker_id, run in _runs(recording, skip):
        if not any(counts for *_, counts in run):
            continue
        seen = [(frame_of(recording, entry), corners_px) for entry, corners_px, _ in run]
        groups = [[view] for view in seen] if single else [seen]
        ids = [each for group in groups for each in read_with_oracle(group, *told)]
        judged = [each for each, (*_, counts) in zip(ids, run, strict=True) if counts]
        right += judged.count(marker_id)
        wrong += len(judged) - judged.count(marker_id) - judged.count(None)
        total += len(judged)
    return Bound(right, wrong, total)


Run = list[tuple[FrameEntry, Floats, bool]]  # of a panel in a take: each view, and whether it counts, wholly in view


def _runs(recording: Recording, skip: int) -> Iterator[tuple[int, Run]]:
    """Each panel in each take, by its ID."""
    if recording.truth is None:
        raise RecordingError(f"{recording.folder}: has no truth.jsonl, which says where its panels are")
    runs: dict[int, Run] = {}
    place, last_ns = 0, -RUN_GAP_NS
    for entry in recording.frames:
        if entry.row0_readout_ns - last_ns >= RUN_GAP_NS:
            yield from runs.items()
            runs, place = {}, 0
        for marker in recording.truth.get(entry.seq, ()):
            counts = place >= skip and not marker.optional
            runs.setdefault(marker.id, []).append((entry, marker.corners_px, counts))
        place, last_ns = place + 1, entry.row0_readout_ns
    yield from runs.items()


def of_recordings(folder: Path, *, single: bool, skip: int) -> None:
    """A line for each recording, then one for each folder of them, or all whose names differ in a number."""
    mode = "single" if single else f"skip {skip}"
    frozen = yaml.safe_load(FROZEN.read_text(encoding="utf-8"))
    then = {name: Bound(*counts) for name, counts in frozen["figures"].get(mode, {}).items()}
    print(f"{'':24}{'true corners given':>24}{'at ' + frozen['commit']:>24}")
    pooled: dict[str, list[tuple[Bound, Bound | None]]] = {}
    for place in find_recordings(folder):
        name, bound = str(place.relative_to(folder)), bound_of(load_recording(place), single=single, skip=skip)
        print(line(name, [(bound, then.get(name))]), flush=True)
        together = f"{name.split('/')[0]}/" if "/" in name else name.rstrip("0123456789")
        pooled.setdefault(f"{together}*", []).append((bound, then.get(name)))
    for name, own in pooled.items():
        if len(own) > 1:
            print(line(name, own))


def line(name: str, bounds: list[tuple[Bound, Bound | None]]) -> str:
    """Today's figures and the frozen ones, each summed up; nothing where one of them was not frozen."""
    known = [then for _, then in bounds if then is not None]
    sums = [[bound for bound, _ in bounds], known if len(known) == len(bounds) else []]
    return f"{name:24}" + "".join(f"{counted(own):>24}" for own in sums)


def counted(bounds: list[Bound]) -> str:
    read, wrong, shown = np.sum(bounds, axis=0) if bounds else (0, 0, 0)
    if not shown:
        return "–"
    return f"{read} of {shown} ({read / shown:.0%})" + (f", {wrong} WRONG" if wrong else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", metavar="SET or M")
    parser.add_argument("--takes", type=int, default=24)
    parser.add_argument("--stream", action="store_true")
    parser.add_argument("--single", action="store_true", help="of a SET: each frame by itself")
    parser.add_argument("--skip", type=int, default=0, help="of a SET: first frames of each take that do not count")
    args = parser.parse_args()
    if args.what and Path(args.what[0]).is_dir():
        try:
            of_recordings(Path(args.what[0]), single=args.single, skip=args.skip)
        except LedpiError as error:
            sys.exit(f"bound: {error}")
        return
    try:
        distances = [float(word) for word in args.what]
    except ValueError as error:
        parser.error(f"must be a folder of recordings, or distances in metres: {error}")
    panels = load_config(None, ("panels.side_m=0.16",)).panels
    print("distance  " + "".join(f"{name:>22}" for name in DECODERS))
    for distance_m in distances or ([8.0, 10.0, 12.0] if args.stream else [2.0, 2.5, 3.0]):
        condition = Condition(suite="beyond", distance_m=distance_m, angle_deg=0.0)
        takes = [list(read(condition, panels, number, stream=args.stream)) for number in range(args.takes)]
        shares = [
            " / ".join(
                f"{np.mean([take[frame - 1].get(name, False) for take in takes]):.0%}"
                for frame in (SHOWN if args.stream else (1,))
            )
            for name in DECODERS
        ]
        print(f"{distance_m:6g} m  " + "".join(f"{share:>22}" for share in shares))


if __name__ == "__main__":
    main()
