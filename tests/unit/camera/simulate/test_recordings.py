"""The simulator against recordings that were rendered by other code: the same geometry."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.reader import load_recording
from ledpi.camera.simulate.optics import project
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Panel, PanelAppearance, Scene, SimulatedSensor
from ledpi.camera.simulate.trajectory import Still
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import matrix_from_quaternion, transform
from ledpi.core.records import Floats, Pixels
from ledpi.core.shutter import linear_light

CORNERS = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) / 2.0  # of a unit panel


@pytest.mark.parametrize("name", ["static/d2", "oblique/d0.6_yaw-70"])
def test_a_pose_means_the_same_pixels_to_both_renderers(name: str, shared: Callable[[str], Path]) -> None:
    """Our projection of their pose gives their corners, and our panel lies on theirs to 0.1 px."""
    recording = load_recording(shared(f"recordings/{name}"))
    camera, spec = recording.camera, recording.panel
    assert camera.intrinsics is not None
    assert recording.truth is not None
    ((marker,), *_) = recording.truth.values()
    assert marker.camera_from_marker is not None
    pose = marker.camera_from_marker
    camera_from_marker = transform(matrix_from_quaternion(pose.quaternion_wxyz), pose.position_m)
    corners = project(CORNERS * spec.side_m, camera_from_marker, camera.intrinsics)
    np.testing.assert_allclose(corners, marker.corners_px, atol=0.02)

    panel = Panel(
        codeword=load_dictionary("DICT_4X4_50").codeword(marker.id),
        spec=spec,
        motion=Still(camera_from_marker),
        marker_id=marker.id,
        appearance=PanelAppearance(bezel=0.0, albedo=0.0),
    )
    values = {key: getattr(camera, key) for key in ("exposure_us", "row_time_us", "frame_length_rows", "transfer")}
    renderer = Renderer(Scene(sensor=SimulatedSensor(intrinsics=camera.intrinsics, **values), panels=(panel,)), seed=1)
    theirs, ours = [], []
    for seq, entry in enumerate(recording.frames):
        if np.array_equal(recording.truth[entry.seq][0].corners_px, marker.corners_px):
            theirs.append(cv2.imread(str(entry.picture), cv2.IMREAD_GRAYSCALE))
            ours.append(np.empty_like(theirs[0]))
            renderer.render(seq, ours[-1])

    def mean_light(pictures: list[Pixels]) -> Floats:
        return np.nan_to_num(linear_light(camera.transfer)[np.stack(pictures)], nan=1.0).mean(axis=0, dtype=np.float64)

    inside = cv2.fillConvexPoly(np.zeros_like(ours[0]), np.round(corners).astype(np.int32), 1)
    inside = cv2.erode(inside, np.ones((5, 5), np.uint8)) > 0
    one, other = mean_light(theirs), mean_light(ours)
    down, across = np.gradient(other)
    terms = np.stack([other, np.ones_like(other), across, down], axis=-1)[inside]  # gain, offset, shift
    gain, _, dx, dy = np.linalg.lstsq(terms, one[inside], rcond=None)[0]
    assert np.hypot(dx, dy) / gain < 0.1
