"""config.yaml → a frozen `Config`.

A wrong key or value is a `ConfigError` of one line: file, key, what is wrong, what is allowed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    StrictBool,
    ValidationError,
    model_validator,
)

from ledpi.config.mistakes import explain
from ledpi.config.overrides import apply_override
from ledpi.config.renamed import rename_method
from ledpi.config.values import (
    Angles,
    Duty,
    GainOrAuto,
    Hertz,
    Listen,
    MarkerId,
    MaxAgeMs,
    Microseconds,
    MicrosecondsOrAuto,
    MountPosition,
    NoBooleans,
    RowTimeOrAuto,
    SideM,
    SidePx,
    Token,
    check_cycles_fit,
)
from ledpi.core.errors import ConfigError
from ledpi.core.files import read_yaml
from ledpi.core.records import PanelSpec, PanelValues, Phase, Transfer
from ledpi.core.wording import shortened
from ledpi.markers.codewords import format_ranges
from ledpi.markers.dictionaries import FILE_ENDINGS, dictionary_names, is_file, load_dictionary, meant_name

SEARCH_PATH = (Path("config.yaml"), Path("/etc/ledpi/config.yaml"))


def _known_source(source: object) -> object:
    if isinstance(source, str):
        kind, _, rest = source.partition(":")
        if source in ("picamera2", "simulated") or (kind in ("recording", "v4l2") and rest):
            return source
    raise ValueError("must be picamera2, simulated, recording:PATH or v4l2:/dev/videoN")


def _known_dictionary(name: str) -> str:
    if name in dictionary_names() or is_file(name):
        return name
    known, endings = ", ".join(dictionary_names()), ", ".join(FILE_ENDINGS)
    raise ValueError(f"{meant_name(name)}must be one of {known}, or a file that ends in {endings}")


class _Section(NoBooleans):
    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _is_section(cls, value: object) -> object:
        if value is None:  # `camera:` with every key under it commented out
            return {}
        if isinstance(value, (dict, cls)):
            return value
        raise ValueError(f"must be a section with the keys {', '.join(sorted(cls.model_fields))}")


class CameraSettings(_Section):
    """The section `camera`."""

    source: Annotated[str, BeforeValidator(_known_source)] = "picamera2"
    width: Annotated[SidePx, Field(ge=32)] = 640
    height: Annotated[SidePx, Field(ge=32)] = 480
    exposure_us: Microseconds = 10000.0
    frame_duration_us: MicrosecondsOrAuto = "auto"
    analogue_gain: GainOrAuto = "auto"
    row_time_us: RowTimeOrAuto = "auto"
    transfer: Literal["auto", Transfer] = "auto"
    intrinsics: Path | None = None


class PanelOverride(_Section):
    """An entry of `panels.overrides`: what is other than of the common panel."""

    side_m: SideM | None = None
    black_hz: Hertz | None = None
    white_hz: Hertz | None = None
    duty: Duty | None = None
    phase: Phase | None = None
    measured: date | None = None  # by `ledpi calibrate panel`


class PanelSettings(_Section):
    """The section `panels`."""

    dictionary: Annotated[str, AfterValidator(_known_dictionary)] = "DICT_4X4_50"
    side_m: SideM
    black_hz: Hertz = 1250.0
    white_hz: Hertz = 2450.0
    duty: Duty = 0.5
    phase: Phase = "free"
    upright: StrictBool = False  # all hang with their y axis up, on walls
    ids: tuple[MarkerId, ...] | None = None  # that exist; all but those a part of another can show
    search_frequencies: StrictBool = False  # of oscillators that are off by a percent, as RC oscillators are
    overrides: dict[MarkerId, PanelOverride] = Field(default_factory=dict)

    def spec(self, marker_id: int | None = None) -> PanelSpec:
        """The panel of one ID, or, without an ID, the common one. Raises ValueError where they contradict."""
        values = self.model_dump(include={"side_m", "black_hz", "white_hz", "duty", "phase"})
        if marker_id is not None and marker_id in self.overrides:
            values |= self.overrides[marker_id].model_dump(exclude_none=True, exclude={"measured"})
        return PanelSpec(**values)

    def existing_ids(self) -> frozenset[int]:
        """The IDs that may be reported: `ids`, or else all but those that a part of another panel can show.

        Raises ValueError for an unknown dictionary.
        """
        if self.ids is not None:
            return frozenset(self.ids)
        dictionary = load_dictionary(self.dictionary)
        return frozenset(range(len(dictionary.codewords))) - frozenset(dictionary.part_like_ids())

    def unreported_note(self, ids: Iterable[int]) -> str:
        """Names those of `ids` that the dictionary has, and that are not reported; "" where all are."""
        known = range(len(load_dictionary(self.dictionary).codewords))
        missing = sorted(set(ids).intersection(known) - self.existing_ids())
        if not missing:
            return ""
        one = len(missing) == 1
        ids_are = f"{'ID' if one else 'IDs'} {format_ranges(missing)} {'is' if one else 'are'}"
        note = f"{ids_are} reported only if panels.ids lists {'it' if one else 'them'}"
        return note if self.ids is not None else f"{note}: a part of another panel can look the same"

    def frequencies_hz(self) -> tuple[float, ...]:
        """Every frequency that a panel blinks at, sorted. Raises ValueError where the panels' values contradict."""
        return tuple(sorted({hz for spec in self._specs() for hz in spec.waves_hz}))

    def override_with(self, values: PanelValues) -> PanelSettings:
        """With a recording's own values in place of the common ones.

        Raises ConfigError where the overrides contradict them.
        """
        panels = self.model_copy(update=asdict(values))
        try:
            panels.frequencies_hz()
        except ValueError as error:
            own = panels.spec().blinking()
            raise ConfigError(f"panels.overrides: contradict the recording's own panel, of {own}: {error}") from None
        return panels

    def has_antiphase(self) -> bool:
        """Whether the classes of any panel blink in antiphase."""
        return any(spec.phase == "antiphase" for spec in self._specs())

    def _specs(self) -> list[PanelSpec]:
        return [self.spec(), *(self.spec(marker_id) for marker_id in self.overrides)]


Method = Literal["likelihood", "uemura"]  # of decoding: ours, and that of the source paper (Uemura and others)


class DecodeSettings(_Section):
    """The section `decode`."""

    method: Method = "likelihood"


class CameraMount(_Section):
    """base_link_from_camera_link: x ahead, y left, z up; zero looks ahead."""

    position_m: MountPosition = (0.0, 0.0, 0.0)
    rpy_deg: Angles = (0.0, 0.0, 0.0)


class RobotSettings(_Section):
    """The section `robot`."""

    camera_mount: CameraMount = CameraMount()


class SerialSettings(_Section):
    """The section `serial`."""

    port: str = "/dev/ledpi-controller"
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 115200
    protocol: Literal["ledpi", "mavlink"] = "ledpi"
    mavlink_profile: Literal["ardupilot", "px4"] = "ardupilot"
    max_age_ms: MaxAgeMs = 100.0


class RewindSettings(_Section):
    """The section `rewind`."""

    seconds: Annotated[float, Field(ge=0, le=600, allow_inf_nan=False)] = 10.0
    memory_mb: Annotated[float, Field(ge=1, le=1_000_000, allow_inf_nan=False)] | None = None


class TapSettings(_Section):
    """The section `tap`."""

    socket: Annotated[str, Field(min_length=1)] | None = "auto"


class ViewSettings(_Section):
    """The section `view`: `ledpi view`, the live page."""

    listen: Listen = "127.0.0.1:8088"
    token: Token | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Number and port."""
        host, _, port = self.listen.rpartition(":")
        return ("127.0.0.1" if host == "localhost" else host.strip("[]")), int(port)


class Config(_Section):
    """The whole configuration, valid once built. Paths in it are absolute."""

    camera: CameraSettings = CameraSettings()
    panels: PanelSettings
    decode: DecodeSettings = DecodeSettings()
    map: Path | None = None
    robot: RobotSettings = RobotSettings()
    serial: SerialSettings = SerialSettings()
    rewind: RewindSettings = RewindSettings()
    tap: TapSettings = TapSettings()
    view: ViewSettings = ViewSettings()
    _from_command_line: frozenset[str] = PrivateAttr(default=frozenset())
    _file: Path | None = PrivateAttr(default=None)

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


def load_config(path: Path | None, overrides: tuple[str, ...] = (), *, without_file: tuple[str, ...] = ()) -> Config:
    """Reads a configuration and applies `--set key.key=value` overrides (values are YAML).

    Without a file the overrides must hold what has no default (`panels.side_m`, but for the simulator and recordings),
    or `without_file` must: overrides that a command brings itself for that case, weaker than the user's.
    Raises ConfigError.
    """
    if path is None and not (overrides or without_file):
        raise ConfigError("no configuration: --config FILE, ./config.yaml or /etc/ledpi/config.yaml")
    where = str(path) if path is not None else "configuration"
    raw = _sections(path) if path is not None else {}
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
    try:
        config = Config.model_validate(raw)
    except ValidationError as error:
        raise ConfigError(f"{where}: {explain(error, Config)}") from None
    config = _resolve_paths(config, base, from_command_line)
    config._from_command_line = frozenset(from_command_line)
    config._file = None if path is None else path.absolute()
    _check_panels(config.panels, where)
    if config.camera.row_time_us != "auto":
        check_bands_visible(config.panels, config.camera.row_time_us, where)
    check_method(config.decode.method, config.panels, f"{where}: decode.method")
    return config


def check_method(method: Method, panels: PanelSettings, where: str) -> None:
    """Raises ConfigError where the method cannot read such panels. `where`: the key or option that names the method."""
    if method == "uemura" and panels.has_antiphase():
        raise ConfigError(
            f"{where}: uemura distinguishes classes by the height of their bands, and with phase: antiphase they "
            "are alike; must be likelihood"
        )


def check_bands_visible(panels: PanelSettings, row_time_us: float, where: str) -> None:
    """Raises ConfigError where no picture with such rows shows how panels blink."""
    try:
        check_cycles_fit(panels.frequencies_hz(), row_time_us)
    except ValueError as error:
        raise ConfigError(f"{where}: panels: {error}") from None


def _check_panels(panels: PanelSettings, where: str) -> None:
    """Values that are right one by one may contradict each other, or the dictionary."""
    try:
        dictionary = load_dictionary(panels.dictionary)
    except ValueError as error:
        raise ConfigError(f"{where}: panels.dictionary: {error}") from None
    known = len(dictionary.codewords)
    beyond = [listed for listed in panels.ids or () if listed >= known]
    if beyond:
        has = f"{panels.dictionary} has only the IDs 0 to {known - 1}"
        raise ConfigError(f"{where}: panels.ids: {has}, not {beyond[0]}")
    for marker_id in (None, *panels.overrides):
        key = "panels" if marker_id is None else f"panels.overrides.{marker_id}"
        if marker_id is not None and marker_id >= known:
            raise ConfigError(f"{where}: {key}: {panels.dictionary} has only the IDs 0 to {known - 1}")
        try:
            spec = panels.spec(marker_id)
            if marker_id is not None:
                dictionary.check_readable(marker_id, spec.phase)
            elif not dictionary.readable_ids(spec.phase):
                raise ValueError(dictionary.none_readable(spec.phase))
        except ValueError as error:
            raise ConfigError(f"{where}: {key}: {error}") from None


def _sections(path: Path) -> dict[str, Any]:
    raw = read_yaml(path, ConfigError)
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be sections (camera:, panels:, …), not {shortened(raw)}")
    return raw


def _size_of_own_panels(raw: dict[str, Any]) -> None:
    """What shows panels of its own needs no size of others: without a file, that of the example stands in."""
    camera, panels = raw.get("camera"), raw["panels"]
    source = str(camera.get("source")) if isinstance(camera, dict) else ""
    if source.partition(":")[0] in ("simulated", "recording") and isinstance(panels, dict):
        panels.setdefault("side_m", 0.16)


def _resolve_paths(config: Config, base: Path, from_command_line: set[str]) -> Config:
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
    if config.tap.socket not in (None, "auto"):
        changes_top["tap"] = TapSettings(socket=str(absolute(config.tap.socket, "tap.socket")))
    return config.model_copy(update=changes_top)
