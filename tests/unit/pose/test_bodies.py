"""Bodies: a dock with two panels, 0.4 m apart, seen by a camera; projected by OpenCV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.config.settings import load_config
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import inverse, matrix_from_quaternion
from ledpi.core.records import BodyPose, Floats, MarkerPose
from ledpi.pipeline.output import decoded_as_json
from ledpi.pipeline.pipeline import load_robot
from ledpi.pose.place import Placer
from ledpi.wire import MarkerMessage
from ledpi.wire.outbox import Outbox
from tests.builders.decode import LENS
from tests.builders.map import MOUNT, SIDE_M, detection, frame, optical, panel, pose, seen_corners, with_errors
from tests.builders.wire import decoded

CART = "cart: {20: {position_m: [0, 0, 0], yaw_deg: 0}}"
DOCK = "dock: {7: {position_m: [0, 0.2, 0.1], yaw_deg: 0%s}, 8: {position_m: [0, -0.2, 0.1], yaw_deg: 0%s}}"
EXACT = (", deviations: {position_m: 0, angle_deg: 0}",) * 2
PLACES = {7: panel((0, 0.2, 0.1), 0), 8: panel((0, -0.2, 0.1), 0)}
ROBOT = pose((1.6, 0.3, -0.6), 190.0)  # in the dock's frame, whose x points at it


def bodies_seen(bodies: str, *frames: dict[int, Floats]) -> list[list[BodyPose | str]]:
    """Bodies of each frame, or why there are none."""
    config = load_config(None, (f"panels.side_m={SIDE_M}", f"bodies={{{bodies}}}"))
    placer = Placer(LENS, dict.fromkeys(range(50), SIDE_M), stream=True, robot=load_robot(config))
    found = []
    for seq, corners in enumerate(frames):
        markers = placer.place(frame(seq), [detection(i, c) for i, c in corners.items()])
        seen = placer.bodies(frame(seq), [m for m in markers if isinstance(m, MarkerPose)])
        found.append([body if isinstance(body, BodyPose) else body.key for body in seen])
    return found


def error(body: BodyPose | str) -> Floats:
    """(6,) of camera_from_body, about the camera's axes."""
    assert isinstance(body, BodyPose)
    truth = inverse(ROBOT @ optical(MOUNT))
    turn = matrix_from_quaternion(body.camera_from_body.quaternion_wxyz) @ truth[:3, :3].T
    return np.concatenate([body.camera_from_body.position_m - truth[:3, 3], cv2.Rodrigues(turn)[0][:, 0]])


def test_a_body_is_where_its_panels_are_and_says_how_sure_that_is() -> None:
    """Exact corners give it to 0.1 mm; errors of 100 frames are as its covariance says, in position and rotation.

    It has the second body's number; of the first, the cart, nothing is in view.
    """
    exact = {i: seen_corners(ROBOT, place) for i, place in PLACES.items()}
    rng = np.random.default_rng(1)
    noisy = [{i: with_errors(c, rng) for i, c in exact.items()} for _ in range(100)]
    ((dock,), *others) = bodies_seen(f"{CART}, {DOCK % EXACT}", exact, *noisy)
    assert isinstance(dock, BodyPose)
    assert (dock.name, dock.id, dock.panels_used, dock.panels_rejected) == ("dock", 60001, (7, 8), ())
    np.testing.assert_allclose(error(dock), np.zeros(6), atol=1e-4)
    covariance = dock.camera_from_body.covariance
    assert covariance is not None
    errors = [error(body) for (body,) in others]
    assert np.mean([e @ np.linalg.solve(covariance, e) for e in errors]) == pytest.approx(6, abs=1.0)


def test_a_panel_that_leaves_two_poses_is_no_body_until_the_other_is_seen() -> None:
    """And from then on it goes on from where it was."""
    far = pose((3.0, -0.2, -0.6), 175.0)
    both = {i: seen_corners(far, place) for i, place in PLACES.items()}
    one = {8: both[8]}
    before, during, after = bodies_seen(DOCK % ("", ""), one, both, one)
    assert before == ["body.ambiguous"]
    assert [body.panels_used for body in (*during, *after) if isinstance(body, BodyPose)] == [(7, 8), (8,)]


def test_a_body_goes_out_as_a_marker_and_as_json() -> None:
    """With its own ID, its age, and the deviations of its covariance. Without one the JSON has no such key."""
    ((dock,),) = bodies_seen(DOCK % ("", ""), {i: seen_corners(ROBOT, place) for i, place in PLACES.items()})
    assert isinstance(dock, BodyPose)
    given = replace(decoded(), bodies=(dock,))
    outbox = Outbox(max_age_ms=100.0)
    outbox.put(given)
    first_byte_ns = dock.mid_exposure_ns + 5_000_000
    assert outbox.take(first_byte_ns) is not None  # the status
    sent = outbox.take(first_byte_ns)
    assert isinstance(sent, MarkerMessage)
    assert (sent.id, sent.age_us, sent.ambiguous) == (60000, 5000, False)
    (told,) = decoded_as_json(given, "")["bodies"]
    assert (told["name"], told["id"], told["panels_used"], len(told["covariance"])) == ("dock", 60000, [7, 8], 36)
    assert sent.pose is not None
    assert told["position_m"] == pytest.approx(sent.pose.position_m, abs=1e-6)
    assert "bodies" not in decoded_as_json(decoded(), "")


PLACE = "position_m: [0, 0, 0], yaw_deg: 0"


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        ("{dock: {7: {%s, side_m: 0.2}}}", "bodies.dock.7.side_m: unknown key"),
        ("{dock: {7: {position_m: [0, 0, 0]}}}", "bodies.dock.7: must have either quaternion_wxyz, or where it faces"),
        ("{dock: {}}", "bodies.dock: must hold a panel at least"),
        ("{dock: {7: {%s}}, cart: {7: {%s}}}", "bodies.cart.7: is on dock, too"),
        ("{dock: {7: {%s}, 8: {%s}}}", "bodies.dock.8: is where 7 is"),
        ("{dock: {50: {%s}}}", "bodies.dock.50: DICT_4X4_50 has only the IDs 0 to 49"),
        ("{Dock: {7: {%s}}}", "bodies.Dock: must be a name of small letters"),
        ("{dock: 7}", "bodies.dock: must be a mapping from IDs"),
    ],
)
def test_a_body_that_cannot_be_is_named(bodies: str, said: str) -> None:
    """One line with the key. Back to back two panels may be in one place."""
    back_to_back = f"bodies={{a: {{7: {{{PLACE}}}, 8: {{{PLACE}.1, roll_deg: 180, pitch_deg: 180}}}}}}"
    assert load_config(None, ("panels.side_m=0.16", back_to_back)).bodies["a"].keys() == {7, 8}
    with pytest.raises(ConfigError) as caught:
        load_config(None, ("panels.side_m=0.16", f"bodies={bodies.replace('%s', PLACE)}"))
    assert str(caught.value).startswith(f"configuration: {said}")
    assert "\n" not in str(caught.value)


def test_a_panel_of_a_body_is_not_in_the_map(tmp_path: Path) -> None:
    """A thing that moves has no place in the room."""
    (tmp_path / "markers.yaml").write_text(f"panels: {{8: {{{PLACE}}}}}")
    config = load_config(None, ("panels.side_m=0.16", f"map={tmp_path}/markers.yaml", f"bodies={{{DOCK % ('', '')}}}"))
    with pytest.raises(
        ConfigError, match=r"markers\.yaml: panels\.8: is also in the configuration, as bodies\.dock\.8"
    ):
        load_robot(config)
