"""The wiring and build sheet of one panel: what to buy, how to wire it, and the panel itself, true to scale."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

from ledpi.core.codewords import Dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelSpec
from ledpi.workshop.panel.body import Body, back_dxf, front_dxf, walls_dxf, walls_stl
from ledpi.workshop.panel.circuit import OUTPUTS, Circuit, PinCircuit, ohm_text
from ledpi.workshop.panel.paper import MARGIN_MM, Page, write_pdf, write_svg
from ledpi.workshop.panel.schematic import GATE_OHM, PULL_DOWN_OHM, SIZE_MM, draw_pins_schematic, draw_schematic
from ledpi.workshop.panel.sheet_parts import draw_section, draw_wall, electrics, parts, pin_electrics, pin_parts
from ledpi.workshop.panel.sheet_views import (
    View,
    draw_back,
    draw_front,
    draw_pins_back,
    draw_pins_front,
    scaled_view,
    tiles,
    true_views,
)

_MAX_PARTS = 30  # that a panel is put together from


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """All that a sheet shows."""

    dictionary: Dictionary
    marker_id: int
    spec: PanelSpec
    circuit: Circuit | PinCircuit
    body: Body

    @property
    def title(self) -> str:
        """As in `Panel ID 7 of DICT_4X4_50`."""
        return f"Panel ID {self.marker_id} of {Path(self.dictionary.name).stem}"

    @property
    def views(self) -> tuple[View, View]:
        """Front and back."""
        return (draw_pins_front, draw_pins_back) if isinstance(self.circuit, PinCircuit) else (draw_front, draw_back)


def sheet_pages(sheet: Sheet) -> list[tuple[str, Page]]:
    """The pages, each with a short name."""
    columns, rows = tiles(sheet.body)
    if columns * rows > _MAX_PARTS:
        raise ConfigError(
            f"a panel of {sheet.spec.side_m:g} m takes {columns * rows} pages of A4 at 1 : 1; must be at most "
            f"{_MAX_PARTS}: --side 1, and a print shop for more"
        )
    back = (
        f"From the back, as it is soldered. ○: LED, {sheet.body.led_mm:g} mm; arrows: + to −, into an LED's long leg; "
        f"rectangle: {ohm_text(sheet.circuit.resistor_ohm)}."
    )
    pages = [("overview", _overview(sheet)), ("circuit", _circuit_page(sheet))]
    front = "From the front, as the camera sees it."
    for name, view, text in zip(("front", "back"), sheet.views, (front, back), strict=True):
        drawn = true_views(sheet.title, text, view, sheet.body, sheet.marker_id)
        pages += [(f"{name}{number + 1 if len(drawn) > 1 else ''}", page) for number, page in enumerate(drawn)]
    return pages


def write_sheet(sheet: Sheet, out: Path) -> Path:
    """The PDF; beside it an SVG of each page, and plates and walls for machines.

    Raises ConfigError where they cannot be written.
    """
    pages = sheet_pages(sheet)
    path = out / f"panel-{sheet.marker_id}.pdf"
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_pdf([page for _, page in pages], path)
        for name, page in pages:
            write_svg(page, out / f"panel-{sheet.marker_id}-{name}.svg")
        for part, dxf in (("front", front_dxf), ("back", back_dxf), ("walls", walls_dxf)):
            (out / f"panel-{sheet.marker_id}-{part}.dxf").write_text(dxf(sheet.body), encoding="ascii")
        (out / f"panel-{sheet.marker_id}-walls.stl").write_bytes(walls_stl(sheet.body))
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot be written: {error.strerror}") from None
    return path


def _overview(sheet: Sheet) -> Page:
    body, spec = sheet.body, sheet.spec
    later = ", half a cycle later" if spec.phase == "antiphase" else ""
    page = Page(
        sheet.title,
        f"{body.cells} × {body.cells} cells. B: class black, bit 0, {spec.black_hz:g} Hz. W: class white, bit 1, "
        f"{spec.white_hz:g} Hz{later}. Lit square {body.side_mm:g} mm (panels.side_m: {spec.side_m:g}).",
    )
    size = 82.0
    for x, view, text in zip((MARGIN_MM, MARGIN_MM + 98), sheet.views, ("front", "back"), strict=True):
        page.paper.text(x + size / 2, 268, f"from the {text}", fontsize=9, ha="center")
        scaled_view(page, view, body, sheet.marker_id, (x, 182), size)
    page.paper.text(MARGIN_MM, 177, "● is the marker's first corner: top left from the front.", fontsize=7)
    page.paper.text(MARGIN_MM, 167, "LEDs and resistors", fontsize=10, weight="bold")
    if isinstance(sheet.circuit, PinCircuit):
        figures, bought = pin_electrics(sheet.circuit, body.pitch_mm), pin_parts(body, sheet.circuit)
    else:
        figures, bought = electrics(sheet.circuit), parts(body, sheet.circuit)
    foot = page.table(MARGIN_MM, 165, (48, 132), figures)
    page.paper.text(MARGIN_MM, foot - 8, "Parts", fontsize=10, weight="bold")
    page.table(MARGIN_MM, foot - 10, (14, 48, 118), bought)
    return page


def _circuit_page(sheet: Sheet) -> Page:
    page = Page(sheet.title, "Driver, walls and section; these are not to scale, measures are in mm")
    width, height = SIZE_MM
    axes = page.window(MARGIN_MM, 158, width, height, (0, width), (0, height))
    if isinstance(sheet.circuit, PinCircuit):
        draw_pins_schematic(axes, sheet.circuit)
    else:
        draw_schematic(axes, sheet.circuit, (sheet.spec.black_hz, sheet.spec.white_hz))
    notes = _notes(sheet)
    page.paper.text(MARGIN_MM, 154, "\n".join(textwrap.wrap(notes, 130)), fontsize=7, va="top")
    page.paper.text(MARGIN_MM, 132, "Walls between the cells", fontsize=10, weight="bold")
    draw_wall(page, sheet.body, 92)
    page.paper.text(MARGIN_MM, 74, "Section", fontsize=10, weight="bold")
    draw_section(page, sheet.body, 24)
    return page


def _notes(sheet: Sheet) -> str:
    if isinstance(sheet.circuit, PinCircuit):
        return (
            f"The pins are those of `ledpi panel firmware --id {sheet.marker_id} --build sixteen-cells`. Brightness is "
            "set by the resistors, never by duty. The resistors are for these LEDs: others need others (--led-voltage)."
        )
    return (
        f"{OUTPUTS[False]} and {OUTPUTS[True]} are those of `ledpi panel firmware --id {sheet.marker_id}`. "
        f"{ohm_text(GATE_OHM)} keep a pin below 40 mA while a gate charges (20 nC: 2 µs); {ohm_text(PULL_DOWN_OHM)} "
        "keep the LEDs off while the chip starts. Brightness is set by the LEDs' resistors, never by duty. No "
        "capacitor after the MOSFETs: it would smooth the light away."
    )
