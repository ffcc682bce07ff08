"""`ledpi simulate`: a recording of a simulated scene, with truth."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import typer

from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import Scene
from ledpi.camera.simulate.scenes import DRIVE_IDS, board_scene, still_scene
from ledpi.camera.simulated import SimulatedCamera, simulated_drive, simulated_sensor
from ledpi.cli import CONFIG, SET, app, progress
from ledpi.config.camera_yaml import camera_yaml_text
from ledpi.config.overrides import overrides_of
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import Config, find_config, load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError, raising
from ledpi.core.records import PanelSpec
from ledpi.core.wording import StrEnum, counted
from ledpi.workshop.calibrate.boards import Board, Kind
from ledpi.workshop.calibrate.files import write_keeping_old

_STILL_IDS, _STILL_DISTANCE_M, _STILL_ANGLE_DEG = [7], 1.0, 0.0


class SceneName(StrEnum):
    """The values of --scene."""

    DRIVE = "drive"
    BOARD = "board"


class TransferName(StrEnum):
    """The values of --transfer."""

    LINEAR = "linear"
    SRGB = "srgb"


@app.command()
def simulate(
    out: Path = typer.Argument(metavar="OUT", help="Folder for the recording: new, or empty."),
    frames: int = typer.Option(60, min=1, help="Frames to render."),
    scene: SceneName | None = typer.Option(
        None, help="drive: a robot driving past panels 7 and 23. board: a ChArUco board, held at different angles."
    ),
    distance: float | None = typer.Option(
        None, min=0.05, max=1000, help="Distance of still panels, in metres. Default: 1."
    ),
    angle: float | None = typer.Option(None, min=-88, max=88, help="Yaw of still panels, in degrees. Default: 0."),
    id_: list[int] = typer.Option(
        [], "--id", help="ID of a still panel. Repeat it for panels side by side. Default: 7."
    ),
    exposure_us: float | None = typer.Option(None, help="Overrides camera.exposure_us; whole rows, rounded down."),
    transfer: TransferName | None = typer.Option(None, help="Overrides camera.transfer."),
    seed: int = typer.Option(0, min=0, help="Seed of noise and phases: the same seed gives the same recording."),
    config: Path | None = CONFIG,
    set_: list[str] = SET,
) -> None:
    """Simulated panels → a recording, with the truth.

    Camera and panels come from the configuration. Without one, panels are 16 cm wide. truth.jsonl holds the poses,
    camera.yaml the lens.

    Example: ledpi simulate take --distance 2 --angle 30 --id 7 --frames 100 --exposure-us 150
    """
    overrides = overrides_of(set_, {"camera.exposure_us": exposure_us, "camera.transfer": transfer})
    settings = load_config(find_config(config), overrides, without_file=("panels.side_m=0.16",))
    if scene is not None:
        if id_ or distance is not None or angle is not None:
            raise ConfigError(f"--scene {scene}: --id, --distance and --angle are of still panels")
        built = _drive(settings) if scene is SceneName.DRIVE else _board(settings)
    else:
        place = (_STILL_DISTANCE_M if distance is None else distance, _STILL_ANGLE_DEG if angle is None else angle)
        built = _still(settings, id_ or _STILL_IDS, *place)
    _record(out, built, settings.panels, frames=frames, seed=seed)
    typer.echo(f"{out}: {counted(frames, 'frame')}, with the truth; next: ledpi decode {shlex.quote(str(out))}")


def _drive(settings: Config) -> Scene:
    sensor = simulated_sensor(settings.camera, settings.panels)
    return simulated_drive(sensor, _specs(settings.panels, DRIVE_IDS), settings.panels.dictionary)


def _board(settings: Config) -> Scene:
    """The board that `ledpi calibrate board` prints."""
    sensor = simulated_sensor(settings.camera, settings.panels)
    return board_scene(sensor, Board(columns=6, rows=5, kind=Kind.CHARUCO).black(), width_m=7 * 0.03)


def _still(settings: Config, ids: list[int], distance_m: float, angle_deg: float) -> Scene:
    sensor = simulated_sensor(settings.camera, settings.panels)
    specs = _specs(settings.panels, ids)
    with raising("--id", ConfigError):
        for marker_id in ids:
            load_dictionary(settings.panels.dictionary).check_readable(marker_id, settings.panels.phase)
        return still_scene(sensor, specs, settings.panels.dictionary, distance_m=distance_m, angle_deg=angle_deg)


def _specs(panels: PanelSettings, ids: list[int] | tuple[int, ...]) -> dict[int, PanelSpec]:
    """Each ID's panel, which must be the common one."""
    for marker_id in ids:
        if panels.spec(marker_id) != panels.spec():
            raise ConfigError(
                f"panels.overrides.{marker_id}: a recording describes one kind of panel; must not concern a shown ID"
            )
    return dict.fromkeys(ids, panels.spec())


def _record(out: Path, scene: Scene, panels: PanelSettings, *, frames: int, seed: int) -> None:
    camera = SimulatedCamera(scene, seed=seed, paced=False, frames=frames)
    pixels = np.empty((camera.info.height, camera.info.width), np.uint8)
    writer = RecordingWriter(
        out, camera=camera.info, dictionary=panels.dictionary, panel=panels.spec(), note=f"simulated, seed {seed}"
    )
    with writer, progress("simulating", frames) as advance:
        while (frame := camera.read(pixels)) is not None:
            writer.write(frame, camera.truth(frame.seq))
            advance(1)
    write_keeping_old(out / "camera.yaml", camera_yaml_text(scene.sensor.intrinsics, {}))
