"""The page that goes with a driver's sources: which pin drives what, how to flash it, and how to talk to it."""

from __future__ import annotations

from ledpi.markers.codewords import format_ranges
from ledpi.tools.panel.firmware import Build, Firmware
from ledpi.tools.panel.timer import HalfPeriod

OUTPUTS = {False: "D9", True: "D10"}  # by class; True is white
CELL_PINS = (*(f"D{n}" for n in range(2, 14)), *(f"A{n}" for n in range(4)))  # cell by cell, row by row


def readme_text(firmware: Firmware) -> str:
    """README.md of a folder of sources."""
    wiring = _two_outputs if firmware.build is Build.TWO_OUTPUTS else _sixteen_cells
    return "\n".join([_head(firmware), wiring(firmware), _BUILDING, _brightness(firmware)])


def _head(firmware: Firmware) -> str:
    return f"""# Driver of panel {firmware.marker_id} of {firmware.dictionary.name}

For an ATmega328P at 16 MHz: Arduino Uno, Nano, Pro Mini 5 V.

| class | asked | made | off by | half a period |
|---|---|---|---|---|
{_class_row("black", firmware.black)}
{_class_row("white", firmware.white)}

"Off by" is the timer's part, and exact; the board's clock adds its own. A crystal is within 100 ppm, a ceramic
resonator, which many an Uno has, within 5000 ppm; `ledpi calibrate panel` measures it.
"""


def _class_row(name: str, half: HalfPeriod) -> str:
    return (
        f"| {name} | {half.asked_hz:g} Hz | {half.frequency_hz:.4f} Hz | {half.error_ppm:+.1f} ppm "
        f"| {half.cycles} cycles |"
    )


def _two_outputs(firmware: Firmware) -> str:
    rows = [[OUTPUTS[bool(white)] for white in row] for row in firmware.codeword]
    return f"""## Wiring

D9 switches all cells of class black, D10 all of class white, each through a MOSFET: a pin cannot carry the LEDs.
{_both_views(rows)}
`ledpi panel sheet {firmware.marker_id} --out sheet` draws it true to scale, with the MOSFETs.

The timer's hardware toggles both pins: the edges do not jitter.{_antiphase(firmware)}
"""


def _sixteen_cells(firmware: Firmware) -> str:
    n = firmware.dictionary.cells_per_side
    rows = [list(CELL_PINS[n * row : n * row + n]) for row in range(n)]
    return f"""## Wiring

Each cell has its own pin. A pin carries one LED with its resistor, to GND; more LEDs need a MOSFET in each cell.
`ledpi panel sheet {firmware.marker_id} --direct --out sheet` draws the former, with the values.
{_both_views(rows)}
D0 and D1 are the serial line, A4 and A5 are free. Edges jitter by less than 4 µs.{_antiphase(firmware)}

## Changing the ID

Over USB, 9600 baud, 8N1. One line to the panel, one line back; wait for it before the next.

| you send | it answers | |
|---|---|---|
| `id` | `ok id {firmware.marker_id}` | what is shown |
| `id 10` | `ok id 10` | shown at once, and after every power-up |
| anything else | `error: …` | nothing changes |

The Arduino IDE's serial monitor, set to "New Line", will do. Many boards restart when their port is opened, and listen
a second or two later.

The ID is kept in the EEPROM. A program built for another ID or dictionary starts with its own. Where the EEPROM holds
something else, from another program or because the power failed while an ID was written, the panel stays dark until it
is told an ID: dark is better than wrong.
"""


def _antiphase(firmware: Firmware) -> str:
    """Says how the classes go together, where they do."""
    if firmware.phase == "free":
        return ""
    text = " Black and white are in antiphase: one is on while the other is off (`panels.phase: antiphase`)."
    readable = firmware.dictionary.readable_ids("antiphase")
    if len(readable) < len(firmware.dictionary.codewords):
        text += f" Only the IDs {format_ranges(readable)} can be read so."
    return text


def _both_views(rows: list[list[str]]) -> str:
    return f"""Which one drives which cell, **seen from the front**, the marker's top above:

{_grid(rows)}

**Seen from the back**, where you solder:

{_grid([row[::-1] for row in rows])}
"""


def _grid(rows: list[list[str]]) -> str:
    return "\n".join(("    " + "".join(cell.ljust(5) for cell in row)).rstrip() for row in rows)


_BUILDING = """## Building and flashing

    make                              # the .hex; needs gcc-avr, avr-libc, make
    make flash PORT=/dev/ttyUSB0      # needs avrdude; an older Nano: BAUD=57600

The Arduino bootloader stays, the Arduino runtime is not used. On a bare chip set its fuses for a crystal first.
"""


def _brightness(firmware: Firmware) -> str:
    second_hz, white_hz = 2.0 * firmware.black.frequency_hz, firmware.white.frequency_hz
    why = (
        "A wave that is on for half of its period holds odd harmonics only. At any other duty it holds even ones, too: "
        f"black's\nsecond, {second_hz:.0f} Hz, is then read beside white's {white_hz:.0f} Hz."
    )
    if firmware.phase == "antiphase":
        why = "At any other duty than a half one class's light would not fill the other's gaps."
    return f"""## Brightness

Set it by the LEDs' current, that is by their resistors, and never by duty. Current scales the wave and leaves its form.
{why} The decoder is told one duty for all panels. Dimming by a second, faster PWM is worse: it beats with both
classes.
"""
