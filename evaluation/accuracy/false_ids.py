"""Recognition against false IDs, one frame alone, by distance: what each rate that could be asked for costs and buys.

Each take is another scene (`ledpi evaluate`'s suite beyond, any roll). What its panel shows is judged against itself, a
word of DICT_4X4_50; and, as if that dictionary had other words, against each of the 120 patterns that differ from it in
two cells and 120 of those that differ in three. These judgements are of decoys: panels that are two or three cells off.

All patterns that are no word of DICT_4X4_50, evenly, have 0.39 words at two cells and 1.8 at three, and so many chances
to be taken for one.

Then the decoys of `ledpi evaluate` that are mistaken most, near-words and mirrored words of any size, as they are.

    python -m evaluation.accuracy.false_ids [--takes 100] [--decoys 100] [--seed 0] [--exposure-us 10000] [DISTANCE…]
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from itertools import combinations

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from evaluation.suites.conditions import Condition
from evaluation.suites.draw import Take, draw_take
from evaluation.suites.units import photographed
from ledpi.camera.simulate.render import scene_truth
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.codewords import Bits
from ledpi.core.dictionaries import load_dictionary
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.one_frame import read_frame
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import SquareTrace, Trace

CELLS, WORDS = 16, 200  # of DICT_4X4_50, each word turned four ways
# How many of its words there are at a distance of two and of three cells from a pattern two or more away from all.
CHANCES = {2: WORDS * 120 / 62_136, 3: WORDS * 560 / 62_136}
RATES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


def looked_at(
    settings: PanelSettings, condition: Condition, seed: int, number: int
) -> tuple[Take, LightWeigher, list[SquareTrace]]:
    """A take, what weighs its light, and what was made of each lit square in its first frame."""
    take = draw_take(condition, settings, seed, number)
    frame = next(photographed(take, take.scene, 1))
    info, trace = sensor_info(take.scene.sensor, 1.0), Trace()
    Pipeline(info, settings, intrinsics=info.intrinsics, stream=False).decode(frame, trace)
    cells = load_dictionary(settings.dictionary).cells_per_side
    return take, LightWeigher(cells, info.intrinsics), trace.squares


def panel_in(take: Take, squares: list[SquareTrace]) -> tuple[SquareTrace, Bits] | None:
    """The look at a take's panel, and what that shows as it is turned there; None where it was not found."""
    true, codeword = scene_truth(take.scene, 0)[0].corners_px, take.scene.panels[0].codeword
    for square in squares:
        off = [np.abs(np.roll(true, turns, axis=0) - square.quad.corners_px).max() for turns in range(4)]
        if min(off) < 0.1 * np.linalg.norm(true[1] - true[0]):
            return square, np.rot90(codeword, -int(np.argmin(off))).ravel()
    return None


def rates_met(square: SquareTrace, codebook: Codebook, weigher: LightWeigher) -> int:
    """At how many of RATES what is seen is taken for a word, beginning with the highest."""
    for met, rate in enumerate(RATES):
        if not isinstance(read_frame(square.seen, codebook, weigher, rate), Reading):
            return met
    return len(RATES)


def with_word(codeword: Bits, settings: PanelSettings) -> Codebook:
    """As of a dictionary of as many words as DICT_4X4_50, all others as far from this one as can be."""
    far = np.repeat(~codeword[None], WORDS - 1, axis=0)
    return Codebook(
        ids=np.array([0] + [1] * (WORDS - 1)),
        quarter_turns=np.zeros(WORDS, np.int64),
        white=np.concatenate([codeword[None], far]).astype(np.float32),
        correctable=1,
        spec=settings.spec(),
    )


def changed(codeword: Bits, cells: int, most: int, rng: np.random.Generator) -> list[Bits]:
    """Patterns that differ from a word in so many cells."""
    every = [list(each) for each in combinations(range(CELLS), cells)]
    chosen = rng.permutation(len(every))[:most]
    return [codeword ^ np.isin(np.arange(CELLS), every[i]) for i in chosen.tolist()]


def print_distance(settings: PanelSettings, condition: Condition, takes: int, seed: int) -> None:
    """A line for each rate."""
    own: list[int] = []
    others: dict[int, list[int]] = {2: [], 3: []}
    rng = np.random.default_rng(seed)
    for number in range(takes):
        take, weigher, squares = looked_at(settings, condition, seed, number)
        panel = panel_in(take, squares)
        if panel is None:
            own.append(0)
            continue
        square, codeword = panel
        own.append(rates_met(square, with_word(codeword, settings), weigher))
        for cells, met in others.items():
            met += [
                rates_met(square, with_word(each, settings), weigher) for each in changed(codeword, cells, 120, rng)
            ]
    for n, rate in enumerate(RATES):
        share = {cells: float(np.mean(np.array(met) > n)) for cells, met in others.items()}
        every = sum(CHANCES[cells] * share[cells] for cells in share)
        taken = " | ".join(f"{of:.1e}" for of in (*share.values(), every))
        print(f"| {condition.distance_m:g} m | {rate:.0e} | {np.mean(np.array(own) > n):.1%} | {taken} |", flush=True)


def print_decoys(settings: PanelSettings, condition: Condition, takes: int, seed: int) -> None:
    """A line for each rate."""
    dictionary = load_dictionary(settings.dictionary)
    codebook = Codebook.build(list(range(len(dictionary.codewords))), dictionary, settings.spec())
    met: list[int] = []
    for number in range(takes):
        _, weigher, squares = looked_at(settings, condition, seed, number)
        met += [rates_met(square, codebook, weigher) for square in squares]
    for n, rate in enumerate(RATES):
        taken = int((np.array(met) > n).sum())
        print(f"| {condition.case} | {rate:.0e} | {taken} of {len(met)} | {taken / len(met):.1e} |", flush=True)


def main() -> None:
    """Two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("distances", nargs="*", type=float, default=[1.4, 2.0, 2.5, 3.0], metavar="DISTANCE")
    parser.add_argument("--takes", type=int, default=100, help="at each distance")
    parser.add_argument("--decoys", type=int, default=100, help="takes of each kind, 3 to 6 things in each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--exposure-us", type=float, default=10_000.0)
    asked = parser.parse_args()
    settings = load_config(None, ("panels.side_m=0.16",)).panels
    plain = Condition(suite="beyond", angle_deg=0.0, exposure_us=asked.exposure_us)
    print("| distance | rate asked for | recognised | decoys 2 cells off | 3 cells off | all patterns |")
    print("|---|---|---|---|---|---|")
    for distance_m in asked.distances:
        print_distance(settings, replace(plain, distance_m=distance_m), asked.takes, asked.seed)
    print("\n| decoys | rate asked for | taken for a word | share |\n|---|---|---|---|")
    for kind in ("near_words", "mirrored") if asked.decoys else ():
        decoy = replace(plain, suite="decoys", case=kind, angle_deg=None)
        print_decoys(settings, decoy, asked.decoys, asked.seed)


if __name__ == "__main__":
    main()
