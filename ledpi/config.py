"""config.yaml → a frozen `Config`. A wrong key or value is a `ConfigError` with file, key, and what is allowed."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ledpi.errors import ConfigError
from ledpi.markers import load_dictionary
from ledpi.records import PanelSpec, Transfer

SEARCH_PATH = (Path("config.yaml"), Path("/etc/ledpi/config.yaml"))

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Duty = Annotated[float, Field(gt=0, lt=1)]
Vector3 = tuple[Finite, Finite, Finite]
Auto = Literal["auto"]


def _known_source(source: str) -> str:
    kind, _, rest = source.partition(":")
    if source in ("picamera2", "simulated") or (kind in ("recording", "v4l2") and rest):
        return source
    raise ValueError("must be picamera2, simulated, recording:PATH or v4l2:/dev/videoN")


def _known_dictionary(name: str) -> str:
    load_dictionary(name)
    return name


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class CameraSettings(_Section):
    source: Annotated[str, AfterValidator(_known_source)] = "picamera2"
    width: Annotated[int, Field(ge=32, le=8192)] = 640
    height: Annotated[int, Field(ge=32, le=8192)] = 480
    exposure_us: Positive = 10000.0
    frame_duration_us: Positive | Auto = "auto"
    analogue_gain: Annotated[float, Field(ge=1, le=64)] | Auto = "auto"
    row_time_us: Positive | Auto = "auto"
    transfer: Transfer | Auto = "auto"
    intrinsics: Path | None = None


class PanelOverride(_Section):
    side_m: Positive | None = None
    black_hz: Positive | None = None
    white_hz: Positive | None = None
    duty: Duty | None = None


class PanelSettings(_Section):
    dictionary: Annotated[str, AfterValidator(_known_dictionary)] = "DICT_4X4_50"
    side_m: Positive
    black_hz: Positive = 1250.0
    white_hz: Positive = 2450.0
    duty: Duty = 0.5
    overrides: dict[Annotated[int, Field(ge=0)], PanelOverride] = {}

    def spec(self, marker_id: int | None = None) -> PanelSpec:
        """The panel of one ID, or, without an ID, the common one. Raises ValueError where they contradict."""
        values = self.model_dump(include={"side_m", "black_hz", "white_hz", "duty"})
        if marker_id is not None and marker_id in self.overrides:
            values |= self.overrides[marker_id].model_dump(exclude_none=True)
        return PanelSpec(**values)


class DecodeSettings(_Section):
    method: Literal["soft"] = "soft"


class CameraMount(_Section):
    """base_link_from_camera_link: x ahead, y left, z up; zero looks ahead."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)


class RobotSettings(_Section):
    camera_mount: CameraMount = CameraMount()


class SerialSettings(_Section):
    port: str = "/dev/ledpi-controller"
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 115200
    protocol: Literal["ledpi"] = "ledpi"
    max_age_ms: Positive = 100.0


class Config(_Section):
    """The whole configuration, valid once built. Paths in it are absolute."""

    camera: CameraSettings = CameraSettings()
    panels: PanelSettings
    decode: DecodeSettings = DecodeSettings()
    map: Path | None = None
    robot: RobotSettings = RobotSettings()
    serial: SerialSettings = SerialSettings()


def find_config(explicit: Path | None) -> Path | None:
    """The file to read: `--config`, else ./config.yaml, else /etc/ledpi/config.yaml, else None."""
    if explicit is not None:
        return explicit
    return next((path for path in SEARCH_PATH if path.is_file()), None)


def load_config(path: Path | None, overrides: tuple[str, ...] = ()) -> Config:
    """Reads a configuration and applies `--set key.key=value` overrides (values are YAML).

    Without a file the overrides alone must hold what has no default (`panels.side_m`).
    Raises ConfigError.
    """
    where = str(path) if path is not None else "configuration"
    raw = _read_yaml(path) if path is not None else {}
    base = path.parent if path is not None else Path()
    from_command_line = set()
    for item in overrides:
        from_command_line.add(_apply_override(raw, item))
    try:
        config = Config.model_validate(raw)
        _check_panels(config.panels)
    except ValidationError as error:
        raise ConfigError(f"{where}: {_explain(error)}") from None
    except ValueError as error:
        raise ConfigError(f"{where}: panels: {error}") from None
    return _with_absolute_paths(config, base, from_command_line)


def _check_panels(panels: PanelSettings) -> None:
    panels.spec()
    known = len(load_dictionary(panels.dictionary).words)
    for marker_id in panels.overrides:
        if marker_id >= known:
            raise ValueError(f"overrides: {panels.dictionary} has the IDs 0 to {known - 1}, not {marker_id}")
        panels.spec(marker_id)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8 text") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path}: must be a mapping of sections (camera:, panels:, …), not {type(raw).__name__}")
    return raw


def _apply_override(raw: dict[str, Any], item: str) -> str:
    key, equals, text = item.partition("=")
    if not equals or not key:
        raise ConfigError(f"--set {item}: must be KEY=VALUE, as in --set camera.source=simulated")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise ConfigError(f"--set {item}: {text!r} is not a YAML value") from None
    *sections, last = key.split(".")
    node: Any = raw
    for name in sections:
        if node.get(name) is None:
            node[name] = {}
        node = node[name]
        if not isinstance(node, dict):
            raise ConfigError(f"--set {item}: {name} is a value, not a section")
    node[last] = value
    return key


def _allowed_keys(location: tuple[int | str, ...]) -> list[str]:
    model: Any = Config
    for part in location:
        field = model.model_fields.get(part) if isinstance(part, str) else None
        if isinstance(part, int):
            model = PanelOverride
        elif field is not None and isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            model = field.annotation
    return sorted(model.model_fields)


def _explain(error: ValidationError) -> str:
    """One line for the first thing that is wrong, with the number of the others."""
    problems = error.errors()
    # A value that may be a number or `auto` fails once for each: the message about the number says more.
    first = problems[0]
    location = tuple(part for part in first["loc"] if not _is_union_branch(part))
    key = ".".join(str(part) for part in location)
    if first["type"] == "extra_forbidden":
        allowed = _allowed_keys(location[:-1])
        close = difflib.get_close_matches(str(location[-1]), allowed, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        text = f"{key}: unknown key; {hint}allowed here: {', '.join(allowed)}"
    elif first["type"] == "missing":
        text = f"{key}: must be given (it has no default)"
    else:
        auto = " (or auto)" if any("auto" in str(p.get("ctx", {}).get("expected", "")) for p in problems[1:]) else ""
        text = f"{key}: {first['msg'].removeprefix('Value error, ')}{auto}, not {first['input']!r}"
    others = len({tuple(q for q in p["loc"] if not _is_union_branch(q)) for p in problems}) - 1
    return text + (f" (and {others} more)" if others > 0 else "")


def _is_union_branch(part: int | str) -> bool:
    """Whether a part of pydantic's error location names a type and not a key, as `literal['auto']` does."""
    return isinstance(part, str) and (part in ("float", "int", "str", "[key]") or "[" in part)


def _with_absolute_paths(config: Config, base: Path, from_command_line: set[str]) -> Config:
    """Paths in the file are relative to it, paths given with --set to the working directory."""

    def absolute(path: Path | str, key: str) -> Path:
        start = Path() if key in from_command_line else base
        return (start / Path(path).expanduser()).absolute()

    camera = config.camera
    changes: dict[str, Any] = {}
    if camera.intrinsics is not None:
        changes["intrinsics"] = absolute(camera.intrinsics, "camera.intrinsics")
    kind, _, rest = camera.source.partition(":")
    if kind == "recording":
        changes["source"] = f"recording:{absolute(rest, 'camera.source')}"
    changes_top: dict[str, Any] = {"camera": camera.model_copy(update=changes)}
    if config.map is not None:
        changes_top["map"] = absolute(config.map, "map")
    return config.model_copy(update=changes_top)
