"""Reasons for a rejection in words, for people: what each means, and what helps if the thing is a panel.

The table in docs/troubleshooting.md says the same; a test compares them.
"""

from __future__ import annotations

from typing import NamedTuple


class Explained(NamedTuple):
    """A reason in words."""

    means: str
    helps: str  # "" where nothing is to be done


REASONS: dict[str, Explained] = {
    "find.not_four_sided": Explained("an outline without four sides", ""),
    "find.at_picture_border": Explained(
        "an outline that the border of the picture cuts", "bring the whole panel into view"
    ),
    "find.too_small": Explained("an outline too small for a panel", "go nearer"),
    "fit.too_small": Explained("a cell would be less than 2 pixels wide", "go nearer"),
    "fit.no_light": Explained("next to no light, or too little of it in the picture", "more exposure or gain"),
    "fit.diverged": Explained("the fit found no corners", ""),
    "fit.no_bands": Explained(
        "no bands, where this exposure would show them clearly",
        "as for identify.no_bands: check the frequencies and the exposure",
    ),
    "fit.misfit": Explained(
        "the model of a panel explains too little of the light", "remove what hides the panel or shines on it"
    ),
    "fit.uncertain": Explained(
        "corners are known to no better than an eighth of a cell", "go nearer; a dark edge around the cells"
    ),
    "track.contradicted": Explained("the frame contradicts the ID of this track; its earlier frames are forgotten", ""),
    "track.no_time": Explained(
        "the frame's time was over before this panel's turn came; the next frame begins with it",
        "fewer panels in view, a faster processor",
    ),
    "track.same_place": Explained("what fits better is in the same place, or it was found before", ""),
    "track.innovation": Explained(
        "the frame fails the innovation gate: it differs too much from the frames before; the panel must be read again",
        "",
    ),
    "cells.too_small": Explained("a cell is less than 2 pixels wide", "go nearer"),
    "cells.outside_picture": Explained("a cell is not wholly in the picture", "bring the whole panel into view"),
    "cells.saturated": Explained("too many pixels of a cell are full", "less gain or exposure"),
    "cells.dark": Explained("a cell gives no light", "check the solder joints"),
    "identify.unfit": Explained(
        "the light of the cells gives no evidence (no solution, or too many pixels are full)", "less gain or exposure"
    ),
    "identify.no_bands": Explained(
        "nothing blinks at the configured frequencies",
        "check the frequencies; keep the exposure off their nulls (ledpi calibrate panel says so); "
        "no capacitor after the MOSFETs",
    ),
    "identify.steady": Explained(
        "it surely does not blink: bands of half the expected depth had shown by now", "as for identify.no_bands"
    ),
    "identify.implausible_depth": Explained(
        "bands are deeper or shallower than this exposure makes them",
        "check camera.exposure_us, and what dims the lamp",
    ),
    "identify.not_in_dictionary": Explained(
        "the pattern is no codeword of the dictionary, or cannot be distinguished from such a pattern",
        "go nearer; more frames; or a cell is on the wrong output, or soldered as seen from the front: compare the "
        "cells with the wiring picture; for pictures that were turned by 180°, camera.rows_from",
    ),
    "identify.ambiguous": Explained("two IDs are nearly as likely", "go nearer; more frames"),
    "identify.inconsistent_cells": Explained(
        "some cells contradict the codeword", "remove what hides cells or shines on them"
    ),
    "identify.id_not_in_panels_ids": Explained("read, but not one of the panels that exist", "list it in panels.ids"),
    "suppression.same_id": Explained(
        "one ID in several places; none is reported", "give each panel an ID of its own; a glossy floor may mirror one"
    ),
    "suppression.same_panel": Explained("two squares for one panel; the better one is kept", ""),
    "pose.unsolved": Explained("no pose in front of the camera fits the corners", "calibrate the lens"),
    "pose.not_square": Explained(
        "no pose of a square explains the corners: they are off by 4 % of the side or more",
        "calibrate the lens; check that the grid is square, and that nothing bright touches it",
    ),
    "fix.not_in_map": Explained("no panel in view is in the map", "add it to the map"),
    "fix.ambiguous": Explained(
        "one panel is seen, and its mirror pose is not excluded", "show two panels; panels.upright: true"
    ),
    "fix.panels_contradict": Explained("panels contradict the map", "correct the map"),
    "state.not_started": Explained(
        "no panel that leaves no choice has been seen yet, or nothing for so long that the robot may be anywhere",
        "show a panel of the map, from nearer or from aside",
    ),
    "state.not_in_map": Explained("the state was shown a panel that is not in the map", "add it to the map"),
    "state.no_pose": Explained("a panel without a pose or its covariance", "calibrate the lens"),
    "state.too_old": Explained("it arrived more than 2 s late", "check the controller's clock"),
    "state.in_future": Explained("its time is after it arrived", "check the controller's clock"),
    "state.no_number": Explained("a total of the odometry is not finite", "check the controller"),
    "state.odometry_leap": Explained(
        "totals differ by more than wheels can do (10 m/s, 20 rad/s): they begin anew",
        "set the flag restarted where they do",
    ),
    "uemura.no_square": Explained("with decode.method: uemura only: no square", "use likelihood"),
    "uemura.cell_without_bands": Explained(
        "with decode.method: uemura only: a cell shows no bands", "use likelihood, or a shorter exposure"
    ),
    "uemura.not_in_dictionary": Explained("with decode.method: uemura only: no codeword", "use likelihood"),
    "capture.timestamp": Explained("a frame has no time, or one that is not after the last", ""),
    "capture.exposure": Explained("the camera did not expose as asked", "set what the camera can do"),
    "capture.repeated": Explained(
        "the camera gave the very same picture again, with a new time; no pose is made of it",
        "its driver hangs: unplug it, or restart the machine",
    ),
    "capture.unreadable": Explained("a picture of a recording cannot be read (or truncated, or of the wrong_size)", ""),
    "camera.lost": Explained("the camera stalls, fails or is unplugged; it is opened again", "check the cable"),
}


def explained(key: str) -> Explained:
    """A key like `find.too_small` in words; of one that this version does not know, the key itself."""
    stage, _, reason = key.partition(".")
    return REASONS.get(key) or Explained(f"{stage}: {reason.replace('_', ' ')}", "")
