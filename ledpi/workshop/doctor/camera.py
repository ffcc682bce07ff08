"""The camera, as the configuration asks for it: opened, tried, closed again; panels before it; and the speed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ledpi.camera.base import Camera
from ledpi.camera.factory import depths, open_camera, other_exposure, vanishing
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import abreast_scene
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.simulated import simulated_sensor
from ledpi.camera.timing import MIN_PHASE_ADVANCE_CYCLES, choose_frame_length_rows, frame_duration_us
from ledpi.config.camera_yaml import blind_note, lens_of, load_intrinsics
from ledpi.config.settings import Config
from ledpi.core.errors import CalibrationError, ConfigError, LedpiError
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, Rejected
from ledpi.core.shutter import phase_advance_cycles
from ledpi.core.wording import counted
from ledpi.pipeline.diagnosis.diagnose import Diagnosis, NotRead, not_read_in
from ledpi.pipeline.diagnosis.why_not import Why, WhyNot
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import Trace
from ledpi.workshop.doctor.finding import Finding, bad, ok, unknown
from ledpi.workshop.snapshot.sources import LOOK_FRAMES, Looking

MOST = 3  # things that are told of
FRAMES = 12
# From a telephoto lens to a wide-angle one, in picture widths; the Pi's cameras are at 1.0 and 1.2 in the 640×480 mode.
FOCAL_WIDTHS = (0.2, 4.0)


class _Seen(NamedTuple):
    """The frame of several in which most is told."""

    frame: Frame
    not_read: list[NotRead]


def look(camera: Camera, config: Config) -> list[Finding]:
    """Through an open camera, for half a second, and longer where the gain is to be found first.

    A panel that is read in one of the frames is read: what another frame lacks is not told.
    """
    lens = _lens(camera, config)
    looking = Looking(camera, config, lens)
    looking.expose()
    pipeline = Pipeline(camera.info, config.panels, intrinsics=lens, source_panel=camera.panel)
    read_px: dict[int, Floats] = {}  # by ID
    seen: _Seen | None = None
    for frame in itertools.islice(looking.frames(), LOOK_FRAMES):
        trace = Trace()
        for marker in pipeline.decode(frame, trace).markers:
            read_px[marker.detection.id] = marker.detection.corners_px
        told = not_read_in(trace)
        if seen is None or len(told) >= len(seen.not_read):  # the whole picture is searched in some frames only
            kept = replace(frame, pixels=frame.pixels.copy())
            seen = _Seen(kept, told)
    if seen is None:
        return []
    why = WhyNot(camera.info, pipeline.panels, lens).explain(*seen, list(read_px.values()), looking.run)
    return findings_of(sorted(read_px), why)


def _lens(camera: Camera, config: Config) -> Intrinsics | None:
    try:
        return lens_of(camera.info, config.camera.intrinsics)
    except CalibrationError:  # another finding says so
        return None


def findings_of(read: Sequence[int], why: Why) -> list[Finding]:
    """Tells what is read, and of each thing that is not; a light may be no panel."""
    seen = ", ".join(str(marker_id) for marker_id in read)
    findings = [ok("panels", f"ID {seen} read")] if read else []
    findings += [_finding(one) for one in why.told[:MOST]]
    if not read:  # else it is good enough
        findings += [bad("picture", note.says, note.helps) for note in why.notes]
    return findings or [unknown("panels", "none in view")]


def _finding(one: Diagnosis) -> Finding:
    if one.kind == "panel":
        return bad("panels", one.line, one.helps or "see `ledpi snapshot`")
    return unknown("panels", one.line, one.helps)


def camera(config: Config) -> tuple[list[Finding], CameraInfo | None]:
    """Finds out whether it is there, free, and does as asked; and what is then known of it."""
    try:
        device = open_camera(config, paced=config.camera.source.partition(":")[0] not in ("simulated", "recording"))
    except LedpiError as error:
        what, _, remedy = str(error).partition("; ")
        return [bad("camera", what, remedy or "see the message", stops_daemon=True)], None
    try:
        info = device.info
        into = np.empty((info.height, info.width), np.uint8)
        results = [result for _ in range(FRAMES) if (result := device.read(into)) is not None]
        found = [_delivers(config, results), *_timing(config, info, results), *look(device, config)]
    except LedpiError as error:
        return [bad("camera", str(error), "check the cable, and try again", stops_daemon=True)], None
    finally:
        device.close()
    return found, info


def _delivers(config: Config, results: list[Frame | Rejected]) -> Finding:
    rejected = [result.key for result in results if isinstance(result, Rejected)]
    frames = len(results) - len(rejected)
    if frames == 0:
        why = f"no usable frame of {len(results)}: {', '.join(sorted(set(rejected))) or 'it ended'}"
        return bad("camera", why, "see `ledpi snapshot`", stops_daemon=True)
    return ok("camera", f"{config.camera.source}: {frames} of {len(results)} frames usable")


def exposure(config: Config, info: CameraInfo, frames: list[Frame]) -> Finding:
    """Compares what the frames were exposed for with what the configuration asks for."""
    if not frames:
        return unknown("exposure", "no frame to tell")
    really = replace(info, exposure_us=frames[-1].exposure_us)
    if (other := other_exposure(config, really)) is not None:
        return bad("exposure", other, "set camera.exposure_us to what this camera can do, then look at the bands")
    replayed = config.camera.source.startswith("recording:")
    asked_us = info.exposure_us if replayed else config.camera.exposure_us
    return ok("exposure", f"{really.exposure_us:.0f} µs of {asked_us:.0f} µs asked for")


def _timing(config: Config, info: CameraInfo, results: list[Frame | Rejected]) -> list[Finding]:
    frames = [result for result in results if isinstance(result, Frame)]
    findings = [
        ok("sensor mode", f"{info.width} × {info.height}, {info.transfer} tone"),
        exposure(config, info, frames),
    ]
    if info.frame_length_rows is None:
        return [*findings, unknown("row time", f"{info.row_time_us:.2f} µs, as configured; this camera cannot tell")]
    period_us = info.frame_length_rows * info.row_time_us
    steps = [
        (later.row0_readout_ns - earlier.row0_readout_ns) / (later.seq - earlier.seq) / 1e3
        for earlier, later in itertools.pairwise(frames)
    ]
    said = f"{info.row_time_us:.3f} µs, {info.frame_length_rows} rows a frame: {1e6 / period_us:.2f} frames a second"
    if steps and abs(float(np.median(steps)) / period_us - 1) > 0.01:
        off = f"{said}, but frames come every {np.median(steps):.0f} µs"
        return [*findings, bad("row time", off, "`ledpi calibrate shutter`, and set camera.row_time_us")]
    return [*findings, ok("row time", said)]


def frequencies(config: Config, info: CameraInfo) -> Finding:
    """Finds out whether all bands are deep enough at this exposure, and move from frame to frame."""
    weak = [f"{hz:g} Hz" for hz in vanishing(config.panels, info.exposure_us)]
    said, frozen = [], []
    for hz, depth in depths(config.panels, info.exposure_us).items():
        said.append(f"{hz:g} Hz {100 * depth:.1f} %")
        if info.frame_length_rows is not None:
            advance = phase_advance_cycles(hz, info.frame_length_rows * info.row_time_us)
            if abs(advance) < MIN_PHASE_ADVANCE_CYCLES:
                frozen.append(f"{hz:g} Hz")
    page = f"depth of the bands at {info.exposure_us:.0f} µs: {', '.join(said)}"
    if weak:
        remedy = "choose exposure × frequency near a whole number and a half: `ledpi panel design`"
        return bad("panel frequencies", f"{page}; {', '.join(weak)} all but vanishes", remedy)
    if frozen:
        remedy = "camera.frame_duration_us: auto"
        return bad("panel frequencies", f"{page}; {', '.join(frozen)} hardly moves from frame to frame", remedy)
    return ok("panel frequencies", page)


def intrinsics(config: Config, info: CameraInfo | None) -> Finding:
    """Finds out whether there is a lens, of this picture's size, that is a lens."""
    if info is not None and info.intrinsics is not None:  # a recording's own, which override the configuration's
        return plausible(info.intrinsics, Path(config.camera.source))
    path = config.camera.intrinsics
    if path is None:
        return bad(
            "intrinsics",
            "camera.intrinsics is not set: IDs are sent, but no poses",
            "print a board (`ledpi calibrate board`), then `ledpi calibrate camera`",
        )
    try:
        size = (config.camera.width, config.camera.height) if info is None else (info.width, info.height)
        return plausible(load_intrinsics(path, size), path)
    except CalibrationError as error:
        return bad("intrinsics", str(error), "`ledpi calibrate camera`", stops_daemon=True)


def plausible(lens: Intrinsics, path: Path) -> Finding:
    """Focal length within what lenses have, the centre near the middle."""
    said = f"{path}: fx {lens.fx:.0f}, fy {lens.fy:.0f}, centre {lens.cx:.0f}, {lens.cy:.0f} px"
    least, most = FOCAL_WIDTHS
    is_lens = all(least <= focal / lens.width <= most for focal in (lens.fx, lens.fy))
    is_square = abs(lens.fx / lens.fy - 1) < 0.1
    is_central = abs(lens.cx / lens.width - 0.5) < 0.2 and abs(lens.cy / lens.height - 0.5) < 0.2
    note = blind_note(lens)
    if note is not None:
        return bad("intrinsics", f"{said}; {note}", "`ledpi calibrate camera`, with views all over the picture")
    if is_lens and is_square and is_central:
        return ok("intrinsics", said)
    return bad("intrinsics", f"{said}: no lens is like that", "calibrate again, with views that fill the picture")


IN_VIEW = (0, 1, 4)  # panels; without one it searches
WARM_UP_FRAMES, TIMED_FRAMES = 9, 6  # in every third frame a stream searches the whole picture
SPARE = 1.2  # of a frame's period over its mean decoding time: some frames take longer, and the daemon does more


def speed(config: Config) -> Finding:
    """Decodes the configuration's own panels as the Pi's first camera would show them; takes some seconds."""
    try:
        sensor = simulated_sensor(config.camera.model_copy(update={"intrinsics": None}), config.panels)
    except ConfigError as error:
        return unknown("speed", str(error))
    taken_ms = {count: ms for count in IN_VIEW if (ms := measured_ms(config, sensor, count)) is not None}
    return finding_of(taken_ms, config, sensor)


def measured_ms(config: Config, sensor: SimulatedSensor, count: int) -> float | None:
    """Mean processor time of a frame with so many panels in view; None where they do not exist or are not followed."""
    specs = {marker_id: config.panels.spec(marker_id) for marker_id in sorted(config.panels.existing_ids())[:count]}
    renderer = Renderer(abreast_scene(sensor, specs, config.panels.dictionary), seed=0)
    info, lens = sensor_info(sensor), sensor.intrinsics
    pipeline = Pipeline(info, config.panels, intrinsics=lens, method=config.decode.method)
    taken_s = []
    for seq in range(WARM_UP_FRAMES + TIMED_FRAMES):
        frame = renderer.frame(seq)
        start_s = time.thread_time()
        markers = pipeline.decode(frame).markers
        taken_s.append(time.thread_time() - start_s)
    return 1e3 * sum(taken_s[WARM_UP_FRAMES:]) / TIMED_FRAMES if len(markers) == count else None


def finding_of(taken_ms: dict[int, float], config: Config, sensor: SimulatedSensor) -> Finding:
    """Compares these times of a frame, by panels in view, with the period of `sensor`."""
    period_ms = sensor.frame_length_rows * sensor.row_time_us / 1e3
    rates = [f"{1e3 / taken_ms[0]:.0f} searching"]
    rates += [f"{1e3 / ms:.0f} with {counted(count, 'panel')} followed" for count, ms in taken_ms.items() if count]
    said = f"frames a second: {', '.join(rates)}; the camera's {1e3 / period_ms:.0f}"
    slowest_ms = max(taken_ms.values())
    if slowest_ms <= period_ms:
        return ok("speed", said)
    period_us = _longer_period_us(SPARE * slowest_ms, config, sensor)
    remedy = f"frames that come meanwhile are dropped; with camera.frame_duration_us: {period_us} none are"
    return unknown("speed", said, remedy)


def _longer_period_us(least_ms: float, config: Config, sensor: SimulatedSensor) -> int:
    """The shortest period from there on in which the bands of every class move, if there is one."""
    rows = ceil(1e3 * least_ms / sensor.row_time_us)
    hz = config.panels.frequencies_hz()
    with suppress(ValueError):
        rows = choose_frame_length_rows(shortest_rows=rows, row_time_us=sensor.row_time_us, frequencies_hz=hz)
    return frame_duration_us(rows, sensor.row_time_us)
