"""What is drawn: one frame, and what was made of it."""

from __future__ import annotations

from dataclasses import dataclass

from ledpi.config import PanelSettings
from ledpi.markers import Bits, load_dictionary
from ledpi.pipeline import Pipeline
from ledpi.records import Decoded, Floats, Frame, Intrinsics, Rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """Something four-sided that was no panel."""

    corners_px: Floats  # (4, 2) as the picture shows it
    why: Rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """One frame and what was made of it."""

    title: str  # ASCII
    frame: Frame
    decoded: Decoded
    dropped: tuple[Dropped, ...]
    panels: PanelSettings
    intrinsics: Intrinsics | None

    def word(self, marker_id: int) -> Bits:
        """The cells of an ID, upright."""
        return load_dictionary(self.panels.dictionary).word(marker_id)


def take(title: str, frame: Frame, pipeline: Pipeline, intrinsics: Intrinsics | None) -> Snapshot:
    """Decodes a frame, and keeps what was dropped on the way."""
    dropped: list[Dropped] = []
    decoded = pipeline.decode(frame, lambda corners, why: dropped.append(Dropped(corners_px=corners, why=why)))
    return Snapshot(
        title=title,
        frame=frame,
        decoded=decoded,
        dropped=tuple(dropped),
        panels=pipeline.panels,
        intrinsics=intrinsics,
    )
