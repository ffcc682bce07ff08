"""Dictionary words, and how they look when they are turned: drawn by hand, and read by OpenCV's detector."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ledpi.core.codewords import Bits, Dictionary, corners_of_turned
from ledpi.core.dictionaries import dictionary_names, load_dictionary


def drawn(text: str) -> Bits:
    """A word written as `1100 / 0100 / …`, from the top."""
    return np.array([[c == "1" for c in row.strip()] for row in text.split("/")])


SEVEN = "1100 / 0100 / 1111 / 0010"
SEVEN_TURNED_CLOCKWISE = [
    "0101 / 0111 / 1100 / 0100",
    "0100 / 1111 / 0010 / 0011",
    "0010 / 0011 / 1110 / 1010",
]


def test_id_7_turned() -> None:
    """Quarter turns clockwise: the left column, read upward, becomes the top row."""
    turned = load_dictionary("DICT_4X4_50").rotated_codewords()[7]
    for quarter_turns, text in enumerate([SEVEN, *SEVEN_TURNED_CLOCKWISE]):
        np.testing.assert_array_equal(turned[quarter_turns], drawn(text), err_msg=f"turns: {quarter_turns}")


def test_a_word_of_halves_is_what_half_a_panel_shows() -> None:
    """Rows, or columns, alike two by two but for a cell: of five and of seven cells none can be."""
    halves = drawn("1001 / 1001 / 0110 / 0110")
    one_off, two_off = halves.copy(), halves.copy()
    one_off[3, 0] = True
    two_off[3, :2] = (True, False)
    far = drawn("1010 / 0101 / 1010 / 0100")
    words = Dictionary(name="words", codewords=np.stack([halves.T, one_off, two_off, far]))
    assert words.correctable_cells() == 0
    assert words.part_like_ids() == (0,)
    assert load_dictionary("DICT_4X4_50").part_like_ids() == (3, 17, 22, 30, 33, 37)
    assert load_dictionary("DICT_5X5_50").part_like_ids() == load_dictionary("DICT_7X7_50").part_like_ids() == ()


def test_words_that_a_mirror_shows() -> None:
    """Counts both of two that are each other's mirror images, however the second is turned; and one that is its own."""
    one = drawn("1101 / 0010 / 1010 / 0100")
    other = np.rot90(drawn("1011 / 0100 / 0101 / 0010"))
    own = drawn("1001 / 0110 / 0110 / 0000")
    alone = drawn("1000 / 1100 / 0010 / 0000")
    words = Dictionary(name="words", codewords=np.stack([one, other, own, alone]))
    assert words.reflection_like_ids() == (0, 1, 2)
    assert Dictionary(name="some", codewords=np.stack([one, alone])).reflection_like_ids() == ()
    assert load_dictionary("DICT_4X4_50").reflection_like_ids() == (8, 9, 17, 47)
    assert {70, 124} <= set(load_dictionary("DICT_4X4_250").reflection_like_ids())
    assert load_dictionary("DICT_6X6_50").reflection_like_ids() == ()


def test_a_mirror_image_may_be_off_by_what_can_be_corrected() -> None:
    """By a cell, where all words differ in three; where two differ in two only, none can be corrected."""
    one = drawn("0111 / 0000 / 0001 / 0101")
    off, near = drawn("0110 / 0000 / 1000 / 1010"), drawn("0110 / 0000 / 1001 / 1011")
    pair = Dictionary(name="pair", codewords=np.stack([one, off]))
    three = Dictionary(name="three", codewords=np.stack([one, off, near]))
    assert (pair.correctable_cells() >= 1, pair.reflection_like_ids()) == (True, (0, 1))
    assert (three.correctable_cells(), three.reflection_like_ids()) == (0, ())


def test_in_antiphase_a_mirror_also_shows_the_negative() -> None:
    """A word and its negative are one pattern, half a cycle apart."""
    one = drawn("0111 / 0000 / 0001 / 0101")
    words = Dictionary(name="words", codewords=np.stack([one, drawn("0001 / 1111 / 0111 / 0101")]))
    assert words.reflection_like_ids() == ()
    assert words.reflection_like_ids("antiphase") == (0, 1)


def test_corners_of_a_turned_panel_by_hand() -> None:
    """After one quarter turn clockwise the marker's top left corner is at the picture's top right."""
    quad = np.array([[10.0, 20], [30, 20], [30, 40], [10, 40]])  # clockwise from the top left
    np.testing.assert_array_equal(corners_of_turned(quad, 0), quad)
    np.testing.assert_array_equal(corners_of_turned(quad, 1), [[30, 20], [30, 40], [10, 40], [10, 20]])
    np.testing.assert_array_equal(corners_of_turned(quad, 3), [[10, 40], [10, 20], [30, 20], [30, 40]])


@pytest.mark.parametrize("quarter_turns", range(4))
def test_turning_is_opencvs(quarter_turns: int) -> None:
    """In a turned picture of a printed marker OpenCV finds the same ID, and the corners in the same order."""
    raw = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    picture = np.full((160, 160), 255, np.uint8)
    picture[20:140, 20:140] = cv2.aruco.generateImageMarker(raw, 7, 120)
    picture = np.ascontiguousarray(np.rot90(picture, -quarter_turns))
    corners, ids, _ = cv2.aruco.ArucoDetector(raw).detectMarkers(picture)
    cells = picture[40:120, 40:120].reshape(4, 20, 4, 20).mean(axis=(1, 3)) > 127
    as_seen = np.array([[20.0, 20], [139, 20], [139, 139], [20, 139]])

    assert ids.ravel().tolist() == [7]
    np.testing.assert_array_equal(load_dictionary("DICT_4X4_50").rotated_codewords()[7, quarter_turns], cells)
    np.testing.assert_allclose(corners_of_turned(as_seen, quarter_turns), corners[0][0], rtol=0, atol=1)


def test_every_name_loads() -> None:
    """Each name that is offered has so many words of so many cells; AprilTag's families are not among them."""
    names = dictionary_names()
    assert "DICT_4X4_50" in names
    assert not any("APRILTAG" in name or "ORIGINAL" in name for name in names)
    for name in names:
        side, ids = int(name[5]), int(name.rpartition("_")[2])
        dictionary = load_dictionary(name)
        assert (dictionary.codewords.shape, dictionary.cells_per_side) == ((ids, side, side), side)


def test_an_unknown_dictionary_names_the_known() -> None:
    """A wrong name is told together with those that there are."""
    with pytest.raises(ValueError, match=r"unknown dictionary 'DICT_9X9'; known: .*DICT_4X4_50"):
        load_dictionary("DICT_9X9")


@pytest.mark.parametrize("marker_id", [-1, 50])
def test_an_unknown_id_names_the_range(marker_id: int) -> None:
    """An ID that the dictionary has not is an error, also where Python would count from the end."""
    with pytest.raises(ValueError, match=f"IDs 0 to 49, not {marker_id}"):
        load_dictionary("DICT_4X4_50").codeword(marker_id)


def test_distances_in_antiphase_by_hand() -> None:
    """Takes 2 × 2 cells: 1110 is one cell from the negative of 0000, and two from each of its own other turns."""
    small = Dictionary(name="small", codewords=np.array([[[1, 1], [1, 0]], [[0, 0], [0, 0]]], bool))
    assert small.distances("free")[0].tolist() == [4, 2, 2, 2, 3, 3, 3, 3]
    assert small.distances("antiphase")[0].tolist() == [4, 2, 2, 2, 1, 1, 1, 1]


def test_7_and_the_negative_of_2_differ_in_two_cells() -> None:
    """Written down: 1100/0100/1111/0010 is shown by 7, and by 2 half a cycle later but for its second row."""
    dictionary = load_dictionary("DICT_4X4_50")
    np.testing.assert_array_equal(~dictionary.codeword(2), drawn("1100 / 1100 / 1101 / 0010"))
    assert dictionary.distances("antiphase")[7, 4 * 2] == 2
    assert (dictionary.correctable_cells(), dictionary.correctable_cells("antiphase")) == (1, 0)


def test_a_word_that_is_anothers_negative_cannot_be_used_in_antiphase() -> None:
    """38 and, turned, 69 of DICT_4X4_100; the others can, and are named."""
    dictionary = load_dictionary("DICT_4X4_100")
    assert set(range(100)) - set(dictionary.readable_ids("antiphase")) == {38, 69}
    assert len(dictionary.readable_ids()) == 100
    with pytest.raises(ValueError, match=r"ID 38 is the negative .* one of 0 to 37, 39 to 68, 70 to 99"):
        dictionary.check_readable(38, "antiphase")
    dictionary.check_readable(38, "free")


def test_a_word_that_is_its_own_negative_turned_cannot_be_used_in_antiphase() -> None:
    """Half white, half black: turned by 180° it is its negative, so how it hangs could not be told."""
    half = Dictionary(name="half", codewords=np.array([[[1, 1], [0, 0]], [[1, 1], [1, 0]]], bool))
    assert half.readable_ids("antiphase") == (1,)
