"""Plates and walls for machines: what another program reads of them, true to scale."""

from __future__ import annotations

import io
import struct
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from ledpi.workshop.panel.body import back_dxf, front_dxf, walls_dxf, walls_stl
from tests.unit.workshop.panel.test_sheet import body


def read(dxf: str) -> tuple[list[np.ndarray], list[Any]]:
    """Outlines (n, 2) and circles, by ezdxf, which finds no fault in the file."""
    import ezdxf  # here, as it takes as long as a fifth of all else that tests import

    document = ezdxf.read(io.StringIO(dxf))
    assert not document.audit().errors
    assert document.header["$INSUNITS"] == 4  # millimetres
    space = document.modelspace()
    outlines = list(space.query("POLYLINE"))
    assert all(line.is_closed for line in outlines)
    assert len(space) == len(outlines) + len(space.query("CIRCLE"))
    corners = [np.array([tuple(vertex.dxf.location) for vertex in line.vertices])[:, :2] for line in outlines]
    return corners, list(space.query("CIRCLE"))


def test_the_front_is_a_frame_and_the_back_has_a_hole_for_each_led() -> None:
    """180 mm outside, 160 mm inside; 48 holes of 5 mm, the marker's first cell at the upper right, seen from behind."""
    outlines, circles = read(front_dxf(body()))
    assert [np.ptp(line, axis=0).tolist() for line in outlines] == [[180, 180], [160, 160]]
    assert np.allclose([line.mean(axis=0) for line in outlines], 0)
    assert circles == []
    outlines, circles = read(back_dxf(body()))
    assert [np.ptp(line, axis=0).tolist() for line in outlines] == [[180, 180]]
    assert [circle.dxf.radius for circle in circles] == [2.5] * 48
    first = np.mean([tuple(circle.dxf.center) for circle in circles[:3]], axis=0)
    assert first[:2] == pytest.approx([60, 60], abs=1e-3)


def test_the_walls_fit_into_each_other() -> None:
    """Six with three slots of 2.2 mm to half their height, 40 mm apart, half of them upside down; four outer ones."""
    outlines, _ = read(walls_dxf(body()))
    sizes = [tuple(np.round(np.ptp(line, axis=0), 3).tolist()) for line in outlines]
    assert sizes == [(160, 19)] * 8 + [(164, 19)] * 2
    for number, line in enumerate(outlines[:6]):
        inner = line[np.isclose(line[:, 1] - line[:, 1].min(), 9.5)]
        left, right = np.sort(inner[:, 0])[0::2], np.sort(inner[:, 0])[1::2]
        assert right - left == pytest.approx([2.2] * 3)
        assert (left + right) / 2 == pytest.approx([40, 80, 120])
        opens_above = np.count_nonzero(np.isclose(line[:, 1], line[:, 1].max())) > 2
        assert opens_above == (number < 3)
    rows = sorted((line[:, 1].min(), line[:, 1].max()) for line in outlines)
    assert all(above - below >= 5 for (_, below), (above, _) in pairwise(rows))  # none lies on another


def facets(stl: bytes) -> np.ndarray:
    """(n, 4, 3) normal and corners of each triangle."""
    (count,) = struct.unpack("<I", stl[80:84])
    assert len(stl) == 84 + 50 * count
    return np.array([struct.unpack_from("<12f", stl, 84 + 50 * n) for n in range(count)]).reshape(-1, 4, 3)


@pytest.mark.parametrize("side_mm", [80.0, 400.0])
def test_the_printed_walls_are_one_solid(side_mm: float) -> None:
    """Each edge of a triangle is another's, the other way; its volume is the walls', 16 cells left out."""
    of = body(side_mm)
    triangles = facets(walls_stl(of))
    edges = Counter(
        (tuple(corners[a]), tuple(corners[b])) for _, *corners in triangles for a, b in ((0, 1), (1, 2), (2, 0))
    )
    assert all(count == edges[(end, start)] for (start, end), count in edges.items())
    normals = np.cross(triangles[:, 2] - triangles[:, 1], triangles[:, 3] - triangles[:, 1])
    assert np.allclose(normals / np.linalg.norm(normals, axis=1)[:, None], triangles[:, 0], atol=1e-5)
    volume = np.einsum("ni,ni->", triangles[:, 1], np.cross(triangles[:, 2], triangles[:, 3])) / 6
    outer = side_mm + 2 * of.wall_mm
    cells = np.array([of.pitch_mm - of.wall_mm, *[of.pitch_mm - of.wall_mm] * 2, of.pitch_mm - of.wall_mm])
    cells[[0, -1]] += of.wall_mm / 2  # a cell at the side has half a wall less
    assert volume == pytest.approx(of.depth_mm * (outer**2 - cells.sum() ** 2), rel=1e-4)
    assert np.ptp(triangles[:, 1:].reshape(-1, 3), axis=0) == pytest.approx([outer, outer, of.depth_mm])
