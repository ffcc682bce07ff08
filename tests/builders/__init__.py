"""Parts of tests and evaluation: painted and rendered frames, real processes, emulated microcontrollers."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 180.0  # for anything at all: a test that needs as long hangs, on the slowest machine too
