"""The speed of this machine, measured on frames that the simulator draws: what to expect, and what to set."""

from __future__ import annotations

import time
from contextlib import suppress
from math import ceil

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import abreast_scene
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.simulated import simulated_sensor
from ledpi.camera.timing import choose_frame_length_rows, frame_duration_us
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError
from ledpi.core.wording import counted
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.doctor.finding import Finding, ok, unknown

IN_VIEW = (0, 1, 4)  # panels; without one it searches
WARM_UP, FRAMES = 9, 6  # in every third frame a stream searches the whole picture
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
    for seq in range(WARM_UP + FRAMES):
        frame = renderer.frame(seq)
        start_s = time.thread_time()
        markers = pipeline.decode(frame).markers
        taken_s.append(time.thread_time() - start_s)
    return 1e3 * sum(taken_s[WARM_UP:]) / FRAMES if len(markers) == count else None


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
