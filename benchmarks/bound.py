"""How close reading comes to its bound: the share of panels that are read, beside decoders that are told more.

    python benchmarks/bound.py [--takes 24] [--stream] [DISTANCE…]

`ledpi`: the whole path. `true corners`: the same decision on the light within the true corners. `and bands`: also told
how deep the bands are and where in their period, as the true word shows them best, and with all patterns weighed one by
one; what a frame does not tell such a decoder, it tells nobody who knows no more of a panel's cells and diffuser.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ledpi.config import PanelSettings, load_config
from ledpi.decode.cells import sample_cells
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify import rivals, soft
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.words import likeliest
from ledpi.dictionaries import load_dictionary
from ledpi.evaluate.conditions import PLAIN, Condition
from ledpi.evaluate.draw import FRAMES_A_TAKE, draw_take
from ledpi.evaluate.reading import PanelReader
from ledpi.evaluate.units import photographed
from ledpi.records import Quad, Rejected
from ledpi.simulate.sensor import sensor_info
from ledpi.simulate.truth import scene_truth

SHOWN = (4, 12)  # of a stream's frames
CORNER_SIGMA_PX = 0.01  # of true corners
DECODERS = ("ledpi", "true corners", "and bands")


def told_bands(evidence: Evidence, book: Codebook, true: int, rate: float) -> bool:
    """Whether the true word stands against every other pattern of the cells, given the bands that fit it best."""
    cells = book.white.shape[1]
    patterns = (np.arange(2**cells)[:, None] >> np.arange(cells) & 1).astype(np.float64)
    bands = likeliest(evidence, book.white[true : true + 1]).bands
    shown = (band_shares(patterns, len(bands)) * bands).reshape(len(patterns), -1)
    information = evidence.information.reshape(shown.shape[1], -1)
    likelihood = shown @ evidence.score.reshape(-1) - 0.5 * ((shown @ information) * shown).sum(axis=1)
    differ = np.abs(patterns - book.white[true]).sum(axis=1)
    own = likelihood[differ == 0][0]
    other = np.logaddexp.reduce(likelihood[differ > book.correctable])
    return bool(own - other + rivals.prior_odds_of_word(book) >= soft.odds_needed(rate))


def read(condition: Condition, panels: PanelSettings, number: int, *, stream: bool) -> Iterator[dict[str, bool]]:
    """Of each frame of a take, or of one: what each decoder reads."""
    take = draw_take(condition, panels, 1, number)
    sensor = take.scene.sensor
    dictionary = load_dictionary(panels.dictionary)
    book = Codebook.build(dictionary.readable_ids(panels.phase), dictionary, panels.spec())
    rate = soft.FALSE_ID_RATE
    reader = PanelReader("stream" if stream else "soft", sensor_info(sensor, 1.0), panels)
    memory = PanelMemory(book.spec)
    for frame in photographed(take, take.scene, FRAMES_A_TAKE if stream else 1):
        (truth,) = scene_truth(take.scene, frame.seq)
        quad = Quad(corners_px=truth.corners_px, corner_sigma_px=CORNER_SIGMA_PX, bend_px=0.0)
        found = {"ledpi": any(each.id == truth.id for each in reader.read(frame).found)}
        samples = sample_cells(frame, quad, 4, sensor.intrinsics, memory.lattice)
        if isinstance(samples, Rejected):
            yield found
            continue
        memory, _ = memory.after(samples, frame)
        evidence = memory.evidence()
        if memory.frames == 1:
            word = soft.read_word(samples, frame, book, rate)
        else:
            word = soft.decide(evidence, book, rate) if isinstance(evidence, Evidence) else evidence
        found["true corners"] = not isinstance(word, Rejected) and word.id == truth.id
        if isinstance(evidence, Evidence):  # true corners begin at the word's own
            (own,) = np.flatnonzero((book.ids == truth.id) & (book.quarter_turns == 0))
            found["and bands"] = told_bands(evidence, book, int(own), rate)
        yield found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("distances", nargs="*", type=float, metavar="M")
    parser.add_argument("--takes", type=int, default=24)
    parser.add_argument("--stream", action="store_true")
    args = parser.parse_args()
    panels = load_config(None, ("panels.side_m=0.16",)).panels
    print("distance  " + "".join(f"{name:>22}" for name in DECODERS))
    for distance_m in args.distances or ([8.0, 10.0, 12.0] if args.stream else [2.0, 2.5, 3.0]):
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
