"""The section `outputs`: where else poses go, each by a bridge of its own (`ledpi bridge`)."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator
from typing_extensions import Self

from ledpi.config.values import MarkerId, MavlinkProfile, MavlinkSystem, MaxAgeMs, Section, is_ip

Kind = Literal["stdout", "udp", "tcp", "mqtt", "nt", "zenoh"]
MAVLINK_KEYS = ("mavlink_profile", "mavlink_system")  # of format: mavlink
# The keys that each kind takes beside `kind`, and its port where none is given. Those with `host` need one.
KEYS: dict[Kind, tuple[str, ...]] = {
    "stdout": ("format", *MAVLINK_KEYS, "max_age_ms"),
    "udp": ("host", "port", "format", *MAVLINK_KEYS, "max_age_ms"),
    "tcp": ("host", "port", "format", *MAVLINK_KEYS, "max_age_ms"),
    "mqtt": ("host", "port", "topic", "client_id", "tls", "ca_file", "user", "password_file", "max_age_ms"),
    "nt": ("host", "port", "topic", "photon_camera", "max_age_ms"),
    "zenoh": (
        *("host", "port", "topic", "domain", "camera_frame", "map_frame", "frame_prefix", "publish_tf", "dock_id"),
        "max_age_ms",
    ),
}
PORTS: dict[Kind, int] = {"mqtt": 1883, "nt": 5810, "zenoh": 7447}
MQTT_TLS_PORT = 8883


def _of_the_form(pattern: str, wanted: str) -> AfterValidator:
    def check(text: str) -> str:
        if re.fullmatch(pattern, text):
            return text
        raise ValueError(f"must be {wanted}")

    return AfterValidator(check)


# A unit's name holds it: ledpi-bridge@NAME.
OutputName = Annotated[str, _of_the_form(r"[a-z][a-z0-9_-]{0,31}", "a name of small letters, digits, _ and -")]
_WORD = r"[A-Za-z_][A-Za-z0-9_]*"
RosName = Annotated[
    str, _of_the_form(rf"(?=.{{1,200}}$){_WORD}(/{_WORD})*", "words of letters, digits and _, with / between")
]
_WIDER = r"[A-Za-z0-9_-]+"  # as hosts are named; ROS 2 has no -
Topic = Annotated[
    str, _of_the_form(rf"(?=.{{1,200}}$){_WIDER}(/{_WIDER})*", "words of letters, digits, _ and -, with / between")
]
FramePrefix = Annotated[
    str, _of_the_form(r"(?!/)[A-Za-z0-9_/]{0,100}", "letters, digits and _, with / between or behind, as front/")
]
ClientId = Annotated[str, _of_the_form(r"[!-~]{1,200}", "1 to 200 letters, digits and signs, without blanks")]


_LABEL = r"\w([\w-]*\w)?"


def _host(name: str) -> str:
    if is_ip(name) or (len(name) <= 253 and re.fullmatch(rf"{_LABEL}(\.{_LABEL})*\.?", name)):
        return name
    raise ValueError("must be a name or an address alone, as robot.lan or 10.0.0.2: no port, no path")


class OutputSettings(Section):
    """One of `outputs`. Which keys it takes depends on its kind."""

    kind: Kind
    max_age_ms: MaxAgeMs | None = None  # that of `serial`
    host: Annotated[str, AfterValidator(_host)] | None = None
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    format: Literal["json", "wire", "mavlink"] = "json"
    mavlink_profile: MavlinkProfile = "ardupilot"
    mavlink_system: MavlinkSystem = 1
    topic: Topic | None = None  # see `base_topic`
    client_id: ClientId | None = None
    tls: bool = False
    ca_file: Path | None = None
    user: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    password_file: Path | None = None
    photon_camera: Annotated[str, _of_the_form(r"[^/]{1,60}", "a name without /")] | None = None
    domain: Annotated[int, Field(ge=0, le=232)] = 0
    camera_frame: RosName = "camera_optical_frame"
    map_frame: RosName = "map"
    frame_prefix: FramePrefix = ""
    publish_tf: bool = True
    dock_id: MarkerId | None = None

    @model_validator(mode="after")
    def _has_keys_of_its_kind(self) -> Self:
        takes = KEYS[self.kind]
        for key in sorted(self.model_fields_set - {"kind", *takes}):
            raise ValueError(f"has {key}, which is not for {self.kind}; {self.kind} takes {', '.join(takes)}")
        if "host" in takes and self.host is None:
            raise ValueError(f"must have a host: the address that {self.kind} sends to")
        if "port" in takes and self.port is None and self.kind not in PORTS:
            raise ValueError(f"must have a port; {self.kind} has none of its own")
        if self.kind == "zenoh" and self.topic is not None and not re.fullmatch(rf"{_WORD}(/{_WORD})*", self.topic):
            raise ValueError(f"has topic {self.topic}; ROS 2's words have letters, digits and _, a digit never first")
        for key in MAVLINK_KEYS:
            if key in self.model_fields_set and self.format != "mavlink":
                raise ValueError(f"has {key}, which needs format: mavlink")
        if self.ca_file is not None and not self.tls:
            raise ValueError("has ca_file, which needs tls: true")
        if (self.password_file is None) != (self.user is None):
            raise ValueError("must have user and password_file together, or neither")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port. Only of a kind that has them."""
        assert self.host is not None
        usual = MQTT_TLS_PORT if self.tls else PORTS.get(self.kind, 0)
        return self.host, self.port or usual

    @property
    def base_topic(self) -> str:
        """The beginning of all topics. One broker serves many robots, so there it has this machine's name."""
        if self.topic is not None or self.kind != "mqtt":
            return self.topic or "ledpi"
        return f"ledpi/{re.sub(r'[^A-Za-z0-9_-]', '_', socket.gethostname().partition('.')[0]) or 'localhost'}"

    def resolve_paths(self, name: str, absolute: Callable[[Path, str], Path]) -> OutputSettings:
        """The same, its files by their whole paths, as `absolute` makes them of a path and its key."""
        given = {key: getattr(self, key) for key in ("ca_file", "password_file")}
        files = {key: absolute(path, f"outputs.{name}.{key}") for key, path in given.items() if path is not None}
        return self.model_copy(update=files)
