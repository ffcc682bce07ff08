"""Facts of the sensors, in one table, each with its source. Nothing here was seen on hardware.

Sources, by file: the Linux drivers `drivers/media/i2c/ov5647.c` and `imx219.c` (raspberrypi/linux), and libcamera's
`src/ipa/rpi/cam_helper/cam_helper_ov5647.cpp` and `cam_helper_imx219.cpp`. All of the 640 × 480 mode, 10 bit.
"""

from __future__ import annotations

from dataclasses import dataclass

MODE = (640, 480)  # both sensors have it; no other is used, as a scaled picture has another row time
BIT_DEPTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFacts:
    """Facts that the camera itself does not tell, or that are needed before it is open."""

    row_clocks: int  # pixel clocks from one row's start to the next's, blanking included
    shortest_frame_rows: int | None  # the driver's least frame, blanking included; None where drivers differ
    exposure_margin_rows: int  # that a frame is longer than its exposure, at least


SENSORS = {
    # hts 1852 (register 0x380c 0x073c), vts 0x1f8, OV5647_VBLANK_MIN 24; frameIntegrationDiff. The pixel rate is the
    # driver's word: 55 MHz, 58.333 MHz in newer ones.
    "ov5647": SensorFacts(row_clocks=1852, shortest_frame_rows=504, exposure_margin_rows=4),
    # IMX219_PPL_DEFAULT; IMX219_VBLANK_MIN is 4 in older drivers and 32 in newer ones, and newer ones double the pixel
    # rate of 182.4 MHz in binned modes, so the row time must be measured.
    "imx219": SensorFacts(row_clocks=3448, shortest_frame_rows=None, exposure_margin_rows=4),
}
