"""Dictionaries: OpenCV's by name, one's own from a file in OpenCV's form."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.reader import load_recording
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.settings import load_config
from ledpi.core.dictionaries import load_dictionary, opencv_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import PanelSpec
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import PINHOLE, Canvas, camera_info, panel_settings, square

THREE = """%YAML:1.0
---
nmarkers: 2
markersize: 3
maxCorrectionBits: 0
marker_0: "110010001"
marker_1: "011101100"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "words.yaml"
    path.write_text(THREE)
    return path


def test_the_words_of_a_file_by_hand(file: Path) -> None:
    """Row by row from the top left; 1 is white."""
    dictionary = load_dictionary(str(file))
    assert dictionary.cells_per_side == 3
    np.testing.assert_array_equal(dictionary.codeword(0), [[1, 1, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(dictionary.codeword(1), [[0, 1, 1], [1, 0, 1], [1, 0, 0]])


def test_a_file_that_was_changed_is_read_again(file: Path) -> None:
    """As a daemon does that reloads its configuration: panels of the old words would go on being read."""
    assert load_dictionary(str(file)) is load_dictionary(str(file))
    file.write_text(THREE.replace("110010001", "010101100") + "# by hand\n")
    np.testing.assert_array_equal(load_dictionary(str(file)).codeword(0), [[0, 1, 0], [1, 0, 1], [1, 0, 0]])


@pytest.mark.parametrize("ending", ["yml", "json"])
def test_what_opencv_writes_is_read(tmp_path: Path, ending: str) -> None:
    """The first words of a predefined dictionary, written by OpenCV itself."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    few = cv2.aruco.Dictionary(known.bytesList[:7], known.markerSize, known.maxCorrectionBits)
    path = tmp_path / f"few.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    few.writeDictionary(storage)
    storage.release()
    np.testing.assert_array_equal(load_dictionary(str(path)).codewords, load_dictionary("DICT_5X5_50").codewords[:7])


def test_opencv_gets_the_same_words() -> None:
    """Both ways: its own form, and back."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    ours = opencv_dictionary(load_dictionary("DICT_4X4_50"))
    np.testing.assert_array_equal(ours.bytesList, known.bytesList)
    assert (ours.markerSize, ours.maxCorrectionBits) == (known.markerSize, known.maxCorrectionBits)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("%YAML:1.0\n---\n", "[[[{", "must be YAML (first line %YAML:1.0) or JSON"),
        ("nmarkers: 2\n", "", "nmarkers: must be a whole number from 1 to 100000"),
        ("nmarkers: 2", "nmarkers: 0", "nmarkers: must be a whole number from 1 to 100000"),
        ("nmarkers: 2", "nmarkers: 3", "marker_2: must be 9 digits 0 and 1 in quotes"),
        ("markersize: 3", "markersize: 4", "marker_0: must be 16 digits 0 and 1 in quotes"),
        ("markersize: 3", "markersize: 1", "markersize: must be a whole number from 2 to 8"),
        ("110010001", "11001000x", "marker_0: must be 9 digits 0 and 1 in quotes"),
        ("011101100", "110010001", "marker_1: looks like marker_0 when it is turned"),
        ("011101100", "010101010", "marker_1: looks like itself when it is turned"),
    ],
)
def test_a_wrong_file_names_key_and_remedy(file: Path, old: str, new: str, message: str) -> None:
    """As an error of the configuration that names the file."""
    file.write_text(THREE.replace(old, new))
    config = file.with_name("config.yml")
    config.write_text(f"panels: {{side_m: 0.16, dictionary: {file.name}}}\n")
    with pytest.raises(ConfigError) as error:
        load_config(config)
    assert str(error.value).startswith(f"{config}: panels.dictionary: {file}: ")
    assert message in str(error.value)


@pytest.mark.parametrize("text", ['{"a":' + "[" * 100_000, "%YAML:1.0\n---\na:\n  " + "- " * 100_000])
def test_lists_nested_deeply_are_refused(file: Path, text: str) -> None:
    """OpenCV's own reader ends the process there (segmentation fault)."""
    file.write_text(text)
    with pytest.raises(ValueError, match="cannot be read as a dictionary"):
        load_dictionary(str(file))


def test_a_missing_file_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """With what a dictionary is, and nothing that OpenCV has to say."""
    config = tmp_path / "config.yaml"
    config.write_text("panels: {side_m: 0.16, dictionary: none.yaml}\n")
    with pytest.raises(ConfigError, match=r"none\.yaml: no such file; must be a dictionary"):
        load_config(config)
    assert capfd.readouterr() == ("", "")


def test_panels_of_a_dictionary_of_ones_own_are_read(file: Path) -> None:
    """Nine cells; relative to the configuration that names the file."""
    settings = panel_settings(f"panels.dictionary={file}")
    canvas = Canvas()
    canvas.panel(square(310, 240, 110, 5), load_dictionary(str(file)).codeword(1), profile=lambda u, v: np.ones_like(u))
    path = Pipeline(camera_info(), settings, intrinsics=PINHOLE, stream=False)
    assert [marker.detection.id for marker in path.decode(canvas.frame()).markers] == [1]


def test_a_recording_takes_its_dictionary_with_it(file: Path, tmp_path: Path) -> None:
    """The file is copied, so that the recording can be read elsewhere."""
    spec = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
    with RecordingWriter(tmp_path / "take", camera=camera_info(), dictionary=str(file), panel=spec) as writer:
        writer.write(Canvas().frame())
    file.unlink()
    recording = load_recording((tmp_path / "take").rename(tmp_path / "moved"))
    assert recording.dictionary == str(tmp_path / "moved" / "words.yaml")
    np.testing.assert_array_equal(load_dictionary(recording.dictionary).codeword(1)[0], [0, 1, 1])
