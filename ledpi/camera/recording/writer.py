"""Writing a recording: the description first, then for each frame its picture, then its line.

So what is there when the writing is cut off is a recording of the frames until then.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from io import FileIO
from pathlib import Path
from types import TracebackType

import cv2
import yaml
from typing_extensions import Self

from ledpi.camera.recording.format import (
    FORMAT,
    FRAMES_FILE,
    HEADER_FILE,
    TRUTH_FILE,
    CameraSection,
    FrameLine,
    Header,
    PanelSection,
    TruthLine,
    TruthLineMarker,
)
from ledpi.camera.recording.reader import FrameEntry, TruthMarker, check_order, frame_entry
from ledpi.core.dictionaries import is_file
from ledpi.core.errors import RecordingError
from ledpi.core.files import put_in_place, write_beside, writing
from ledpi.core.records import CameraInfo, Frame, PanelSpec, Pixels

# Sensor noise does not repeat itself: Huffman coding alone is the smallest and the fastest of zlib's
# strategies (a noisy 640 × 480 frame: 168 kB in 6.1 ms against 183 kB in 6.8 ms with OpenCV's default).
_STRATEGY = cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY
_PNG_OPTIONS = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, _STRATEGY)


class RecordingWriter:
    """A context manager that writes one recording into a new or empty folder.

    Raises RecordingError where the folder holds something already, and where a file cannot be written.
    """

    def __init__(self, folder: Path, *, camera: CameraInfo, dictionary: str, panel: PanelSpec, note: str = "") -> None:
        self._folder = folder
        self._camera = camera
        self._dictionary_file = Path(dictionary) if is_file(dictionary) else None
        if self._dictionary_file is not None:  # a recording holds all that it takes to read it
            dictionary = self._dictionary_file.name
        self._header = header_of(camera, dictionary, panel)
        self._note = note
        self._frames: FileIO | None = None
        self._truth: FileIO | None = None
        self._last: FrameEntry | None = None

    def __enter__(self) -> Self:
        with writing(self._folder, RecordingError) as folder:
            if folder.is_dir() and any(folder.iterdir()):
                raise RecordingError(f"{folder}: is not empty; a recording needs a new or an empty folder")
            (folder / "frames").mkdir(parents=True)
            if self._dictionary_file is not None:
                shutil.copyfile(self._dictionary_file, folder / self._dictionary_file.name)
        with writing(self._folder / HEADER_FILE, RecordingError) as path:
            put_in_place(write_beside(path, header_text(self._header, self._note).encode()), path)
        self._frames = self._create(FRAMES_FILE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in (self._frames, self._truth):
            if file is not None:
                file.close()
        self._frames = self._truth = None

    def write(
        self,
        frame: Frame,
        truth: Sequence[TruthMarker] | None = None,
        *,
        png: bytes | None = None,
        decoded: bool | None = None,
        search_budget: int | None = None,
        wall_clock_offset_ns: int | None = None,
    ) -> int:
        """Adds a frame, and what is to be seen in it where that is known. On return the kernel has it all.

        `png`: its picture, where `encode_picture` was called elsewhere. `decoded`: whether it was decoded while it was
        recorded, and `search_budget` what it might spend. `wall_clock_offset_ns`: what to add to the camera's clock
        to get Unix time; the first frame's is kept. Returns the picture's bytes.
        """
        if self._frames is None:
            raise ValueError("a RecordingWriter writes only inside its `with` block")
        line = frame_line(frame, decoded=decoded, search_budget=search_budget)
        entry = frame_entry(self._folder, line)
        self._check(frame, entry)
        png = encode_picture(frame.pixels) if png is None else png
        _write_picture(entry.picture, png)
        self._append(self._frames, line.model_dump_json(exclude_defaults=True))
        if self._last is None and wall_clock_offset_ns is not None:
            self._set_clock(wall_clock_offset_ns)
        self._last = entry
        if truth is not None:
            self._truth = self._truth or self._create(TRUTH_FILE)
            markers = tuple(_truth_line_marker(marker) for marker in truth)
            told = TruthLine(seq=frame.seq, markers=markers)
            self._append(self._truth, told.model_dump_json(exclude_defaults=True))
        return len(png)

    def _set_clock(self, offset_ns: int) -> None:
        """One line more at the header's end: a recording begins before its first frame, and only that tells."""
        with writing(self._folder / HEADER_FILE, RecordingError) as path, path.open("ab") as file:
            file.write(f"wall_clock_offset_ns: {offset_ns}\n".encode())

    def _check(self, frame: Frame, entry: FrameEntry) -> None:
        camera, where = self._camera, f"{self._folder}: frame {frame.seq}"
        if self._last is not None:
            check_order(self._last, entry, where)
        height, width = frame.pixels.shape
        is_so = (width, height, frame.row_time_us, frame.transfer)
        should_be = (camera.width, camera.height, camera.row_time_us, camera.transfer)
        if is_so != should_be:
            keys = "width, height, row_time_us, transfer"
            raise RecordingError(f"{where}: {keys} are {is_so}; must be {should_be}, as in {HEADER_FILE}")

    def _create(self, name: str) -> FileIO:
        with writing(self._folder / name, RecordingError) as path:
            return path.open("xb", buffering=0)

    def _append(self, file: FileIO, line: str) -> None:
        """Adds a whole line or, where the disk is full, nothing."""
        text, start = f"{line}\n".encode(), file.tell()
        with writing(Path(file.name), RecordingError):
            try:
                while text:
                    text = text[file.write(text) :]
            except BaseException:
                file.truncate(start)
                raise


def header_of(camera: CameraInfo, dictionary: str, panel: PanelSpec) -> Header:
    """Returns what recording.yaml says of its camera and panels."""
    return Header(camera=_camera_section(camera), panel=PanelSection(dictionary=dictionary, **asdict(panel)))


def header_text(header: Header, note: str) -> str:
    """recording.yaml."""
    values = {"format": FORMAT, "note": note} | header.model_dump(mode="json", exclude_defaults=True)
    text: str = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    return text


def frame_line(frame: Frame, *, decoded: bool | None = None, search_budget: int | None = None) -> FrameLine:
    """A line of frames.jsonl."""
    return FrameLine(
        seq=frame.seq,
        file=f"frames/{frame.seq:06d}.png",
        sensor_timestamp_ns=frame.row0_readout_ns,
        exposure_us=frame.exposure_us,
        analogue_gain=frame.analogue_gain,
        decoded=decoded,
        search_budget=search_budget,
    )


def encode_picture(pixels: Pixels) -> bytes:
    """A picture (H, W) as PNG, without loss. From any thread, as OpenCV lets the others run meanwhile."""
    return bytes(cv2.imencode(".png", pixels, _PNG_OPTIONS)[1].tobytes())


def _write_picture(path: Path, png: bytes) -> None:
    with writing(path, RecordingError):
        try:
            path.write_bytes(png)
        except BaseException:  # also Ctrl-C: half a picture is of no use
            path.unlink(missing_ok=True)
            raise


def _camera_section(camera: CameraInfo) -> CameraSection:
    values = asdict(camera)
    return CameraSection(**(values.pop("intrinsics") or {}) | values)


def _truth_line_marker(marker: TruthMarker) -> TruthLineMarker:
    pose = marker.camera_from_marker
    return TruthLineMarker(
        id=marker.id,
        corners_px=marker.corners_px.tolist(),
        position_m=pose.position_m.tolist() if pose is not None else None,
        quaternion_wxyz=pose.quaternion_wxyz.tolist() if pose is not None else None,
        optional=marker.optional,
    )
