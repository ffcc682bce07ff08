"""Pictures that were made to bring a decoder down: cameras, panels and scenes.

Each scene has a few of the KINDS of hostile_pictures.py, one of them by turns: packed grids, panes, keyboards, 128
squares, LED matrices, text, noise and so on. Their parts are steady, or blink as panels do, and they move from frame to
frame. Half of the scenes are easy otherwise, with a panel that can be read: so what follows panels is attacked, too.
Camera, lens, dictionary and method are drawn.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import numpy as np

from evaluation.endurance.hostile_pictures import KINDS, Drawing, Rng, panel, readable
from ledpi.camera.base import frame_by
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Method
from ledpi.core.records import CameraInfo, Decoded, Floats, Frame, Intrinsics, PanelSpec, Transfer
from ledpi.core.shutter import row_weights
from ledpi.pipeline.pipeline import Pipeline

USUAL_SIZE = (640, 480)
SIZES = (USUAL_SIZE, (320, 240), (1296, 972), (64, 48), (33, 35), (1, 1), (640, 1), (1, 480), (4000, 9), (2592, 1944))
SIZE_SHARES = (0.35, 0.25, 0.1, 0.1, 0.05, 0.03, 0.03, 0.03, 0.03, 0.03)
EXPOSURES_US, EXPOSURE_SHARES = (10_000.0, 600.0, 150.0, 1.0, 100_000.0), (0.3, 0.3, 0.3, 0.05, 0.05)
USUAL_EXPOSURES_US, USUAL_ROW_TIME_US = EXPOSURES_US[:3], 33.67
ROW_TIMES_US, ROW_TIME_SHARES = (USUAL_ROW_TIME_US, 18.0, 10.0, 3.0), (0.7, 0.1, 0.1, 0.1)
DICTIONARIES, DICTIONARY_SHARES = ("DICT_4X4_50", "DICT_4X4_1000", "DICT_6X6_250", "DICT_7X7_250"), (0.5, 0.2, 0.2, 0.1)
USUAL_GAP_NS = 16_900_000  # from a frame to the next
GAPS_NS = (1, 1_000_000, USUAL_GAP_NS, 33_000_000, 10**10)
FOCAL_WIDTHS = (1.0, 1.0, 1.0, 0.2, 9.0)
DISTORTIONS, DISTORTION_SHARES = (0.0, 0.1, 1000.0), (0.5, 0.4, 0.1)  # coefficients, up to
MAX_FRAMES = 8  # of a scene


def draw_camera(rng: Rng, *, easy: bool) -> CameraInfo:
    """Any size, exposure, rows and lens; or a usual one."""
    width, height = USUAL_SIZE if easy else SIZES[rng.choice(len(SIZES), p=SIZE_SHARES)]
    lens = None
    if easy:
        lens = Intrinsics(width=width, height=height, fx=width, fy=width, cx=width / 2, cy=height / 2)
    elif rng.random() < 0.8:
        focal = rng.choice(FOCAL_WIDTHS) * width
        k1, k2, p1, p2, k3 = rng.choice(DISTORTIONS, p=DISTORTION_SHARES) * rng.uniform(-1, 1, 5)
        cx, cy, distortion = width / 2, height / 2, (k1, k2, p1, p2, k3)
        lens = Intrinsics(width=width, height=height, fx=focal, fy=focal, cx=cx, cy=cy, distortion=distortion)
    return CameraInfo(
        width=width,
        height=height,
        exposure_us=float(rng.choice(USUAL_EXPOSURES_US) if easy else rng.choice(EXPOSURES_US, p=EXPOSURE_SHARES)),
        row_time_us=USUAL_ROW_TIME_US if easy else float(rng.choice(ROW_TIMES_US, p=ROW_TIME_SHARES)),
        transfer="linear" if easy else rng.choice(get_args(Transfer)),
        intrinsics=lens,
    )


def draw_panels(rng: Rng) -> PanelSettings:
    """Any dictionary; a fifth in antiphase."""
    panels = PanelSettings(side_m=0.16, dictionary=str(rng.choice(DICTIONARIES, p=DICTIONARY_SHARES)))
    antiphase = {"black_hz": 1250.0, "white_hz": 1250.0, "phase": "antiphase"}
    return panels.model_copy(update=antiphase) if rng.random() < 0.2 else panels


def draw_picture(camera: CameraInfo, dictionary: str, rng: Rng, kind: int, *, easy: bool) -> Drawing:
    """One of the KINDS, or more."""
    drawing = Drawing(camera.width, camera.height, dictionary)
    if not easy and rng.random() < 0.5:
        panel(drawing, rng)
    KINDS[kind](drawing, rng)
    for _ in range(rng.integers(0, 3)):
        KINDS[rng.integers(len(KINDS))](drawing, rng)
    if easy:
        readable(drawing, rng)
    return drawing


def frames(camera: CameraInfo, panels: PanelSettings, rng: Rng, kind: int, *, easy: bool) -> Iterator[Frame]:
    """A scene, a few times, as it moves and blinks; at the frequencies that are looked for, or beside them."""
    drawing = draw_picture(camera, panels.dictionary, rng, kind, easy=easy)
    off = 1.0 if easy else rng.choice((1.0, 1.001, 1.03))
    blink = Blink(panels.spec(), camera, off=off, phases=rng.random(2))
    dark, sigma = (0.02, 0.005) if easy else (rng.choice((0.0, 0.02, 0.3)), rng.choice((0.0, 0.005, 0.05)))
    # Most easy scenes are as quiet as a stream is, so that panels are followed; the others jump about.
    quiet, at_ns = rng.random() < (0.8 if easy else 0.4), 0
    shift = rng.integers(-1, 2, 2) if quiet else rng.integers(-60, 61, 2)
    for seq in range(rng.integers(1, MAX_FRAMES + 1)):
        steady, *waves = (np.roll(layer, seq * shift, (0, 1)) for layer in drawing.light)
        light = dark + steady + sum(w * rows[:, None] for w, rows in zip(waves, blink.weights(at_ns), strict=True))
        light += sigma * rng.standard_normal(light.shape, np.float32)
        yield frame_by(camera, np.rint(255 * np.clip(light, 0, 1)).astype(np.uint8), seq, at_ns)
        at_ns += USUAL_GAP_NS if quiet else int(rng.choice(GAPS_NS))


@dataclass(frozen=True)
class Blink:
    """The brightness of either class in each row."""

    spec: PanelSpec
    camera: CameraInfo
    off: float  # by which factor the frequencies differ
    phases: Floats  # cycles, of either class at time 0

    def weights(self, at_ns: int) -> list[Floats]:
        """Returns those of black, and of white, in a frame that is read out from `at_ns` on."""
        antiphase = self.spec.phase == "antiphase"
        phases = (self.phases[0], self.phases[0] + 0.5) if antiphase else self.phases
        return [
            row_weights(
                np.arange(self.camera.height, dtype=np.float64),
                frequency_hz=self.off * hz,
                phase_cycles=(phase + self.off * hz * at_ns * 1e-9) % 1.0,
                duty=self.spec.duty,
                exposure_us=self.camera.exposure_us,
                row_time_us=self.camera.row_time_us,
            )
            for hz, phase in zip((self.spec.black_hz, self.spec.white_hz), phases, strict=True)
        ]


def attack(seed: int, number: int) -> Iterator[Decoded]:
    """Yields what each frame of a scene has come to."""
    rng = np.random.default_rng((seed, number))
    easy = bool(rng.random() < 0.5)
    camera, panels = draw_camera(rng, easy=easy), draw_panels(rng)
    method: Method = "uemura" if panels.phase == "free" and rng.random() < 0.1 else "likelihood"
    stream = bool(rng.random() < 0.8)
    pipeline = Pipeline(camera, panels, intrinsics=camera.intrinsics, method=method, stream=stream)
    yield from map(pipeline.decode, frames(camera, panels, rng, number % len(KINDS), easy=easy))
