"""The status for the controller: how the daemon is, and why there is no fix."""

from __future__ import annotations

from ledpi.pose.fix import NOT_IN_MAP
from ledpi.runtime.health import HealthSnapshot
from ledpi.runtime.liveness import Liveness
from ledpi.runtime.processor import Processor
from ledpi.runtime.reporting import Totals
from ledpi.wire.message import NoFix, State, StatusMessage

STARTING_S = 2.0  # so long the first frame may take


def status(
    totals: Totals, liveness: Liveness, processor: Processor, *, uptime_s: float, calibrated: bool, has_map: bool
) -> StatusMessage:
    """The message of this moment."""
    health, ring, packets = totals.health, totals.ring, totals.packets
    lost, behind = liveness.lost, liveness.behind
    p50_us, p99_us = totals.times.decode_us
    if not health.decoded and uptime_s < STARTING_S:
        state, no_fix = State.STARTING, NoFix.NOT_RUNNING
    elif lost:
        state, no_fix = State.CAMERA_LOST, NoFix.NO_FRAMES
    elif behind:
        state, no_fix = State.RUNNING, NoFix.BEHIND
    else:
        state, no_fix = State.RUNNING, _no_fix(health, calibrated=calibrated, has_map=has_map)
    return StatusMessage(
        state=state,
        no_fix=no_fix,
        panels_in_view=0 if lost else None if behind else health.in_view,
        uptime_s=int(uptime_s),
        frames=ring.published,
        frames_dropped=ring.dropped,
        markers=health.markers,
        packets_dropped=packets.unsent,
        temperature_c=processor.temperature_c,
        throttling=processor.throttling,
        decode_p50_us=p50_us,
        decode_p99_us=p99_us,
    )


def _no_fix(health: HealthSnapshot, *, calibrated: bool, has_map: bool) -> NoFix:
    """While frames come and are decoded in time."""
    if not calibrated:
        return NoFix.UNCALIBRATED
    if not has_map:
        return NoFix.NO_MAP
    if health.fixed:
        return NoFix.NONE
    if not health.in_view:
        return NoFix.NO_PANEL
    return NoFix.NOT_IN_MAP if health.no_fix == NOT_IN_MAP.reason else NoFix.REJECTED
