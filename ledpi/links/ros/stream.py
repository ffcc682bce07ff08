"""Lines of a tap, one after the other → ROS 2 messages: what a frame does not say is kept of other lines."""

from __future__ import annotations

from ledpi.links.ros.contents import Message, Names, Values, frame_messages, health_message, odometry_messages


class RosStream:
    """One daemon's. Knows neither clock nor connection."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self._hello: Values = {}
        self._contradicting = False  # since the last health

    def begin(self, hello: Values) -> None:
        """Takes the panels and map of the daemon that now runs."""
        self._hello = hello

    def frame(self, line: Values, unix_offset_ns: int) -> list[Message]:
        """The messages of a `decoded` line."""
        against_map = (line["robot"] or {}).get("panels_rejected")
        self._contradicting |= bool(against_map) or "fix.panels_contradict" in line["rejected"]
        return frame_messages(line, self._names, unix_offset_ns, self._side_m)

    def robot(self, line: Values, unix_offset_ns: int) -> list[Message]:
        """The message of a `robot_state` line; none where there is no state."""
        return odometry_messages(line, self._names, unix_offset_ns)

    def health(self, state: str, health: Values | None, stamp_ns: int) -> Message:
        """The message of a state, and of the `health` line that told it, if there was one."""
        contradicting, self._contradicting = self._contradicting, False
        return health_message(state, health, self._names, stamp_ns, contradicting=contradicting)

    def _side_m(self, marker_id: int) -> float:
        """Looks into the map, then into the panels' settings; 0 where nobody says."""
        panels = self._hello.get("panels", {})
        own = (self._hello.get("map") or {}).get(str(marker_id)) or panels.get("overrides", {}).get(str(marker_id), {})
        return float(own.get("side_m") or panels.get("side_m", 0.0))
