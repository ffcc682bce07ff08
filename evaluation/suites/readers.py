"""Readers beside ledpi: one that is told the corners, and of prints OpenCV's ArUco detector and AprilTag's own."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, Literal

import cv2
import numpy as np

from ledpi.camera.simulate.scene import Print, Scene
from ledpi.core.codewords import Bits
from ledpi.core.dictionaries import load_dictionary, opencv_dictionary
from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Pose, Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.history import History, Identity
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.locate import Locator
from ledpi.decode.reader import Reader
from ledpi.pose.corners import independent
from ledpi.pose.planar import solve_square
from ledpi.workshop.evaluate.scoring import Found, Read

Views = Sequence[tuple[Frame, Floats]]  # frames of a stream in order, each with a panel's true corners, (4, 2) px


def observed(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> Iterator[Observation | None]:
    """The light within the true corners; None where no panel fits there."""
    cells = load_dictionary(dictionary).cells_per_side
    locator = Locator(cells, (spec,), lens, must_blink=False)
    for frame, corners_px in views:
        quad = locator.localise(frame, corners_px)
        seen = quad if isinstance(quad, Rejected) else locator.observe(frame, quad)
        yield None if isinstance(seen, Rejected) else seen


def read_with_oracle(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> list[int | None]:
    """The ID that a panel shows in each frame, by all frames until then; None where it is not read.

    Corners are in the marker's order: a codeword that is read rotated counts as none.
    """
    weigher = LightWeigher(load_dictionary(dictionary).cells_per_side, lens)
    reader = Reader([codebook(dictionary, spec)], weigher, decision.FALSE_ID_RATE)
    history = History.empty((spec,))
    read: list[int | None] = []
    for seen in observed(views, lens, dictionary, spec):
        identity = None
        if seen is not None:
            outcome = reader.read(history, seen)
            history, identity = outcome.history, outcome.identity
        upright = isinstance(identity, Identity) and identity.reading.quarter_turns == 0
        read.append(identity.reading.id if isinstance(identity, Identity) and upright else None)
    return read


def oracle_reads(views: Views, lens: Intrinsics | None, dictionary: str, spec: PanelSpec) -> list[Read]:
    """`read_with_oracle` in the form of any other method's readings, the time shared out over the frames."""
    start = time.perf_counter()
    ids = read_with_oracle(views, lens, dictionary, spec)
    milliseconds = 1e3 * (time.perf_counter() - start) / len(views)
    read = []
    for marker_id, (_, corners_px) in zip(ids, views, strict=True):
        found = () if marker_id is None else (Found(id=marker_id, corners_px=corners_px, pose=None),)
        read.append(Read(found=found, dropped=(), milliseconds=milliseconds))
    return read


@lru_cache(maxsize=8)
def codebook(dictionary: str, spec: PanelSpec) -> Codebook:
    """The codewords that can be read."""
    codewords = load_dictionary(dictionary)
    return Codebook.build(list(codewords.readable_ids(spec.phase)), codewords, spec)


Family = Literal["aruco", "apriltag"]

# The most widely used family. Eight modules across, to ArUco's six: finer, but for that with far fewer false IDs.
APRILTAG = "tag36h11"
_OPENCV_APRILTAG = "DICT_APRILTAG_36h11"
# Ink returns about a fifteenth of what paper does.
INK = 0.06
# Of full scale, in the suite wild: a panel's hot spots may saturate, paper that does has lost its edges.
WHITEST_PAPER = 0.8
_CORNER_SIGMA_PX = 0.2  # refined; only weighs the two solutions of the pose


def has_apriltag() -> bool:
    """Tells whether AprilTag's detector is installed (an optional extra)."""
    return importlib.util.find_spec("pupil_apriltags") is not None


def printed_scene(scene: Scene, family: Family, dictionary: str, paper_level: float) -> Scene:
    """The scene with prints in place of its panels.

    The outer edge of a print's black border is where the edge of the panel's lit grid is, its paper as bright as the
    panel's bright bands: at short exposures that is far brighter than a room would light it.
    """
    prints = [
        Print(
            modules=printed_modules(family, dictionary, panel.marker_id),
            width_m=panel.spec.side_m,
            motion=panel.motion,
            white=paper_level,
            black=INK * paper_level,
        )
        for panel in scene.panels
        if panel.marker_id is not None
    ]
    return replace(scene, panels=(), prints=(*scene.prints, *prints))


def printed_id(family: Family, dictionary: str, marker_id: int) -> int:
    """The ID that stands in for a panel's, where the printed family has fewer."""
    return marker_id % len(_known(family, dictionary).bytesList)


def printed_modules(family: Family, dictionary: str, marker_id: int) -> Bits:
    """(n, n) modules of a marker with its black border, True where white."""
    known = _known(family, dictionary)
    side = known.markerSize + 2
    picture = cv2.aruco.generateImageMarker(known, printed_id(family, dictionary, marker_id), side, borderBits=1)
    return np.asarray(picture > 127)


def _known(family: Family, dictionary: str) -> cv2.aruco.Dictionary:
    if family == "aruco":
        return opencv_dictionary(load_dictionary(dictionary))
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _OPENCV_APRILTAG))


class PrintReader:
    """A detector of printed markers, and the pose of what it finds, by the same solver as the panels'."""

    def __init__(
        self, detect: Callable[[Frame], list[tuple[int, Floats]]], side_m: float, intrinsics: Intrinsics
    ) -> None:
        self._detect = detect
        self._side_m = side_m
        self._intrinsics = intrinsics

    def read(self, frame: Frame) -> Read:
        """The markers in the next frame, and how long that took."""
        start = time.perf_counter()
        found = tuple(Found(id=i, corners_px=corners, pose=self._pose(corners)) for i, corners in self._detect(frame))
        return Read(found=found, dropped=(), milliseconds=1e3 * (time.perf_counter() - start))

    def _pose(self, corners_px: Floats) -> Pose | None:
        solved = solve_square(corners_px, independent(_CORNER_SIGMA_PX), self._side_m, self._intrinsics)
        return None if isinstance(solved, Rejected) else solved[0].camera_from_marker


def aruco_reader(dictionary: str, side_m: float, intrinsics: Intrinsics) -> PrintReader:
    """OpenCV's detector with its defaults, and sub-pixel refinement."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = opencv_dictionary(load_dictionary(dictionary))
    detector = cv2.aruco.ArucoDetector(known, parameters)

    def detect(frame: Frame) -> list[tuple[int, Floats]]:
        corners, ids, _ = detector.detectMarkers(frame.pixels)
        every = [] if ids is None else np.ravel(ids).tolist()
        return [(i, np.asarray(quad, np.float64).reshape(4, 2)) for i, quad in zip(every, corners, strict=True)]

    return PrintReader(detect, side_m, intrinsics)


def apriltag_reader(side_m: float, intrinsics: Intrinsics) -> PrintReader:
    """AprilTag's detector with its defaults, but at the picture's full resolution. Needs the extra `suites`."""
    detector = _apriltag_detector()

    def detect(frame: Frame) -> list[tuple[int, Floats]]:
        return [(int(tag.tag_id), _reorder_corners(tag.corners)) for tag in detector.detect(frame.pixels)]

    return PrintReader(detect, side_m, intrinsics)


@cache
def _apriltag_detector() -> Any:
    """One for the whole process, and never freed: the package frees tag families that its detector then looks at."""
    from pupil_apriltags import Detector

    class Kept(Detector):  # type: ignore[misc]  # it has no types
        def __del__(self) -> None:
            pass

    return Kept(families=APRILTAG, nthreads=1, quad_decimate=1.0)


def _reorder_corners(corners: Floats) -> Floats:
    """AprilTag's corners, from the top right anticlockwise and with pixel centres at halves, as OpenCV has them."""
    return np.asarray(corners[[1, 0, 3, 2]] - 0.5, np.float64)
