"""Why each four-sided thing that was dropped is no panel that is read, in words; and what the whole picture lacks.

The reasons of the path say at which stage something was dropped. A person asks what is wrong with the panel. If its
ID was read, the path knows why it is not reported. Else the picture is looked at again, and the first of these that
holds is said: it is a panel of another kind (`what_if`, or its cells by all frames, `mistakes`); it is too bright; the
exposure hides its bands; it is too dim; it is blurred; a part of it is hidden. Else the reason of the path is put in
words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ledpi.camera.factory import vanishing
from ledpi.config.panels import PanelSettings
from ledpi.core.records import Floats, Frame
from ledpi.pipeline.diagnosis.look import FULL, Look, band_step, blur_of, look_at, side_px
from ledpi.pipeline.diagnosis.reasons import SURE_NATS, Mistake, explained, mistake_of
from ledpi.pipeline.diagnosis.what_if import Supposed, same_place
from ledpi.pipeline.trace import Trace, classes_unread

Kind = Literal["panel", "light", "shape"]  # what it surely is, what it may be: most lights and shapes are no panels
_ORDER: tuple[Kind, ...] = ("panel", "light", "shape")

LIT = 1.5  # times the light around it: what is darker is no light
SMALLEST_PX = 12.0  # side of what is told of: smaller things are too many, and as panels they would be 8 m away
MOST_FULL = 0.25  # of a thing's pixels, or of a picture's: with more of them full, a cell has too few that are not
LEAST_STEP = 1.0  # grey levels: bands that change the picture by less are lost as it is rounded
MOST_BLUR_PX = 2.0  # twice what a focused lens leaves
NARROW = 0.8  # of its longer side: a panel that looks so is turned by 37° or more, or a part of it is hidden
NOTHING_NATS, LEAST_SURE, LEAST_HIDDEN = 1.0, 4, 2  # a cell that says less; cells that must, and that must not speak
BRIGHTEST_PERCENT = 99.9  # of a picture's pixels: its brightest parts
# Reasons that come after bands of the configured frequencies were found, as deep as the exposure leaves them: texture
# shows none such.
_BLINKS = (
    *("identify.not_in_dictionary", "identify.ambiguous", "identify.inconsistent_cells"),
    *("track.innovation", "track.contradicted"),
)
_NO_BANDS = ("fit.no_bands", "identify.no_bands", "identify.steady")
_AFTER_FIT = ("cells", "identify", "suppression", "pose", "track")  # stages that only see what looks like a panel


@dataclass(frozen=True, slots=True, kw_only=True)
class NotRead:
    """Something four-sided that was dropped."""

    corners_px: Floats  # (4, 2)
    why: str  # as `identify.no_bands`
    cells_nats: Floats | None = None  # (n, n) log-likelihood ratio of white to black, where cells were looked at
    marker_id: int | None = None  # that was read, and is not reported


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """A thing that is not read: what is wrong with it, and what helps."""

    corners_px: Floats  # (4, 2)
    why: str
    says: str
    helps: str  # "" where nothing is to be done
    kind: Kind
    cells_nats: Floats | None = None
    marker_id: int | None = None  # that was read, and is not reported

    @property
    def line(self) -> str:
        """As in `panel at 400, 238 is not read: looks like ID 11 mirrored`, without what helps."""
        x, y = self.corners_px.mean(axis=0)
        if self.kind == "panel":
            missing = "read" if self.marker_id is None else "reported"
            return f"panel at {x:.0f}, {y:.0f} is not {missing}: {self.says}"
        return f"{self.kind} at {x:.0f}, {y:.0f}, if it is a panel: {self.says}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """Something that the whole picture lacks for panels to be read."""

    says: str
    helps: str


def not_read_in(trace: Trace) -> list[NotRead]:
    """Lists what a frame's path has dropped, with its cells where it came so far."""
    looked_at = {square.quad.corners_px.tobytes(): square for square in trace.squares}
    found = []
    for dropped in trace.dropped:
        square = looked_at.get(dropped.corners_px.tobytes())
        nats = None if square is None else classes_unread(square)
        found.append(
            NotRead(corners_px=dropped.corners_px, why=dropped.why.key, cells_nats=nats, marker_id=dropped.marker_id)
        )
    return found


def diagnose(
    frame: Frame,
    panels: PanelSettings,
    not_read: Iterable[NotRead],
    read_px: Sequence[Floats] = (),
    supposed: Sequence[Supposed] = (),
) -> list[Diagnosis]:
    """Each place once, panels first, the largest of each kind first. What lies at a panel that is read is left out.

    `supposed`: what was read under a guess, in this frame or one just before.
    """
    kept: list[Diagnosis] = []
    taken = list(read_px)
    for one in in_order([_diagnosis(frame, panels, one, supposed) for one in not_read]):
        if not any(same_place(one.corners_px, at) for at in taken):
            kept.append(one)
            taken.append(one.corners_px)
    return kept


def in_order(diagnoses: list[Diagnosis]) -> list[Diagnosis]:
    """Panels first, then lights; the largest of each kind first."""
    return sorted(diagnoses, key=lambda one: (_ORDER.index(one.kind), -side_px(one.corners_px)))


def picture_notes(frame: Frame, panels: PanelSettings) -> list[Note]:
    """Notes what holds for every panel in it: the exposure, the light, the focus."""
    notes = []
    if (null := _null(frame, panels)) is not None:
        notes.append(Note(says=null.says, helps=null.helps))
    brightest = float(np.percentile(frame.pixels, BRIGHTEST_PERCENT))
    full = float(np.mean(frame.pixels == FULL))
    if full > MOST_FULL:
        says = f"the picture is too bright: {100 * full:.0f} % of its pixels are full"
        notes.append(Note(says=says, helps=_LESS_LIGHT))
    elif null is None and band_step(frame, panels.spec(), brightest) < LEAST_STEP:
        says = f"the picture is too dark: its brightest parts are at {brightest:.0f} of {FULL}"
        notes.append(Note(says=says, helps=_MORE_LIGHT))
    elif (blur_px := blur_of(frame.pixels)) > MOST_BLUR_PX:
        notes.append(Note(says=f"the picture is blurred: {_blurred(blur_px)}", helps=_SHARPER))
    return notes


def found_cells(one: NotRead) -> bool:
    """Tells whether the cells of a panel were found there, and no ID."""
    return one.marker_id is None and one.why.startswith("identify.")


def worth_a_guess(frame: Frame, one: NotRead) -> bool:
    """Tells whether it may be a panel of another kind, which takes time to find out."""
    if one.marker_id is not None or side_px(one.corners_px) < SMALLEST_PX:
        return False
    return one.why.partition(".")[0] in _AFTER_FIT or look_at(frame, one.corners_px).brighter >= LIT


_LESS_LIGHT = "less gain (camera.analogue_gain) or a shorter exposure"
_MORE_LIGHT = "more gain (camera.analogue_gain), a longer exposure, or brighter LEDs"
_SHARPER = "focus the lens: turn it until the focus score of ledpi view is highest; hold the camera still"


def _diagnosis(frame: Frame, panels: PanelSettings, one: NotRead, supposed: Sequence[Supposed]) -> Diagnosis:
    if one.marker_id is not None:
        says, helps = _not_reported(one.marker_id, one.why, panels)
        return Diagnosis(
            corners_px=one.corners_px,
            why=one.why,
            says=says,
            helps=helps,
            kind="panel",
            cells_nats=one.cells_nats,
            marker_id=one.marker_id,
        )
    reading = next((s for s in supposed if same_place(one.corners_px, s.corners_px)), None)
    corners_px = one.corners_px if reading is None else reading.corners_px
    mistake = None if reading is None else reading.mistake
    if mistake is None and one.cells_nats is not None:
        mistake = mistake_of(one.cells_nats, panels.words)
    look, is_large = look_at(frame, one.corners_px), side_px(one.corners_px) >= SMALLEST_PX
    kind: Kind = "shape"
    if mistake is not None or (one.why in _BLINKS and is_large):
        kind = "panel"
    elif look.brighter >= LIT and is_large:
        kind = "light"
    if mistake is None and kind != "shape":
        mistake = _symptom(frame, panels, one, look)
    means, helps = mistake or explained(one.why)
    if mistake is None and one.why in _NO_BANDS:
        means = f"nothing there blinks at {panels.spec().blinking()}"
    return Diagnosis(corners_px=corners_px, why=one.why, says=means, helps=helps, kind=kind, cells_nats=one.cells_nats)


def _not_reported(marker_id: int, why: str, panels: PanelSettings) -> Mistake:
    """Says why the path does not report an ID that it has read."""
    if why != "identify.id_not_in_panels_ids":
        means, helps = explained(why)
        return Mistake(f"this is ID {marker_id}, but {means}", helps)
    if panels.ids is not None:
        return Mistake(f"this is ID {marker_id}, which panels.ids does not list", f"add {marker_id} to panels.ids")
    return Mistake(
        f"this is ID {marker_id}, or a part or a reflection of a panel that looks the same",
        f"list all your panels in panels.ids, {marker_id} among them",
    )


def _symptom(frame: Frame, panels: PanelSettings, one: NotRead, look: Look) -> Mistake | None:
    """Says what the picture shows to be wrong with something that may be a panel."""
    if look.full_share > MOST_FULL:
        return Mistake(f"too bright: {100 * look.full_share:.0f} % of its pixels are full", _LESS_LIGHT)
    if (null := _null(frame, panels)) is not None:
        return null
    if (step := band_step(frame, panels.spec(), look.level)) < LEAST_STEP:
        return Mistake(f"too dim: bands change the picture by {step:.1f} grey levels there", _MORE_LIGHT)
    if look.brighter < 1.0:
        return Mistake("too dim: darker than what is around it", _MORE_LIGHT)
    if look.blur_px > MOST_BLUR_PX:
        return Mistake(f"out of focus, or moved: {_blurred(look.blur_px)}", _SHARPER)
    return _hidden(one, look)


def _hidden(one: NotRead, look: Look) -> Mistake | None:
    helps = "remove what is before it"
    if (nats := one.cells_nats) is not None:
        silent = int(np.count_nonzero(np.abs(nats) < NOTHING_NATS))
        if silent >= LEAST_HIDDEN and np.count_nonzero(np.abs(nats) >= SURE_NATS) >= LEAST_SURE:
            says = f"partly hidden: {silent} of its {nats.size} cells show no bands"
            return Mistake(says, f"{helps}; look whether all LEDs are lit")
    if look.narrow < NARROW:
        width, height = np.ptp(one.corners_px, axis=0)
        says = f"partly hidden, or turned far aside: what is seen is {width:.0f} × {height:.0f} pixels"
        return Mistake(says, f"{helps}, or look at it from nearer its front")
    return None


def _null(frame: Frame, panels: PanelSettings) -> Mistake | None:
    weak = vanishing(panels, frame.exposure_us)
    if not weak:
        return None
    named = " and ".join(f"{hz:g} Hz" for hz in weak)
    return Mistake(
        f"the exposure of {frame.exposure_us:.0f} µs is at a null of {named}: such bands all but vanish",
        "exposure × frequency must be near a whole number and a half: ledpi panel design",
    )


def _blurred(blur_px: float) -> str:
    return f"its sharpest edges are {2 * blur_px:.0f} pixels wide"
