"""config.yaml → a frozen `Config`.

A wrong key or value is a `ConfigError` of one line: file, key, what is wrong, what is allowed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, StrictBool

from ledpi.config import values
from ledpi.config.bodies import Bodies, check_bodies
from ledpi.config.mistakes import validated
from ledpi.config.outputs import OutputName, OutputSettings
from ledpi.config.overrides import apply_override, rename_method
from ledpi.config.panels import PanelSettings, check_bands_visible, check_panels
from ledpi.config.robot import OdometrySettings, RobotSettings
from ledpi.core.dictionaries import is_file
from ledpi.core.errors import ConfigError
from ledpi.core.files import read_yaml
from ledpi.core.records import RowsFrom, Transfer
from ledpi.core.wording import shortened

NO_CONFIGURATION = (
    "no configuration: --config FILE, ./config.yaml or /etc/ledpi/config.yaml; `ledpi config init` writes one"
)
STATE_HZ = 50.0  # where there is odometry
SEARCH_PATH = (Path("config.yaml"), Path("/etc/ledpi/config.yaml"))


def _known_source(source: object) -> object:
    if isinstance(source, str):
        kind, _, rest = source.partition(":")
        if source in ("picamera2", "simulated") or (kind in ("recording", "v4l2") and rest):
            return source
        if kind == "picamera2" and rest.isascii() and rest.isdigit() and len(rest) == 1:
            return source
    raise ValueError("must be picamera2, picamera2:N, simulated, recording:PATH or v4l2:/dev/videoN")


def _no_address(port: str) -> str:
    """Refuses an address as MAVLink's programs write it, of which no device file has the name."""
    if re.match(r"(udp|tcp)(in|out|bcast)?:", port):
        raise ValueError(
            "must be a serial port's path; to an address poses go by outputs: {fc: {kind: udp, host: HOST, port: PORT, "
            "format: mavlink}}"
        )
    return port


class CameraSettings(values.Section):
    """The section `camera`."""

    source: Annotated[str, BeforeValidator(_known_source)] = "picamera2"
    width: Annotated[values.SidePx, Field(ge=32)] = 640
    height: Annotated[values.SidePx, Field(ge=32)] = 480
    exposure_us: values.Microseconds = 10000.0
    frame_duration_us: values.MicrosecondsOrAuto = "auto"
    analogue_gain: values.GainOrAuto = "auto"
    row_time_us: values.RowTimeOrAuto = "auto"
    transfer: Literal["auto", Transfer] = "auto"
    rows_from: RowsFrom = "above"
    intrinsics: Path | None = None


Method = Literal["likelihood", "uemura"]  # of decoding: ours, and that of the source paper (Uemura and others)


class DecodeSettings(values.Section):
    """The section `decode`."""

    method: Method = "likelihood"


class SerialSettings(values.Section):
    """The section `serial`."""

    port: Annotated[str, Field(min_length=1), AfterValidator(_no_address)] | None = None
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 115200
    protocol: Literal["ledpi", "mavlink"] = "ledpi"
    mavlink_profile: values.MavlinkProfile = "ardupilot"
    mavlink_system: values.MavlinkSystem = 1
    max_age_ms: values.MaxAgeMs = 100.0


class RewindSettings(values.Section):
    """The section `rewind`."""

    seconds: Annotated[float, Field(ge=0, le=600, allow_inf_nan=False)] = 10.0
    memory_mb: Annotated[float, Field(ge=1, le=1_000_000, allow_inf_nan=False)] | None = None


class TapSettings(values.Section):
    """The section `tap`."""

    socket: Annotated[str, Field(min_length=1)] | None = "auto"


class ViewSettings(values.Section):
    """The section `view`: `ledpi view`, the live page."""

    listen: values.Listen = "127.0.0.1:8088"
    token: values.Token | None = None
    hosts: tuple[values.HostName, ...] = ()  # further names that the page is asked for by
    edit: StrictBool = False  # whoever has the token may change this file

    @property
    def address(self) -> tuple[str, int]:
        """Number and port."""
        host, _, port = self.listen.rpartition(":")
        return ("127.0.0.1" if host == "localhost" else host.strip("[]")), int(port)


class Config(values.Section):
    """The whole configuration, valid once built. Paths in it are absolute."""

    camera: CameraSettings = CameraSettings()
    panels: PanelSettings
    decode: DecodeSettings = DecodeSettings()
    map: Path | None = None
    bodies: Annotated[Bodies, Field(default_factory=dict)]
    robot: RobotSettings = RobotSettings()
    serial: SerialSettings = SerialSettings()
    odometry: OdometrySettings = OdometrySettings()
    outputs: Annotated[dict[OutputName, OutputSettings], Field(default_factory=dict)]
    rewind: RewindSettings = RewindSettings()
    tap: TapSettings = TapSettings()
    view: ViewSettings = ViewSettings()
    _from_command_line: frozenset[str] = PrivateAttr(default=frozenset())
    _file: Path | None = PrivateAttr(default=None)

    @property
    def state_hz(self) -> float:
        """Rate at which the state is told; 0: never, and there is none."""
        if self.robot.state_hz is not None:
            return self.robot.state_hz
        return 0.0 if self.odometry.source == "none" else STATE_HZ

    @property
    def hears_controller(self) -> bool:
        """Tells whether what comes in on the serial port is read."""
        return self.odometry.source == "serial" and self.state_hz > 0

    @property
    def from_command_line(self) -> frozenset[str]:
        """Keys that --set gave, as `panels.side_m`: stronger than what a recording says of itself."""
        return self._from_command_line

    @property
    def file(self) -> Path | None:
        """Which it was read from; None where there is no file."""
        return self._file


def find_config(explicit: Path | None) -> Path | None:
    """The file to read: `--config`, else ./config.yaml, else /etc/ledpi/config.yaml, else None."""
    if explicit is not None:
        return explicit
    return next((path for path in SEARCH_PATH if path.is_file()), None)


def found_config(explicit: Path | None) -> Path:
    """The same, for commands that need a file. Raises ConfigError."""
    path = find_config(explicit)
    if path is None:
        raise ConfigError(NO_CONFIGURATION)
    return path


def load_config(path: Path | None, overrides: tuple[str, ...] = (), *, without_file: tuple[str, ...] = ()) -> Config:
    """Reads a configuration and applies `--set key.key=value` overrides (values are YAML).

    Without a file the overrides must hold what has no default (`panels.side_m`, but for the simulator and recordings),
    or `without_file` must: overrides that a command brings itself for that case, weaker than the user's.
    Raises ConfigError.
    """
    if path is None and not (overrides or without_file):
        raise ConfigError(NO_CONFIGURATION)
    where = str(path) if path is not None else "configuration"
    raw = sections(path) if path is not None else {}
    raw.setdefault("panels", {})  # so that the message names the key that must be given
    base = path.parent if path is not None else Path()
    if path is None:
        for item in without_file:
            apply_override(raw, item)
    from_command_line: set[str] = set()
    for item in overrides:
        from_command_line |= apply_override(raw, item)
    if path is None:
        _size_of_own_panels(raw)
    rename_method(raw, where)
    more = "more" if path is None else f"more: `ledpi config check --config {path}` lists them"
    config = resolve_paths(build_config(raw, where, more), base, from_command_line)
    config._from_command_line = frozenset(from_command_line)
    config._file = None if path is None else path.absolute()
    check_together(config, where)
    return config


def build_config(raw: dict[str, Any], where: str, more: str = "more") -> Config:
    """Validates each value by itself. Raises ConfigError; `more`: as it calls further mistakes."""
    return validated(Config, raw, where, ConfigError, more)


def checks_together(config: Config, where: str) -> list[Callable[[], None]]:
    """Those of values that are right one by one; each raises ConfigError where they contradict each other."""
    panels, row_time_us = config.panels, config.camera.row_time_us
    checks = [partial(check_panels, panels, where), partial(check_bodies, config.bodies, panels, where)]
    if row_time_us != "auto":
        checks.append(partial(check_bands_visible, panels, row_time_us, where))
    method = partial(check_method, config.decode.method, panels, f"{where}: decode.method")
    return [*checks, method, partial(_check_odometry, config, where)]


def check_together(config: Config, where: str) -> None:
    """Raises ConfigError where values that are right one by one contradict each other."""
    for check in checks_together(config, where):
        check()


def _check_odometry(config: Config, where: str) -> None:
    """Raises ConfigError where nothing could bring it."""
    if config.odometry.source != "serial":
        return
    if config.serial.port is None:
        raise ConfigError(f"{where}: odometry.source: serial needs serial.port; without a controller: tap or none")


def check_method(method: Method, panels: PanelSettings, where: str) -> None:
    """Raises ConfigError where the method cannot read such panels. `where`: the key or option that names the method."""
    if method == "uemura" and panels.has_antiphase():
        raise ConfigError(
            f"{where}: uemura distinguishes classes by the height of their bands, and with phase: antiphase they "
            "are alike; must be likelihood"
        )


def sections(path: Path) -> dict[str, Any]:
    """Reads the file. Raises ConfigError where it holds no sections."""
    raw = read_yaml(path, ConfigError)
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be sections (camera:, panels:, …), not {shortened(raw)}")
    return raw


def _size_of_own_panels(raw: dict[str, Any]) -> None:
    """Lets the example's size stand in, without a file, for a source that shows panels of its own."""
    camera, panels = raw.get("camera"), raw["panels"]
    source = str(camera.get("source")) if isinstance(camera, dict) else ""
    if source.partition(":")[0] in ("simulated", "recording") and isinstance(panels, dict):
        panels.setdefault("side_m", 0.16)


def resolve_paths(config: Config, base: Path, from_command_line: set[str]) -> Config:
    """Paths in the file are relative to it, paths given with --set to the working directory."""

    def absolute(path: Path | str, key: str) -> Path:
        start = Path() if key in from_command_line else base
        return (start / os.path.expanduser(path)).absolute()

    camera = config.camera
    changes: dict[str, Any] = {}
    if camera.intrinsics is not None:
        changes["intrinsics"] = absolute(camera.intrinsics, "camera.intrinsics")
    kind, _, rest = camera.source.partition(":")
    if kind == "recording":
        changes["source"] = f"recording:{absolute(rest, 'camera.source')}"
    changes_top: dict[str, Any] = {"camera": camera.model_copy(update=changes)}
    if is_file(config.panels.dictionary):
        words = str(absolute(config.panels.dictionary, "panels.dictionary"))
        changes_top["panels"] = config.panels.model_copy(update={"dictionary": words})
    if config.map is not None:
        changes_top["map"] = absolute(config.map, "map")
    changes_top["outputs"] = {name: output.resolve_paths(name, absolute) for name, output in config.outputs.items()}
    if config.tap.socket not in (None, "auto"):
        changes_top["tap"] = TapSettings(socket=str(absolute(config.tap.socket, "tap.socket")))
    return config.model_copy(update=changes_top)
