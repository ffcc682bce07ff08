"""Pictures for viewers: asked of the daemon only while somebody waits for one, encoded once for all of a kind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from ledpi.camera.recording.picture import with_text
from ledpi.core.records import Floats, Pixels
from ledpi.daemon.tap.frames import WITH_REASONS, frame_of, not_read_of, why_not_if_told
from ledpi.page.encode import amplified, as_jpeg, as_png, focus, histogram
from ledpi.page.panels import dictionary_of, drawn, drawn_reasons, paint_bands, plain_reasons
from ledpi.pipeline.diagnosis.why_not import WhyNot

Kind = Literal["plain", "bands", "whynot"]
KINDS: tuple[Kind, ...] = get_args(Kind)
PERIOD_S = 1 / 15  # between two pictures, at least
UNANSWERED_S = 2.0  # after which a picture is asked for again
FRESH_S = 0.5  # a picture that is older is not shown to who comes now


@dataclass(slots=True)
class Shown:
    """A picture that has come, with what was made of it so far."""

    number: int
    line: dict[str, Any]  # the daemon's line `picture`, without its pixels
    pixels: Pixels  # (H, W)
    hello: dict[str, Any]
    came_s: float
    has_why: bool
    why_not: WhyNot | None = None  # None where the daemon's panels cannot be looked for here
    _made: dict[str, Any] = field(default_factory=dict)
    _making: threading.Lock = field(default_factory=threading.Lock)

    def as_kind(self, kind: Kind) -> tuple[dict[str, Any], bytes]:
        """Returns what is told beside it, and the JPEG. The first viewer's thread makes it, the others get the same."""
        told = self._once(f"told {kind}", lambda: self._told(kind))
        if kind == "bands":
            jpeg, share = self._once("bands", self._make_bands)
            return told | {"bands_share": share}, jpeg
        return told, bytes(self._once("jpeg", lambda: as_jpeg(self.pixels)))

    def png(self) -> bytes:
        """Makes one of the pixels as they are, with what decodes them: camera, lens and panels."""
        return bytes(self._once("png", self._make_png))

    def _make_png(self) -> bytes:
        told = {key: self.hello.get(key) for key in ("camera", "panels", "method", "camera_mount", "map")}
        exposure_us = self.line["decoded"].get("exposure_us")
        if exposure_us is not None:
            told["camera"] = self.hello["camera"] | {"exposure_us": exposure_us}
        return with_text(as_png(self.pixels), told)

    def _make_bands(self) -> tuple[bytes, float | None]:
        """The bands amplified as JPEG; and what is full scale at the panels, a share of their light."""
        picture, dictionary = amplified(self.pixels, self._period_rows(), self._quads()), dictionary_of(self.hello)
        if dictionary is None:
            return as_jpeg(picture), None
        decoded, cells = self.line["decoded"], dictionary.cells_per_side
        share = paint_bands(picture, self.pixels, decoded, self.hello, cells)
        return as_jpeg(picture), share

    def _told(self, kind: Kind) -> dict[str, Any]:
        decoded, quads = self.line["decoded"], self._quads()
        told = {
            "number": self.number,
            "seq": decoded["seq"],
            "exposed_ns": decoded["exposed_ns"],
            "width": self.line["width"],
            "height": self.line["height"],
            "exposure_us": decoded.get("exposure_us"),
            "analogue_gain": decoded.get("analogue_gain"),
            "panels": drawn(decoded, self.hello),
            "rejected": decoded["rejected"],
            "histogram": histogram(self.pixels),
            "saturated_share": float((self.pixels == 255).mean()),
            "focus": round(focus(self.pixels, quads), 1),
            "focus_of": "panel" if quads else "picture",
        }
        if kind == "whynot":
            told |= self._explained()
        return told

    def _explained(self) -> dict[str, Any]:
        picture = self.line | {"pixels": self.pixels}
        if self.why_not is None:
            return {"why_not": drawn_reasons(plain_reasons(picture)), "notes": []}
        why = self.why_not.explain_at_once(frame_of(self.hello, picture), not_read_of(picture), self._quads())
        return {"why_not": drawn_reasons(why.diagnoses), "notes": [asdict(note) for note in why.notes]}

    def _quads(self) -> list[Floats]:
        return [np.array(marker["corners_px"], np.float64) for marker in self.line["decoded"]["markers"]]

    def _period_rows(self) -> float:
        """Returns that of the slowest wave."""
        panels, camera = self.hello["panels"], self.hello["camera"]
        return float(1e6 / (min(panels["black_hz"], panels["white_hz"]) * camera["row_time_us"]))

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        with self._making:
            if name not in self._made:
                self._made[name] = make()
            return self._made[name]


class Pictures:
    """Hands the newest picture to any number of waiting threads."""

    def __init__(self, ask: Callable[[tuple[str, ...]], bool]) -> None:
        """`ask` requests a picture with these extras; it returns whether a daemon is there, and does not wait."""
        self._ask = ask
        self._changed = threading.Condition()
        self._newest: Shown | None = None
        self._number = time.monotonic_ns() // 1_000_000  # a viewer of an earlier server has seen no such number
        self._asked_s: float | None = None  # of the one that has not come yet
        self._may_ask_s = 0.0
        self._why_wanted_s = 0.0
        self._explained: dict[str, Any] | None = None  # the hello of whose pictures `_why_not` tells
        self._why_not: WhyNot | None = None
        self.came_so_far = 0  # none while nobody watches

    def came(self, line: dict[str, Any], hello: dict[str, Any]) -> None:
        """Takes in a line `picture`, with its `pixels`."""
        pixels = line.pop("pixels")
        with self._changed:
            self._number += 1
            self.came_so_far += 1
            has_why = "rejected" in line
            now_s = time.monotonic()
            if has_why and hello is not self._explained:
                self._explained, self._why_not = hello, why_not_if_told(hello)
            self._newest = Shown(self._number, line, pixels, hello, now_s, has_why, self._why_not)
            self._asked_s = None
            self._changed.notify_all()

    def lost(self) -> None:
        """The daemon is gone: what was asked will not come."""
        with self._changed:
            self._asked_s = None
            self._changed.notify_all()

    def newest(self) -> Shown | None:
        """The last that came, however old."""
        return self._newest

    def wait(self, kind: Kind, after: int, timeout_s: float) -> Shown | None:
        """The newest picture that is not number `after`, as soon as there is one; None when the time is over."""
        until_s = time.monotonic() + timeout_s
        with self._changed:
            while (now_s := time.monotonic()) < until_s:
                if kind == "whynot":
                    self._why_wanted_s = now_s
                if (shown := self._newest) is not None and self._serves(shown, kind, after, now_s):
                    return shown
                self._changed.wait(min(until_s - now_s, self._see_that_one_comes(now_s)))
        return None

    def _serves(self, shown: Shown, kind: Kind, after: int, now_s: float) -> bool:
        return shown.number != after and now_s - shown.came_s < FRESH_S and (shown.has_why or kind != "whynot")

    def _see_that_one_comes(self, now_s: float) -> float:
        """Asks for a picture where none is under way. Returns after how many seconds it is to be seen to again."""
        if self._asked_s is not None and now_s - self._asked_s < UNANSWERED_S:
            return UNANSWERED_S
        if now_s < self._may_ask_s:
            return self._may_ask_s - now_s
        why = now_s - self._why_wanted_s < 1.0
        if not self._ask(WITH_REASONS if why else ()):
            return 0.2
        self._asked_s = now_s
        self._may_ask_s = max(self._may_ask_s + PERIOD_S, now_s + PERIOD_S / 2)
        return UNANSWERED_S
