"""How often something flat is seen with the shape that it is seen with."""

from __future__ import annotations

import math

# Radians. Who sees a square from so far beside its front cannot tell how far: it is narrower by half a percent, and the
# sides of one at 5 m, of 20 pixels, are known no better.
LEAST_TILT = 0.1


def log_chance_of_tilt(sides_px: tuple[complex, complex], cells: tuple[int, int]) -> float:
    """Log of how often what has so many `cells`, across and down, is seen with these sides; but for what all share.

    All directions in which it may face the camera are alike, so the cosine c = cos θ of its tilt is as often this as
    that, and the axis any. What is tilted looks shortened by c along one axis; the shapes that this makes have the
    area sinh(ρ) dρ dφ with c = e^−ρ (the half-plane of 2 × 2 matrices but for turns and sizes, in which a change of
    `cells` moves all alike). So a shape is as frequent as c dρ / (sinh(ρ) dρ) = 2c²/(1 − c²) = 2 cot² θ.
    """
    across, down = sides_px[0] / cells[0], sides_px[1] / cells[1]
    doubled_area = 2.0 * abs((across.conjugate() * down).imag)
    cosh = max(1.0, (abs(across) ** 2 + abs(down) ** 2) / max(doubled_area, 1e-9))
    tan2 = (cosh + math.sqrt(cosh * cosh - 1.0)) ** 2 - 1.0  # 1/c² − 1
    return -math.log(max(tan2, LEAST_TILT**2))
