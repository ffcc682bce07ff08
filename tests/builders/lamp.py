"""A photograph of a blinking lamp, counted moment by moment."""

from __future__ import annotations

import numpy as np


def photographed_lamp(frequency_hz: float, depth: float, seed: int = 0) -> np.ndarray:
    """A disc of 150 rows, brighter in the middle, blinking; each row counted over 161.6 µs in steps of 0.04 µs."""
    rng = np.random.default_rng(seed)
    fine = np.arange(4000) / 4000
    shares = [np.mean((0.3 + frequency_hz * 1e-6 * (row * 33.67 + 161.6 * fine)) % 1.0 < 0.5) for row in range(373)]
    weight = 0.5 + depth * (np.convolve(shares, [0.5, 0.5], "same") - 0.5)
    y, x = np.mgrid[:373, :662]
    distance2 = ((x - 330) ** 2 + (y - 190) ** 2) / 75**2
    light = np.where(distance2 < 1, (0.7 - 0.2 * distance2) * weight[:, None], 0.0)
    encoded = 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055
    values = 255 * np.where(light > 0.0031308, encoded, 12.92 * light)
    return np.clip(np.round(values + rng.normal(0, 1, values.shape)), 0, 255).astype(np.uint8)
