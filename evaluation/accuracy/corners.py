"""Errors of simulated panels' corners and poses, by distance: without reading them, so that none is left out.

Each take has its own place, roll, room, brightness, cell gains and word. The case is one of the suite `robustness` of
`ledpi evaluate`.

    python -m evaluation.accuracy corners [--case "an edge hidden"] [--takes 30] [--transfer linear] [--angle 20]
        [DISTANCE…]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from evaluation.suites.conditions import VARIATIONS, Condition
from evaluation.suites.draw import draw_take
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected
from ledpi.decode.locate import Locator
from ledpi.decode.proposals import Proposer
from ledpi.pose.planar import solve_square
from ledpi.simulate.render import Renderer
from ledpi.tools.evaluate.reading import FRAMES_A_TAKE, Found, Read
from ledpi.tools.evaluate.scoring import Expected, Tally
from ledpi.tools.evaluate.table import PLAIN

SEQ = FRAMES_A_TAKE // 2  # where a moving camera is in the middle of its take
WRONG = 0.25  # of the side: what is further off is something else


def nearest_square(frame: Frame, true: Floats, lens: Intrinsics, spec: PanelSpec) -> tuple[Floats, Floats] | None:
    """Corners in the order of the true ones, and their covariance; None where no square is near."""
    camera = CameraInfo(
        width=lens.width,
        height=lens.height,
        exposure_us=frame.exposure_us,
        row_time_us=frame.row_time_us,
        transfer=frame.transfer,
    )
    proposed, _ = Proposer(camera, 4, [spec]).propose(frame)
    starts = [at for candidate in proposed for at in (candidate.corners_px, *candidate.moved_ends())]
    locator = Locator(4, (spec,), lens)
    quads = [locator.localise(frame, at) for at in starts]
    found = [
        (np.roll(quad.corners_px, turn, axis=0), np.roll(quad.covariance_px2, (2 * turn, 2 * turn), axis=(0, 1)))
        for quad in quads
        if isinstance(quad, Quad) and quad.covariance_px2 is not None
        for turn in range(4)
    ]
    best = min(found, key=lambda one: float(np.abs(one[0] - true).max()), default=None)
    side = float(np.linalg.norm(true[1] - true[0]))
    return best if best is not None and np.abs(best[0] - true).max() < WRONG * side else None


def judge(condition: Condition, panels: PanelSettings, number: int, tally: Tally) -> Iterator[tuple[float, float]]:
    """Yields of each panel of a take: size off in percent, stated variance of a coordinate; adds to `tally`."""
    take = draw_take(condition, panels, 1, number)
    renderer, lens = Renderer(take.scene, seed=take.seed), take.scene.sensor.intrinsics
    frame = renderer.frame(SEQ)
    for marker in renderer.truth(SEQ):
        spec = panels.spec(marker.id)
        square = nearest_square(frame, marker.corners_px, lens, spec)
        if square is None:
            continue
        corners, covariance_px2 = square
        solved = solve_square(corners, covariance_px2, spec.side_m, lens)
        if isinstance(solved, Rejected):
            continue
        found = Found(id=marker.id, corners_px=corners, pose=solved[0].camera_from_marker)
        tally.add(Read(found=(found,), dropped=(), milliseconds=0.0), [Expected.from_truth(marker)], "")
        size = np.ptp(corners, axis=0).mean() / np.ptp(marker.corners_px, axis=0).mean() - 1
        yield 100 * float(size), float(np.trace(covariance_px2)) / 8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("distances", nargs="*", type=float, default=[0.6, 1.0, 2.0, 3.0, 4.0, 5.0, 8.0], metavar="M")
    parser.add_argument("--case", default=PLAIN, choices=list(VARIATIONS))
    parser.add_argument("--takes", type=int, default=30)
    parser.add_argument("--transfer", default="srgb", choices=["srgb", "linear"])
    parser.add_argument("--angle", type=float, default=20.0)
    parser.add_argument("--exposure-us", type=float, default=10_000.0)
    args = parser.parse_args()
    panels = load_config(None, ("panels.side_m=0.16",)).panels
    print("distance  found   size off   corners   90 %    stated/true   position    90 %     angle")
    for distance_m in args.distances:
        condition = Condition(
            suite="robustness",
            case=args.case,
            distance_m=distance_m,
            angle_deg=args.angle,
            exposure_us=args.exposure_us,
            transfer=args.transfer,
            any_roll=True,
        )
        tally = Tally()
        rows = [row for number in range(args.takes) for row in judge(condition, panels, number, tally)]
        if not rows:
            print(f"{distance_m:6g} m   none of {args.takes}")
            continue
        size, stated = np.mean(rows, axis=0)
        rms, position = np.array(tally.corner_px), tally.position_percent
        print(
            f"{distance_m:6g} m  {len(rms):3d}/{args.takes}  {size:+7.2f} %  {np.median(rms):6.3f} px "
            f"{np.quantile(rms, 0.9):6.3f} px {np.sqrt(stated / np.square(rms).mean() * 2):9.2f}    "
            f"{np.median(position):8.3f} % {np.quantile(position, 0.9):8.3f} % {np.median(tally.angle_deg):6.2f}°"
        )


if __name__ == "__main__":
    main()
