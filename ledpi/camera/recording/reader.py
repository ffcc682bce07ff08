"""A recording: a folder of pictures with all that is known of how they were exposed. Found and read here.

`recording.yaml` holds the camera's and the panel's values, `frames.jsonl` a line a frame, `frames/NNNNNN.png`
the 8-bit grey pictures, `truth.jsonl`, if present, what is to be seen in them. Gaps in `seq` and jumps
forward in time are legal: a recording may hold several takes. Time never runs backward.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ledpi.camera.recording.format import (
    FRAMES_FILE,
    HEADER_FILE,
    TRUTH_FILE,
    CameraSection,
    FrameLine,
    TruthLine,
    TruthLineMarker,
    read_header,
    read_lines,
)
from ledpi.camera.recording.picture import BadPicture, read_picture
from ledpi.config.values import check_cycles_fit, check_lens
from ledpi.core.errors import RecordingError, raising
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, PanelSpec, PanelValues, Pixels, Pose, read_only
from ledpi.core.shutter import RowClock

_LENS_KEYS = ("fx", "fy", "cx", "cy", "distortion")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEntry:
    """One line of frames.jsonl."""

    seq: int
    picture: Path
    row0_readout_ns: int  # `sensor_timestamp_ns` in the file: start of row 0's read-out, camera's clock
    exposure_us: float
    analogue_gain: float | None = None
    decoded: bool | None = None  # while it was recorded; None: not known
    search_budget: int | None = None  # that the decoder had for it then


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthMarker:
    """A panel that is in the picture, as the recording's maker knows it."""

    id: int
    corners_px: Floats  # (4, 2), as seen: top left, top right, bottom right, bottom left of the marker
    camera_from_marker: Pose | None  # at the mid-exposure of the panel's centre row, where it is known
    optional: bool = False  # only partly in view: may be reported or not


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A recording whose description is valid. Its pictures are read one by one."""

    folder: Path
    camera: CameraInfo
    dictionary: str
    panel: PanelSpec
    frames: tuple[FrameEntry, ...]  # at least one; seq and time strictly increasing
    truth: Mapping[int, tuple[TruthMarker, ...]] | None  # by seq
    wall_clock_offset_ns: int | None = None  # what to add to its times to get Unix time, where that is known
    row_time_ratio: float = 1.0  # of `camera` and `frames`, corrected, over what the files say: 1 unless they misreport

    @property
    def panel_values(self) -> PanelValues:
        """The panels that it shows."""
        return PanelValues(dictionary=self.dictionary, **asdict(self.panel))

    def read(self, entry: FrameEntry) -> Frame | BadPicture:
        """The frame of `entry`, in pixels of its own; or why its picture cannot be read."""
        pixels = np.empty((self.camera.height, self.camera.width), np.uint8)
        return read_picture(entry.picture, pixels) or self.frame(entry, pixels)

    def frame(self, entry: FrameEntry, pixels: Pixels, *, host_offset_ns: int = 0) -> Frame:
        """The frame of `entry`, once `pixels` (H, W) hold its picture; marks `pixels` read-only."""
        return Frame(
            pixels=pixels,
            seq=entry.seq,
            row0_readout_ns=entry.row0_readout_ns,
            exposure_us=entry.exposure_us,
            row_time_us=self.camera.row_time_us,
            transfer=self.camera.transfer,
            analogue_gain=entry.analogue_gain,
            host_offset_ns=host_offset_ns,
        )


def find_recordings(folder: Path) -> tuple[Path, ...]:
    """The recordings in and below `folder`, sorted; also broken ones, so that none is passed over in silence.

    Raises RecordingError where `folder`, or a folder in it, cannot be read.
    """

    def unreadable(error: OSError) -> None:
        raise RecordingError(f"{error.filename}: cannot be read as a folder: {error.strerror}")

    found = []
    for place, subfolders, files in os.walk(folder, onerror=unreadable):
        if HEADER_FILE in files or FRAMES_FILE in files:
            found.append(Path(place))
            subfolders.clear()
    return tuple(sorted(found))


def load_recording(folder: Path, *, as_reported: bool = False) -> Recording:
    """Reads and checks a recording's description (not its pictures).

    `as_reported`: with the driver's row time, as it was live; a stream finds out by itself where that is wrong.
    Raises RecordingError naming the file, the line or key, what is wrong, and what would be right.
    """
    path = folder / HEADER_FILE
    header = read_header(path)
    with raising(f"{path}: panel", RecordingError):
        panel = PanelSpec(**header.panel.model_dump(exclude={"dictionary"}))
    camera = _camera_info(header.camera, path)
    with raising(f"{path}: panel", RecordingError):
        check_cycles_fit(panel.waves_hz, camera.row_time_us)
    frames, cut_off = _load_frames(folder)
    clock = RowClock(camera)
    for entry in frames:
        clock.add(entry.seq, entry.row0_readout_ns)
    if clock.ratio != 1.0 and not as_reported:
        camera = clock.corrected(camera)
        frames = tuple(replace(entry, exposure_us=entry.exposure_us * clock.ratio) for entry in frames)
    return Recording(
        folder=folder,
        camera=camera,
        dictionary=header.panel.dictionary,
        panel=panel,
        frames=frames,
        truth=_load_truth(folder / TRUTH_FILE, [entry.seq for entry in frames], cut_off),
        wall_clock_offset_ns=header.wall_clock_offset_ns,
        row_time_ratio=1.0 if as_reported else clock.ratio,
    )


def _camera_info(section: CameraSection, path: Path) -> CameraInfo:
    values = section.model_dump()
    model, lens = values.pop("distortion_model"), {key: values.pop(key) for key in _LENS_KEYS}
    missing = [key for key, value in lens.items() if value is None]
    if not missing:
        try:
            check_lens(section.width, section.height, **{key: lens[key] for key in ("fx", "fy", "cx", "cy")})
        except ValueError as error:
            raise RecordingError(f"{path}: camera.{error}") from None
        intrinsics = Intrinsics(width=section.width, height=section.height, **lens, distortion_model=model)
        return CameraInfo(**values, intrinsics=intrinsics)
    if len(missing) < len(lens):
        wanted = ", ".join(_LENS_KEYS)
        raise RecordingError(f"{path}: camera.{missing[0]}: is missing; give all of {wanted}, or none")
    return CameraInfo(**values)


def _load_frames(folder: Path) -> tuple[tuple[FrameEntry, ...], bool]:
    """The frames, and whether the file's end is missing."""
    path = folder / FRAMES_FILE
    entries: list[FrameEntry] = []
    lines, cut_off = read_lines(path, FrameLine, partial(frame_entry, folder))
    for number, entry in lines:
        if entries:
            check_order(entries[-1], entry, f"{path}: line {number}")
        entries.append(entry)
    if not entries:
        raise RecordingError(f"{path}: is empty; must hold a line for each frame")
    return tuple(entries), cut_off


def frame_entry(folder: Path, line: FrameLine) -> FrameEntry:
    """A line of frames.jsonl as a record."""
    return FrameEntry(
        seq=line.seq,
        picture=folder / line.file,
        row0_readout_ns=line.sensor_timestamp_ns,
        exposure_us=line.exposure_us,
        analogue_gain=line.analogue_gain,
        decoded=line.decoded,
        search_budget=line.search_budget,
    )


def check_order(last: FrameEntry, new: FrameEntry, where: str) -> None:
    """Raises RecordingError where `new` cannot come after `last`."""
    if new.seq <= last.seq:
        raise RecordingError(f"{where}: seq: is {new.seq}; must be more than the last frame's {last.seq}")
    if new.row0_readout_ns <= last.row0_readout_ns:
        raise RecordingError(
            f"{where}: sensor_timestamp_ns: time runs backward, from {last.row0_readout_ns} to "
            f"{new.row0_readout_ns}; must increase from frame to frame"
        )


def _load_truth(path: Path, known: list[int], cut_off: bool) -> Mapping[int, tuple[TruthMarker, ...]] | None:
    """By seq; `known` are those of the frames. Where the list of frames is cut off, truth may go on after it."""
    if not path.exists():
        return None
    truth: dict[int, tuple[TruthMarker, ...]] = {}
    frames, last = set(known), known[-1]
    for number, (seq, markers) in read_lines(path, TruthLine, _truth_line)[0]:
        if cut_off and seq > last:
            continue
        if seq in truth:
            raise RecordingError(f"{path}: line {number}: seq: {seq} has a line already; one a frame")
        if seq not in frames:
            wanted = f"must be that of a frame in {FRAMES_FILE}"
            raise RecordingError(f"{path}: line {number}: seq: is {seq}; {wanted}")
        truth[seq] = markers
    return MappingProxyType(truth)


def _truth_line(line: TruthLine) -> tuple[int, tuple[TruthMarker, ...]]:
    return line.seq, tuple(_truth_marker(marker) for marker in line.markers)


def _truth_marker(line: TruthLineMarker) -> TruthMarker:
    pose = None
    if line.position_m is not None and line.quaternion_wxyz is not None:
        position, quaternion = read_only(np.array(line.position_m)), read_only(np.array(line.quaternion_wxyz))
        pose = Pose(position_m=position, quaternion_wxyz=quaternion)
    return TruthMarker(
        id=line.id, corners_px=read_only(np.array(line.corners_px)), camera_from_marker=pose, optional=line.optional
    )
