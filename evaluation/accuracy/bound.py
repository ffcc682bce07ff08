"""Reading beside its bound: the share of panels that are read, and that of decoders that are told more.

    python -m evaluation.accuracy bound SET [--single] [--skip N]
    python -m evaluation.accuracy bound [--takes 24] [--stream] [DISTANCE…]

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

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

from evaluation.suites.bound import Bound, bound_of
from evaluation.suites.conditions import Condition
from evaluation.suites.draw import draw_take
from evaluation.suites.oracle import read_with_oracle
from evaluation.suites.units import photographed
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.errors import LedpiError
from ledpi.core.records import Rejected
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify import decision, hypotheses
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.locate import Locator
from ledpi.markers.dictionaries import load_dictionary
from ledpi.recording.reader import find_recordings, load_recording
from ledpi.simulate.sensor import sensor_info
from ledpi.simulate.truth import scene_truth
from ledpi.tools.evaluate.reading import FRAMES_A_TAKE, PanelReader
from ledpi.tools.evaluate.table import PLAIN

SHOWN = (4, 12)  # of a stream's frames
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
    sensor, spec = take.scene.sensor, panels.spec()
    dictionary = load_dictionary(panels.dictionary)
    book = Codebook.build(dictionary.readable_ids(panels.phase), dictionary, spec)
    reader = PanelReader("stream" if stream else "likelihood", sensor_info(sensor, 1.0), panels)
    frames = list(photographed(take, take.scene, FRAMES_A_TAKE if stream else 1))
    views = [(frame, scene_truth(take.scene, frame.seq)[0].corners_px) for frame in frames]
    true = take.scene.panels[0].marker_id
    (own,) = np.flatnonzero((book.ids == true) & (book.quarter_turns == 0))  # true corners begin at the word's own
    told = read_with_oracle(views, sensor.intrinsics, panels.dictionary, spec)
    memory, weigher = PanelMemory(book.spec), LightWeigher(4, sensor.intrinsics)
    locator = Locator(4, (spec,), sensor.intrinsics, must_blink=False)
    for (frame, corners_px), marker_id in zip(views, told, strict=True):
        found = {"ledpi": any(each.id == true for each in reader.read(frame).found), "true corners": marker_id == true}
        quad = locator.localise(frame, corners_px)
        seen = quad if isinstance(quad, Rejected) else locator.observe(frame, quad)
        if not isinstance(seen, Rejected):
            memory, _ = memory.add_frame(seen, weigher)
            if isinstance(evidence := memory.evidence(weigher), Evidence):
                found["and bands"] = oracle_bands(evidence, book, int(own), decision.FALSE_ID_RATE)
        yield found


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
        condition = Condition(
            suite="beyond",
            case=PLAIN,
            distance_m=distance_m,
            angle_deg=0.0,
            exposure_us=10_000.0,
            transfer="srgb",
            any_roll=True,
        )
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
