"""libcamera's tuning file, changed so that a picture is linear in light. Pure.

The file that comes with libcamera for each sensor, one for the ISP of the Pi up to 4 (`vc4`) and one for the Pi 5's
(`pisp`), has a tone curve, and an `rpi.contrast` that bends it further as it sees fit (`ce_enable`); no control
switches that off. Read from libcamera's sources (`src/ipa/rpi/controller/rpi/contrast.cpp`, `ccm.cpp`), **not seen on
hardware**.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

FULL_SCALE = 65535  # of a tone curve's x and y, in both ISPs
WHITE_LED_K = 5000  # colour temperature that red and blue are balanced for: between warm and cold white LEDs

_STRAIGHT = [0, 0, FULL_SCALE, FULL_SCALE]
_UNMIXED = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def linear_tuning(tuning: Mapping[str, Any]) -> dict[str, Any]:
    """A copy whose tone curve is straight and never adapted, and whose colour matrix does not mix the channels.

    Luma is then a weighted sum of the balanced channels. A matrix for colours would take much of one channel from
    another and so multiply a lamp's tint: one channel would be full long before luma is, and bend the bands unseen.
    Raises ValueError where the file has not the form that is known.
    """
    linear = copy.deepcopy(dict(tuning))
    contrast = _algorithm(linear, "rpi.contrast")
    contrast["gamma_curve"] = list(_STRAIGHT)
    contrast["ce_enable"] = 0
    colour = _algorithm(linear, "rpi.ccm")
    colour.clear()  # of what else it may hold, as a saturation by brightness
    colour["ccms"] = [{"ct": WHITE_LED_K, "ccm": list(_UNMIXED)}]
    return linear


def white_gains(tuning: Mapping[str, Any]) -> tuple[float, float]:
    """(red, blue): what makes a white LED's three channels equal, so that they are full at the same light.

    The file lists, by colour temperature, red over green and blue over green as the sensor sees a white thing.
    Raises ValueError where the file has not the form that is known.
    """
    curve = np.array(_algorithm(tuning, "rpi.awb").get("ct_curve", ()), dtype=np.float64)
    if curve.size < 6 or curve.size % 3:
        raise ValueError("rpi.awb: ct_curve must be triples of temperature, red and blue")
    kelvin, red, blue = curve.reshape(-1, 3).T
    return float(1 / np.interp(WHITE_LED_K, kelvin, red)), float(1 / np.interp(WHITE_LED_K, kelvin, blue))


def _algorithm(tuning: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The parameters of one algorithm. Raises ValueError."""
    if tuning.get("version") != 2.0:
        raise ValueError(f"version is {tuning.get('version')}; must be 2.0")
    for algorithm in tuning["algorithms"]:
        if name in algorithm:
            found: dict[str, Any] = algorithm[name]
            return found
    raise ValueError(f"has no {name}")
