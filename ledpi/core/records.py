"""The records that flow along the path. Frozen, valid once built, arrays read-only.

Pixel centres have integer coordinates. Times are integer nanoseconds of the camera's clock. `camera` is OpenCV's
optical frame (x right, y down, z forward); `marker` is at the panel's centre, x right, y up, z out of the panel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Integers = NDArray[np.int64]
Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Number = TypeVar("Number", bound=np.generic)
Transfer = Literal["linear", "srgb"]
RowsFrom = Literal["above", "below"]
Phase = Literal["free", "antiphase"]  # between a panel's classes
DistortionModel = Literal["plumb_bob", "rational_polynomial", "thin_prism", "equidistant"]  # of a lens, as ROS names it

# Each model's coefficients, in OpenCV's order; lens.c has the equations.
COEFFICIENTS: Mapping[DistortionModel, tuple[str, ...]] = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "thin_prism": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}

# Of a stream: after a longer gap anything may have happened, and all begins anew (the recording format says so).
MAX_GAP_NS = 500_000_000
_NO_PICTURE: Pixels = np.empty((0, 0), np.uint8)


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """A read-only view of `array` (the caller's own reference stays as it is)."""
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """A camera and its lens by one of OpenCV's models, for pictures of `width` × `height`."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)  # as COEFFICIENTS of the model
    distortion_model: DistortionModel = "plumb_bob"

    def __post_init__(self) -> None:
        if len(self.distortion) != len(COEFFICIENTS[self.distortion_model]):
            wanted = " ".join(COEFFICIENTS[self.distortion_model])
            raise ValueError(
                f"distortion of {self.distortion_model} must be {wanted}, not {len(self.distortion)} numbers"
            )
        values = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not all(np.isfinite(values)) or self.fx <= 0 or self.fy <= 0:
            raise ValueError("intrinsics: fx and fy must be positive and every value finite")

    def mirrored(self) -> Intrinsics:
        """The lens that makes the same pictures with left and right exchanged: terms that are even in x change sign."""
        values = dict(zip(COEFFICIENTS[self.distortion_model], self.distortion, strict=True))
        turned = tuple(-value if name in ("p2", "s1", "s2") else value for name, value in values.items())
        return replace(self, cx=self.width - 1 - self.cx, distortion=turned)

    def matrix(self) -> Floats:
        """The 3 × 3 camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelSpec:
    """A panel as built: how large it is and how its two classes of cells blink."""

    side_m: float  # outer edge of the lit grid
    black_hz: float  # cells that are 0 in the dictionary's word
    white_hz: float  # cells that are 1
    duty: float = 0.5
    phase: Phase = "free"  # antiphase: both classes blink at one frequency, half a cycle apart

    def __post_init__(self) -> None:
        if not self.side_m > 0:
            raise ValueError(f"side_m must be positive, not {self.side_m}")
        if not (self.black_hz > 0 and self.white_hz > 0):
            raise ValueError("black_hz and white_hz must be positive")
        if not 0 < self.duty < 1:
            raise ValueError(f"duty must lie between 0 and 1, not {self.duty}")
        antiphase = self.phase == "antiphase"
        if not antiphase and self.black_hz == self.white_hz:
            raise ValueError(
                f"black_hz and white_hz must differ, both are {self.black_hz:g}; one frequency for both classes is for "
                "phase: antiphase"
            )
        if antiphase and self.black_hz != self.white_hz:
            raise ValueError(
                f"phase: antiphase is for both classes at one frequency; black_hz and white_hz must be equal, not "
                f"{self.black_hz:g} and {self.white_hz:g}"
            )
        if antiphase and self.duty != 0.5:  # else white's wave is not black's negative
            raise ValueError(f"phase: antiphase needs a duty of 0.5, not {self.duty:g}")

    @property
    def waves_hz(self) -> tuple[float, ...]:
        """The frequency of each wave: black's and white's; in antiphase black's, which is white's upside down."""
        return (self.black_hz,) if self.phase == "antiphase" else (self.black_hz, self.white_hz)

    def blinking(self) -> str:
        """Says in words how it blinks."""
        hz = " and ".join(f"{hz:g}" for hz in self.waves_hz)
        return f"{hz} Hz in antiphase" if self.phase == "antiphase" else f"{hz} Hz"

    def retune(self, waves_hz: Sequence[float]) -> PanelSpec:
        """The panel with other frequencies of its waves."""
        return replace(self, black_hz=waves_hz[0], white_hz=waves_hz[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """All that is known of a camera once it is configured, or of the one that made a recording."""

    width: int
    height: int
    exposure_us: float
    row_time_us: float
    transfer: Transfer
    frame_length_rows: int | None = None  # rows in a frame's period, blanking included, where known
    intrinsics: Intrinsics | None = None  # where the source itself knows (a recording, the simulator)
    rows_from: RowsFrom = "above"  # which of the picture's rows are read out first

    @property
    def frame_period_ms(self) -> float:
        """Between two frames; without blanking where that is not known."""
        return (self.frame_length_rows or self.height) * self.row_time_us * 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelValues(PanelSpec):
    """Values of panels that their source knows; a recording's own override the configuration's."""

    dictionary: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One picture with everything that is known of how it was exposed."""

    pixels: Pixels  # (H, W), read-only; (0, 0) where only the times are kept
    seq: int
    row0_readout_ns: int  # start of row 0's read-out; row 0's exposure began exposure_us earlier
    exposure_us: float
    row_time_us: float  # between the starts of two rows; negative where the last row is read out first
    transfer: Transfer
    analogue_gain: float | None = None
    host_offset_ns: int = 0  # what to add to the camera's clock to get this machine's CLOCK_MONOTONIC

    def __post_init__(self) -> None:
        if self.pixels.ndim != 2 or self.pixels.dtype != np.uint8:
            raise ValueError(f"pixels must be (H, W) uint8, not {self.pixels.shape} {self.pixels.dtype}")
        if not (self.exposure_us > 0 and self.row_time_us != 0):
            raise ValueError("exposure_us must be positive, and row_time_us not zero")
        # Row after row without gaps, as C reads it; a part of another picture is copied.
        object.__setattr__(self, "pixels", np.ascontiguousarray(self.pixels))
        self.pixels.flags.writeable = False

    def turned(self) -> Frame:
        """The same picture, as one that was turned by 180° after it was read out: its last row came first."""
        scan_ns = round((self.pixels.shape[0] - 1) * self.row_time_us * 1e3)
        return replace(self, row0_readout_ns=self.row0_readout_ns + scan_ns, row_time_us=-self.row_time_us)

    def drop_picture(self) -> Frame:
        """Returns what may be kept of it: the picture's room will hold another."""
        return replace(self, pixels=_NO_PICTURE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejected:
    """Something that was looked at and dropped: where, and why. Counted, never raised."""

    stage: str
    reason: str

    @property
    def key(self) -> str:
        """The counter's name, as in `find.too_small`."""
        return f"{self.stage}.{self.reason}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Quad:
    """A lit, four-sided thing in the picture that may be a panel."""

    corners_px: Floats  # (4, 2), clockwise as seen in the picture
    covariance_px2: Floats | None = None  # (8, 8) of the corners' coordinates, x and y of each; None: not measured
    lattice_px: Floats | None = None  # (4, 2) corners of the lattice of its cells, where that ends elsewhere
    blur_px: Floats | None = None  # (2,) deviation of its picture's blur, along x and y
    unknown: Floats | None = None  # what its picture was fitted with, as `decode.model.prior` has it
    residual: float = 0.0  # mean square of what its fit leaves, over the noise that so much light has
    hidden: Floats | None = None  # (4,) how many cells something hides along each side, from one corner to the next


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """A panel that was read."""

    id: int
    corners_px: Floats  # (4, 2): top left, top right, bottom right, bottom left of the marker as its ID is drawn
    covariance_px2: Floats  # (8, 8) of the corners' coordinates, x and y of each
    margin: float  # natural-log likelihood ratio to the best explanation that is not this ID
    frames_used: int
    blur_px: Floats | None = None  # (2,) deviation of its picture's blur, along x and y
    velocity_px_s: Floats | None = None  # (4, 2) of the corners, where they were followed
    velocity_covariance: Floats | None = None  # (8, 8) px²/s²; None: exact


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """`a_from_b`: where frame b is in frame a, and how sure that is."""

    position_m: Floats  # (3,)
    quaternion_wxyz: Floats  # (4,), unit length
    covariance: Floats | None = None  # (6, 6): x y z (m²), rotation about x y z (rad²), fixed axes of a, as ROS


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanarSolution:
    """One of the two poses that a square's four corners allow."""

    camera_from_marker: Pose
    reprojection_px: float  # rms over the four corners
    chi2: float  # the corners' squared residuals over their variances, 8 of them less 6 that the pose takes up


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerPose:
    """A detection with its place. `solution` is None where the camera is not calibrated."""

    detection: Detection
    mid_exposure_ns: int  # of the panel's centre row
    solution: PlanarSolution | None
    alternate: PlanarSolution | None  # the other planar solution, where it cannot be excluded


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotFix:
    """map_from_base_link, solved from the panels in view."""

    map_from_base_link: Pose
    mid_exposure_ns: int
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyPose:
    """A thing that carries panels, and where it is by those of them that are in view."""

    name: str
    id: int  # beyond those of panels
    camera_from_body: Pose
    mid_exposure_ns: int
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoded:
    """All that one frame gave."""

    seq: int
    row0_readout_ns: int
    host_offset_ns: int  # as the frame's
    markers: tuple[MarkerPose, ...]
    robot: RobotFix | None
    rejected: tuple[Rejected, ...]
    stage_ms: dict[str, float]  # time spent, by stage, in the order of the path
    bodies: tuple[BodyPose, ...] = ()
    diary: tuple[str, ...] = ()  # lines of controller.jsonl that came up since the frame before


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapPanel:
    """A panel's place, and how well that is known."""

    map_from_marker: Floats  # (4, 4)
    side_m: float | None = None  # None: as the configuration says
    position_sigma_m: float = 0.0  # along each axis
    angle_sigma_rad: float = 0.0  # about each axis


PanelMap = Mapping[int, MapPanel]  # by ID
