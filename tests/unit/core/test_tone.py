"""Picture values and what they mean in light: literal values of IEC 61966-2-1."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Transfer
from ledpi.core.shutter import linear_light

SRGB = {0: 0.0, 1: 0.000303527, 10: 0.003035270, 11: 0.003346536, 55: 0.038204372, 128: 0.215860500, 188: 0.502886458}


def test_linear_values_are_shares_of_full_scale() -> None:
    """A camera without tone curve: the value over 255."""
    table = linear_light("linear")
    assert table.shape == (256,)
    np.testing.assert_allclose(table[[0, 51, 128, 254]], [0.0, 0.2, 128 / 255, 254 / 255], rtol=1e-6)


@pytest.mark.parametrize(("value", "light"), SRGB.items())
def test_srgb_values_are_the_standards(value: int, light: float) -> None:
    """Both branches of the curve, worked out by hand; 10 is the last value on the straight one."""
    assert linear_light("srgb")[value] == pytest.approx(light, rel=1e-5)


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
def test_only_full_scale_is_saturated(transfer: Transfer) -> None:
    """255 may stand for any amount of light, so it is no number; every other value is one, each more than the last."""
    table = linear_light(transfer)
    assert np.isnan(table[255])
    assert (np.diff(table[:255]) > 0).all()


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
def test_where_edges_are_sought_full_scale_is_one(transfer: Transfer) -> None:
    """An edge beside saturated light is still an edge."""
    table = linear_light(transfer, mark_saturated=False)
    assert table[255] == 1.0
    np.testing.assert_array_equal(table[:255], linear_light(transfer)[:255])
