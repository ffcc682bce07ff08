"""Measurements, by what they measure: `accuracy`, `speed` and `endurance`."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
