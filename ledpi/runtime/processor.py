"""The processor's temperature, and whether the Pi's firmware slows it down: as the kernel tells in /sys."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SYS = Path("/sys")
_TEMPERATURE = "class/thermal/thermal_zone0/temp"  # m°C
# The Raspberry Pi kernel's own; what `vcgencmd get_throttled` prints, in hexadecimal. Absent on other machines.
# The folders are named by the SoC's bus: `soc` up to the Pi 4, `soc@107c000000` of a Pi 5.
_THROTTLED = "devices/platform/soc*/soc*:firmware/get_throttled"
# Of the firmware's hwmon device, which is there also where a Pi 5's kernel has no file for the rest. It says
# under-voltage, now; without that nothing is known.
_LOW_VOLTAGE = "devices/platform/soc*/soc*:firmware/raspberrypi-hwmon*/hwmon/hwmon*/in0_lcrit_alarm"
UNDER_VOLTAGE = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Processor:
    """None where this machine does not tell."""

    temperature_c: int | None
    throttling: int | None  # as the status message's: bits 0 to 3 now, 8 to 11 the same since boot


def read_processor(sys: Path = SYS) -> Processor:
    """Returns what the files say now; a file that is absent or says nonsense is None."""
    temperature = _number(sys / _TEMPERATURE, 10)
    throttled = next((_number(file, 16) for file in sys.glob(_THROTTLED)), None)
    if throttled is None and any(_number(file, 10) == 1 for file in sys.glob(_LOW_VOLTAGE)):
        throttled = UNDER_VOLTAGE
    return Processor(
        temperature_c=None if temperature is None else round(temperature / 1000),
        throttling=None if throttled is None else throttled & 0xF | (throttled >> 16 & 0xF) << 8,
    )


def _number(path: Path, base: int) -> int | None:
    try:
        return int(path.read_text(encoding="ascii"), base)
    except (OSError, ValueError):
        return None
