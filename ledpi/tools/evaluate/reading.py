"""The methods that are compared, behind one face: a frame in, what was read of it out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

import cv2
import numpy as np

from ledpi.config.panels import PanelSettings
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, PanelValues, Pose, Rejected
from ledpi.markers.dictionaries import load_dictionary, opencv_dictionary
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Dropped, Trace
from ledpi.pose.corners import independent
from ledpi.pose.planar import solve_square
from ledpi.tools.evaluate.prints import APRILTAG

Method = Literal["uemura", "likelihood", "stream", "aruco", "apriltag", "ledpi", "oracle"]
METHODS: tuple[Method, ...] = ("uemura", "likelihood", "stream", "aruco", "apriltag")
WILD_METHODS: tuple[Method, ...] = (
    "ledpi",
    "oracle",
    "aruco",
)  # likelihood or stream as the row asks; oracle: true corners given
PanelMethod = Literal["uemura", "likelihood", "stream"]
PANEL_METHODS: tuple[PanelMethod, ...] = get_args(PanelMethod)
PRINTED: tuple[Method, ...] = ("aruco", "apriltag")

_PRINT_SIGMA_PX = 0.2  # of a refined corner; only weighs the two solutions of the pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A marker that a method reports."""

    id: int
    corners_px: Floats  # (4, 2) in the marker's order
    pose: Pose | None  # camera_from_marker


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """A method's result on one frame."""

    found: tuple[Found, ...]
    dropped: tuple[Dropped, ...]
    milliseconds: float


class PanelReader:
    """The path of the daemon, from the picture to the pose."""

    def __init__(
        self,
        method: PanelMethod,
        camera: CameraInfo,
        panels: PanelSettings,
        source_panel: PanelValues | None = None,
    ) -> None:
        self._pipeline = Pipeline(
            camera,
            panels,
            intrinsics=camera.intrinsics,
            source_panel=source_panel,
            method="uemura" if method == "uemura" else "likelihood",
            stream=method == "stream",
        )

    def read(self, frame: Frame) -> Read:
        """Returns what is found in the next frame, and how long that took."""
        trace = Trace()
        decoded = self._pipeline.decode(frame, trace)
        found = tuple(
            Found(
                id=m.detection.id,
                corners_px=m.detection.corners_px,
                pose=m.solution.camera_from_marker if m.solution is not None else None,
            )
            for m in decoded.markers
        )
        return Read(found=found, dropped=tuple(trace.dropped), milliseconds=sum(decoded.stage_ms.values()))


class PrintReader:
    """A detector of printed markers, and the pose of what it finds, by the same solver as the panels'."""

    def __init__(
        self, detect: Callable[[Frame], list[tuple[int, Floats]]], side_m: float, intrinsics: Intrinsics
    ) -> None:
        self._detect = detect
        self._side_m = side_m
        self._intrinsics = intrinsics

    def read(self, frame: Frame) -> Read:
        """Returns what is found in the next frame, and how long that took."""
        start = time.perf_counter()
        found = [
            Found(id=marker_id, corners_px=corners, pose=self._pose(corners))
            for marker_id, corners in self._detect(frame)
        ]
        return Read(found=tuple(found), dropped=(), milliseconds=1e3 * (time.perf_counter() - start))

    def _pose(self, corners_px: Floats) -> Pose | None:
        solved = solve_square(corners_px, independent(_PRINT_SIGMA_PX), self._side_m, self._intrinsics)
        return None if isinstance(solved, Rejected) else solved[0].camera_from_marker


def aruco_reader(dictionary: str, side_m: float, intrinsics: Intrinsics) -> PrintReader:
    """OpenCV's detector with its defaults, and sub-pixel refinement."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = opencv_dictionary(load_dictionary(dictionary))
    detector = cv2.aruco.ArucoDetector(known, parameters)

    def detect(frame: Frame) -> list[tuple[int, Floats]]:
        corners, ids, _ = detector.detectMarkers(frame.pixels)
        if ids is None:
            return []
        quads = [np.asarray(quad, np.float64).reshape(4, 2) for quad in corners]
        return list(zip((int(i) for i in np.ravel(ids)), quads, strict=True))

    return PrintReader(detect, side_m, intrinsics)


def apriltag_reader(side_m: float, intrinsics: Intrinsics) -> PrintReader:
    """AprilTag's detector with its defaults, but at the picture's full resolution. Needs the extra `evaluate`."""
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
    """AprilTag's corners as OpenCV draws the same tag, from the top left clockwise, pixel centres at integers.

    Its own order is top right, top left, bottom left, bottom right, and its pixel centres are at halves.
    """
    return np.asarray(corners[[1, 0, 3, 2]] - 0.5, np.float64)
