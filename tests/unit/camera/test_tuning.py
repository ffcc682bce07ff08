"""libcamera's tuning files, changed to a linear tone. (The whole files: tests/system/virtual/test_tuning_files.py.)"""

from __future__ import annotations

import copy

import pytest

from ledpi.camera.tuning import linear_tuning, white_gains

# From libcamera's src/ipa/rpi/vc4/data/ov5647.json, cut short: the first points of each curve.
EXCERPT = {
    "version": 2.0,
    "target": "bcm2835",
    "algorithms": [
        {"rpi.black_level": {"black_level": 1024}},
        {"rpi.awb": {"ct_curve": [4540.0, 0.7331, 0.7533, 5699.0, 0.6715, 0.8627], "sensitivity_r": 1.05}},
        {"rpi.contrast": {"ce_enable": 1, "gamma_curve": [0, 0, 1024, 5040, 2048, 9338, 65535, 65535]}},
        {"rpi.ccm": {"ccms": [{"ct": 4700, "ccm": [2.0, -0.5, -0.5, -0.5, 2.0, -0.5, -0.1, -0.7, 1.8]}]}},
    ],
}


def test_tone_and_colours_are_straight_and_nothing_else_is_changed() -> None:
    """A straight line over all 16 bits, no adaptation, no mixing of channels; black level and file stay."""
    before = copy.deepcopy(EXCERPT)
    linear = linear_tuning(EXCERPT)
    assert before == EXCERPT
    assert linear["algorithms"][2] == {"rpi.contrast": {"ce_enable": 0, "gamma_curve": [0, 0, 65535, 65535]}}
    assert linear["algorithms"][3]["rpi.ccm"]["ccms"][0]["ccm"] == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert linear["algorithms"][:2] == EXCERPT["algorithms"][:2]  # type: ignore[index]
    assert (linear["version"], linear["target"]) == (2.0, "bcm2835")


def test_white_is_balanced_at_5000_kelvin() -> None:
    """By hand, 460/1159 of the way from 4540 K to 5699 K: red 0.70865 and blue 0.79672 of green."""
    red, blue = white_gains(EXCERPT)
    assert red == pytest.approx(1 / 0.70865, rel=1e-4)
    assert blue == pytest.approx(1 / 0.79672, rel=1e-4)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ({"version": 1.0}, r"version is 1.0; must be 2.0"),
        ({"algorithms": EXCERPT["algorithms"][:2]}, r"has no rpi.contrast"),  # type: ignore[index]
    ],
)
def test_another_form_is_refused(broken: dict[str, object], message: str) -> None:
    """Nothing is guessed: a file of another version, or without the tone curve, cannot be made linear."""
    with pytest.raises(ValueError, match=message):
        linear_tuning(EXCERPT | broken)
