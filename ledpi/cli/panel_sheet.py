"""`ledpi panel sheet`: what to buy, how to wire it, and the panel true to scale, on paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ledpi.cli.panel import panel
from ledpi.cli.progress import progress
from ledpi.core.errors import ConfigError

if TYPE_CHECKING:
    from ledpi.config.panels import PanelSettings
    from ledpi.tools.panel.circuit import Circuit, Lamps
    from ledpi.tools.panel.pins import PinCircuit
    from ledpi.tools.panel.sheet import Sheet

_SUPPLY_V, _LED_MA, _PIN_LED_MA = 12.0, 20.0, 7.5


@panel.command()
def sheet(
    ids: list[int] = typer.Argument(metavar="ID…", help="IDs of the panels."),
    out: Path = typer.Option(..., "--out", metavar="FOLDER", help="Folder for panel-ID.pdf, SVG, DXF and STL."),
    direct: bool = typer.Option(
        False, "--direct", help="One LED a cell, straight from the sixteen pins of an Uno: no MOSFETs, no supply."
    ),
    supply: float | None = typer.Option(None, min=1, metavar="V", help="Supply of the LEDs. Default: 12."),
    leds: int | None = typer.Option(
        None, help="LEDs in series in each cell. Default: as many as the supply carries, 4 at most."
    ),
    led_voltage: float = typer.Option(3.2, min=1, max=60, metavar="V", help="Forward voltage of one LED."),
    led_ma: float | None = typer.Option(
        None, min=0.1, max=3000, metavar="MA", help="LED current while on. Default: 20; with --direct 7.5."
    ),
    side: float | None = typer.Option(None, min=0.01, max=10, metavar="M", help="Default: panels.side_m."),
    config: Path | None = typer.Option(None, "--config", help="Default: ./config.yaml, /etc/ledpi/config.yaml."),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Overrides a key of the configuration."),
) -> None:
    """Draw wiring and build sheets, true to scale.


    The sheet has the classes from both sides, the circuit, the parts, and the panel at 1 : 1, on several pages if one
    is too small. Front, back and walls are also written as DXF for a laser cutter, and the walls as STL for a 3D
    printer, all in millimetres. Dictionary, size and frequencies come from the configuration.

    Example: ledpi panel sheet 7 23 --out sheets --supply 12 --led-ma 15

    Example: ledpi panel sheet 7 --direct --side 0.12 --out sheet
    """
    from ledpi.config.settings import find_config, load_config
    from ledpi.tools.panel.matplotlib_extra import require_matplotlib

    file = find_config(config)
    overrides = [] if file is not None else ["panels.side_m=0.16"]
    overrides += set_ + ([f"panels.side_m={side}"] if side is not None else [])
    panels = load_config(file, tuple(overrides)).panels
    require_matplotlib("build sheets")
    from ledpi.tools.panel.circuit import Lamps
    from ledpi.tools.panel.pins import plan_pins
    from ledpi.tools.panel.sheet import write_sheet

    lamps: Lamps | PinCircuit
    if direct:
        _check_direct(supply, leds)
        lamps = plan_pins(led_voltage, 1e-3 * (led_ma or _PIN_LED_MA))
    else:
        supply_v, current_a = supply or _SUPPLY_V, 1e-3 * (led_ma or _LED_MA)
        lamps = Lamps(supply_v=supply_v, leds=leds, forward_v=led_voltage, current_a=current_a)
    sheets = [_planned(panels, marker_id, lamps) for marker_id in dict.fromkeys(ids)]
    with progress("drawing", len(sheets)) as advance:
        for planned in sheets:
            typer.echo(str(write_sheet(planned, out)))
            advance(1)
    if note := panels.unreported_note(ids):
        typer.echo(note)


def _check_direct(supply: float | None, leds: int | None) -> None:
    if supply is not None:
        raise ConfigError(f"--supply {supply:g}: with --direct the Arduino's USB gives the LEDs 5 V; leave it out")
    if leds not in (None, 1):
        raise ConfigError(f"--leds {leds}: a pin's 5 V carry one LED; must be 1 with --direct")


def _planned(panels: PanelSettings, marker_id: int, lamps: Lamps | PinCircuit) -> Sheet:
    from ledpi.markers.dictionaries import load_dictionary
    from ledpi.tools.panel.body import Body
    from ledpi.tools.panel.circuit import plan_circuit
    from ledpi.tools.panel.firmware import SINGLE_CELLS
    from ledpi.tools.panel.pins import PinCircuit
    from ledpi.tools.panel.sheet import Sheet

    dictionary, spec = load_dictionary(panels.dictionary), panels.spec(marker_id)
    try:
        dictionary.check_readable(marker_id, spec.phase)
        codeword = dictionary.codeword(marker_id)
    except ValueError as error:
        raise ConfigError(f"ID {marker_id}: {error}") from None
    circuit: Circuit | PinCircuit
    if isinstance(lamps, PinCircuit):
        if codeword.size != SINGLE_CELLS:
            raise ConfigError(
                f"--direct: an Uno has pins for {SINGLE_CELLS} cells, {dictionary.name} has {codeword.size}"
            )
        circuit, leds = lamps, 1
    else:
        white = int(codeword.sum())
        circuit = plan_circuit(lamps, (codeword.size - white, white))
        leds = circuit.leds
    body = Body(codeword=codeword, side_mm=round(1e3 * spec.side_m, 3), leds=leds)
    return Sheet(dictionary=dictionary, marker_id=marker_id, spec=spec, circuit=circuit, body=body)
