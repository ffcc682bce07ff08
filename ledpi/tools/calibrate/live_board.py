"""A board before the live camera → enough views of it: says what to do next, and meters on the board."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ledpi.camera.base import Camera
from ledpi.core.records import CameraInfo, Frame, Rejected
from ledpi.tools.calibrate.boards import Board, BoardFinder, BoardView, other_board
from ledpi.tools.calibrate.collecting import Collection, next_exposure

OpenAt = Callable[[tuple[float, float] | None], Camera]  # (exposure µs, gain), or None for the configured ones

MAX_CHANGES = 8  # of the exposure: light that flickers would otherwise keep it changing for ever
BLIND_FRAMES = 15  # without a board, until the exposure is set by the whole picture
NO_BOARD = "show the board to the camera"


def collect_views(
    open_at: OpenAt, board: Board, say: Callable[[str], None], *, metered: bool
) -> tuple[Collection, CameraInfo]:
    """Reads frames until the collection is complete, the camera's frames end, or the user presses Ctrl-C.

    `say` is told what to do whenever that changes. `metered`: the camera is opened anew where the board is too dark or
    too bright. Raises what the camera raises.
    """
    camera = open_at(None)
    collection = Collection(board=board, width=camera.info.width, height=camera.info.height)
    said, blind, changes, other = "", 0, 0, ""
    finder = BoardFinder(board)
    try:
        while (wanted := collection.missing()) is not None:
            text = f"{len(collection.views)} views; {NO_BOARD + other if blind > BLIND_FRAMES else wanted}"
            said = _say_news(text, said, say)
            frame = camera.read(np.empty((collection.height, collection.width), np.uint8))
            if frame is None:
                break
            if isinstance(frame, Rejected):
                continue
            collection.frames += 1
            view = finder.find(f"frame {frame.seq}", frame.pixels)
            if view is not None and collection.board is not finder.board:
                collection.board = finder.board
                say(finder.note(board) or "the board is seen")
            blind = 0 if view is not None else blind + 1
            if blind % BLIND_FRAMES == BLIND_FRAMES - 1:
                other = _seen_instead(frame, board)
            exposure = _other_exposure(frame, view, blind) if metered and changes < MAX_CHANGES else None
            if exposure is not None:
                say(f"exposure {exposure[0]:.0f} µs, gain {exposure[1]:.1f}")
                camera.close()
                camera = open_at(exposure)
                changes += 1
            elif view is not None:
                collection.add(view)
    except KeyboardInterrupt:
        say("ended")
    finally:
        info = camera.info
        camera.close()
    return collection, info


def _say_news(text: str, said: str, say: Callable[[str], None]) -> str:
    """Says what was not said last; what was said last now."""
    if text != said:
        say(text)
    return text


def _seen_instead(frame: Frame, board: Board) -> str:
    """Says what else is in view, for whoever has given another size than the board's."""
    options = other_board(frame.pixels, board)
    return "" if options is None else f"; {options} is seen, not {board.columns} × {board.rows} of a {board.kind}"


def _other_exposure(frame: Frame, view: BoardView | None, blind: int) -> tuple[float, float] | None:
    """A better exposure and gain, by the board, or, where none was seen for a while, by the whole picture."""
    if view is None and blind % BLIND_FRAMES != BLIND_FRAMES - 1:
        return None
    return next_exposure(frame, view)
