"""The driver's firmware for one panel: what is asked for → a folder of sources, ready to build."""

from __future__ import annotations

import shutil
import subprocess
import zlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template

from ledpi.core.codewords import Bits, Dictionary, format_ranges
from ledpi.core.errors import ConfigError, raising
from ledpi.core.records import PanelSpec, Phase
from ledpi.core.wording import StrEnum
from ledpi.workshop.calibrate.panel import SAME_DUTY
from ledpi.workshop.panel import frequencies
from ledpi.workshop.panel.circuit import CELL_PINS, OUTPUTS

SINGLE_CELLS = 16  # that the board has pins for, the serial line left free


class Build(StrEnum):
    """The driver's wiring: an output for each class, or one for each cell."""

    TWO_OUTPUTS = "two-outputs"
    SIXTEEN_CELLS = "sixteen-cells"

    @property
    def source(self) -> str:
        """Name of its C file."""
        return self.value.replace("-", "_") + ".c"


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """All that a driver's sources depend on."""

    build: Build
    dictionary: Dictionary
    marker_id: int
    black: frequencies.HalfPeriod
    white: frequencies.HalfPeriod
    phase: Phase

    @property
    def codeword(self) -> Bits:
        """The (n, n) codeword of the ID, upright."""
        return self.dictionary.codeword(self.marker_id)


def plan_firmware(
    build: Build,
    dictionary: Dictionary,
    marker_id: int,
    spec: PanelSpec,
    *,
    exposure_us: float,
    scan_time_s: float,
    duty_key: str = "panels.duty",
) -> Firmware:
    """Raises ConfigError where the board cannot drive such a panel, or the camera could not read it.

    `duty_key` is where the configuration has the duty from; a duty that was measured is off a half by noise.
    `exposure_us` is what the sensor really does, whole rows; `scan_time_s` is the time in which it reads them all.
    """
    with raising("--id", ConfigError):
        dictionary.check_readable(marker_id, spec.phase)
        codeword = dictionary.codeword(marker_id)
    if build is Build.SIXTEEN_CELLS and codeword.size != SINGLE_CELLS:
        raise ConfigError(
            f"--build {build}: drives 4 × 4 cells, {dictionary.name} has {codeword.size}; must be {Build.TWO_OUTPUTS}, "
            "which drives two groups of cells, however many they are"
        )
    if abs(spec.duty - 0.5) > SAME_DUTY:
        raise ConfigError(f"{duty_key}: the driver's outputs are on for half a period; must be 0.5, not {spec.duty}")
    if spec.phase == "free":
        _check_apart(spec, scan_time_s)
    return Firmware(
        build=build,
        dictionary=dictionary,
        marker_id=marker_id,
        black=_half_period("black_hz", spec.black_hz, exposure_us),
        white=_half_period("white_hz", spec.white_hz, exposure_us),
        phase=spec.phase,
    )


def _half_period(key: str, hz: float, exposure_us: float) -> frequencies.HalfPeriod:
    if hz <= frequencies.MAX_HZ:
        _check_frequency(key, hz, exposure_us)
    with raising(key, ConfigError):
        return frequencies.half_period(hz)


def _check_frequency(key: str, hz: float, exposure_us: float) -> None:
    lowest_hz = frequencies.Flicker.LOW_RISK.lowest_hz
    good = f"the nearest good one is {frequencies.nearest_lobe_hz(hz, exposure_us, lowest_hz):.2f} Hz"
    if hz < lowest_hz:
        raise ConfigError(
            f"{key}: {hz:g} Hz flickers: light that goes fully on and off is of low risk (IEEE 1789) from "
            f"{lowest_hz:g} Hz on; {good}"
        )
    if frequencies.null_share(hz, exposure_us) < frequencies.NULL_SHARE:
        raise ConfigError(
            f"{key}: {hz:g} Hz is on a null: an exposure of {exposure_us:.0f} µs holds {hz * exposure_us * 1e-6:.2f} "
            f"of its cycles, and whole ones leave no bands; {good}"
        )


def _check_apart(spec: PanelSpec, scan_time_s: float) -> None:
    """Over a time t two frequencies less than 1/t apart drift by less than a cycle: they look alike."""
    least_hz = 1.0 / scan_time_s
    if abs(spec.white_hz - spec.black_hz) < least_hz:
        raise ConfigError(
            f"black_hz, white_hz: {spec.black_hz:g} and {spec.white_hz:g} Hz coincide: in the "
            f"{scan_time_s * 1e3:.1f} ms of a whole picture they drift by less than a cycle; must be {least_hz:.0f} Hz "
            f"apart at the very least, and {10 * least_hz:.0f} Hz for a panel a tenth as high as the picture"
        )


def codeword_number(codeword: Bits) -> int:
    """Bit k is cell k, row by row from the top left; 1 is class white."""
    return sum(1 << k for k, white in enumerate(codeword.ravel()) if white)


def settings_text(firmware: Firmware) -> str:
    """settings.h: everything in the sources that depends on the panel."""
    dictionary = firmware.dictionary
    lines = [
        "/* Written by `ledpi panel firmware`. Half periods are in cycles of 16 MHz. */",
        *_half_period_lines("BLACK", firmware.black),
        *_half_period_lines("WHITE", firmware.white),
        _white_delay_line(firmware),
    ]
    if firmware.build is Build.SIXTEEN_CELLS:
        # Below 0x8000, so that no half-written record in the EEPROM passes for a whole one.
        build_key = zlib.crc32(dictionary.codewords.tobytes(), firmware.marker_id) & 0x7FFF
        codewords = [f"0x{codeword_number(codeword):04X}" for codeword in dictionary.codewords]
        rows = [", ".join(codewords[i : i + 10]) for i in range(0, len(codewords), 10)]
        lines += [
            f"#define DEFAULT_ID {firmware.marker_id} /* in {dictionary.name} */",
            f"#define ID_COUNT {len(codewords)}",
            f"#define BUILD_KEY 0x{build_key:04X}",
            "#define WORDS \\",
            "    { \\",
            *(f"        {row}, \\" for row in rows),
            "    }",
        ]
    return "\n".join(lines) + "\n"


def _half_period_lines(name: str, half: frequencies.HalfPeriod) -> list[str]:
    what = f"{half.frequency_hz:.4f} Hz, {half.error_ppm:+.1f} ppm from {half.asked_hz:g} Hz"
    return [f"#define {name}_HALF_PERIOD_CYCLES {half.cycles}u /* {what} */"]


def _white_delay_line(firmware: Firmware) -> str:
    """By how much white's first edge is late: half a period makes antiphase of one frequency."""
    if firmware.phase == "antiphase":
        return "#define WHITE_DELAY_CYCLES WHITE_HALF_PERIOD_CYCLES /* antiphase */"
    return "#define WHITE_DELAY_CYCLES 0u"


def readme_text(firmware: Firmware) -> str:
    """README.md of a folder of sources: which pin drives what, how to flash it, and how to talk to it."""
    black, white, n = firmware.black, firmware.white, firmware.dictionary.cells_per_side
    if firmware.build is Build.TWO_OUTPUTS:
        rows = [[OUTPUTS[bool(white)] for white in row] for row in firmware.codeword]
    else:
        rows = [list(CELL_PINS[n * row : n * row + n]) for row in range(n)]
    why_half = (
        "A wave that is on for half of its period holds odd harmonics only. At any other duty it holds even ones, too: "
        f"black's\nsecond, {2.0 * black.frequency_hz:.0f} Hz, is then read beside white's {white.frequency_hz:.0f} Hz."
    )
    if firmware.phase == "antiphase":
        why_half = "At any other duty than a half one class's light would not fill the other's gaps."
    said = {
        "id": firmware.marker_id,
        "dictionary": firmware.dictionary.name,
        "classes": "\n".join(
            f"| {name} | {half.asked_hz:g} Hz | {half.frequency_hz:.4f} Hz | {half.error_ppm:+.1f} ppm "
            f"| {half.cycles} cycles |"
            for name, half in (("black", black), ("white", white))
        ),
        "front": _grid(rows),
        "back": _grid([row[::-1] for row in rows]),
        "antiphase": _antiphase(firmware),
        "why_half": why_half,
    }
    pages = files("ledpi.workshop.panel") / "readme"
    page, wiring = (Template((pages / f"{name}.md").read_text("utf-8")) for name in ("page", firmware.build.value))
    return page.substitute(said, wiring=wiring.substitute(said))


def _antiphase(firmware: Firmware) -> str:
    """Says how the classes go together, where they do."""
    if firmware.phase == "free":
        return ""
    text = " Black and white are in antiphase: one is on while the other is off (`panels.phase: antiphase`)."
    readable = firmware.dictionary.readable_ids("antiphase")
    if len(readable) < len(firmware.dictionary.codewords):
        text += f" Only the IDs {format_ranges(readable)} can be read so."
    return text


def _grid(rows: list[list[str]]) -> str:
    return "\n".join(("    " + "".join(cell.ljust(5) for cell in row)).rstrip() for row in rows)


def write_firmware(firmware: Firmware, out: Path) -> None:
    """Writes sources and page into a new or empty folder. Raises ConfigError where that cannot be done."""
    sources = files("ledpi.workshop.panel") / "sources"
    texts = {name: (sources / name).read_text(encoding="utf-8") for name in (firmware.build.source, "Makefile")}
    texts |= {"settings.h": settings_text(firmware), "README.md": readme_text(firmware)}
    with raising(f"--out {out}: cannot be written", ConfigError, OSError):
        if out.is_dir() and any(out.iterdir()):
            raise ConfigError(f"--out {out}: is not empty; must be a new or an empty folder")
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")


def missing_tools() -> tuple[str, ...]:
    """Lists what `make` would need and is not installed."""
    return tuple(tool for tool in ("make", "avr-gcc", "avr-objcopy") if shutil.which(tool) is None)


def build_firmware(out: Path) -> Path:
    """Runs `make` in the folder; the .hex. Raises ConfigError with the compiler's words where it fails."""
    made = subprocess.run(["make", "-C", str(out)], capture_output=True, text=True, check=False)
    if made.returncode != 0:
        raise ConfigError(f"make -C {out}: {' '.join(made.stderr.split())}")
    return next(out.glob("*.hex"))
