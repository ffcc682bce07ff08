"""config.yaml: what is accepted, and the one line that each kind of mistake gives."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from ledpi.config.settings import NO_CONFIGURATION, Config, find_config, load_config
from ledpi.core.errors import ConfigError
from tests.builders import ROOT
from tests.builders.config import known_keys, written_values

SHIPPED = ROOT / "config.yaml"


def write(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def message(path: Path | None, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    return str(caught.value)


def test_shipped_file_has_every_key() -> None:
    """The shipped config.yaml shows every key that there is, and no other."""
    shipped = yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))
    assert written_values(shipped).keys() == known_keys(Config)


def test_shipped_file_has_the_defaults() -> None:
    """The shipped config.yaml says what holds without it."""
    assert load_config(SHIPPED).model_dump() == load_config(None, ("panels.side_m=0.16",)).model_dump()


def test_a_size_is_all_that_must_be_given(tmp_path: Path) -> None:
    """A file with panels.side_m alone gives the documented defaults."""
    config = load_config(write(tmp_path, "panels: {side_m: 0.2}"))
    assert (config.panels.side_m, config.panels.black_hz, config.panels.white_hz) == (0.2, 1250, 2450)
    assert (config.camera.exposure_us, config.camera.source) == (10000, "picamera2")
    assert (config.serial.baud, config.serial.max_age_ms) == (115200, 100)


def test_a_section_may_be_empty(tmp_path: Path) -> None:
    """`camera:` with every key under it commented out keeps the defaults."""
    assert load_config(write(tmp_path, "camera:\npanels:\n  side_m: 0.2\n")).camera.width == 640


def test_a_key_given_twice(tmp_path: Path) -> None:
    """YAML would take the last of two exposures in silence: here it is a mistake, with its line."""
    file = write(tmp_path, "panels: {side_m: 0.2}\ncamera:\n  exposure_us: 5000\n  exposure_us: 9000\n")
    with pytest.raises(ConfigError, match="line 4: exposure_us is there twice"):
        load_config(file)


def test_a_dash_on_the_command_line_is_text() -> None:
    """YAML would read a list of nothing."""
    assert load_config(None, ("panels.side_m=0.16", "serial.port=-")).serial.port == "-"


MISTAKES = [
    ("camera.sorce=x", "camera.sorce: unknown key; did you mean source? allowed here: analogue_gain,"),
    ("camra.source=x", "camra: unknown key; did you mean camera? allowed here: bodies, camera, decode, map"),
    ("odometry.base_m=0", "odometry.base_m: must be greater than or equal to 0.01, not 0"),
    ("odometry.source=serial", "odometry.source: serial needs serial.port; without a controller: tap or none"),
    ("7=3", "7: unknown key; allowed here: bodies, camera"),
    ("camera=3", "camera: must be a section with the keys analogue_gain, exposure_us, frame_duration_us"),
    ("camera.source=webcam", "source: must be picamera2, picamera2:N, simulated, recording:PATH or v4l2:/dev/video"),
    ("camera.frame_duration_us=abc", "camera.frame_duration_us: must be a number or auto, not 'abc'"),
    ("camera.row_time_us=0", "camera.row_time_us: must be greater than or equal to 1 or auto, not 0"),
    ("camera.analogue_gain=0.5", "camera.analogue_gain: must be greater than or equal to 1 or auto, not 0.5"),
    ("camera.exposure_us=long", "camera.exposure_us: must be a number, not 'long'"),
    ("camera.exposure_us=.inf", "camera.exposure_us: must be a finite number, not inf"),
    ("camera.width=640.5", "camera.width: must be a whole number, not 640.5"),
    ("camera.transfer=gamma", "camera.transfer: must be 'auto', 'linear' or 'srgb', not 'gamma'"),
    ("camera.intrinsics=3", "camera.intrinsics: must be a path, not 3"),
    ("panels.side_m=", "panels.side_m: must be a number, not null"),
    ("panels.side_m=0", "panels.side_m: must be greater than or equal to 0.001, not 0"),
    ("panels.side_m=160", "panels.side_m: must be in metres, 10 at most (160 mm are 0.16), not 160"),
    ("panels.side_m=yes", "panels.side_m: takes no true or false"),
    ("panels.upright=1", "panels.upright: must be true or false, not 1"),
    ("panels.dictionary=DICT_4x4_50", "panels.dictionary: did you mean DICT_4X4_50? must be one of DICT_4X4_100, "),
    ("panels.white_hz=1250", "panels: black_hz and white_hz must differ, both are 1250"),
    ("panels.overrides=3", "panels.overrides: must be a mapping from IDs, as in {7: {side_m: 0.3}}, not 3"),
    ("panels.overrides={x: {side_m: 1}}", "panels.overrides.x: must be a whole number, not 'x'"),
    ("panels.overrides={7: {sidem: 1}}", "panels.overrides.7.sidem: unknown key; did you mean side_m?"),
    ("panels.overrides={50: {side_m: 1}}", "panels.overrides.50: DICT_4X4_50 has only the IDs 0 to 49"),
    ("panels.overrides={7: {black_hz: 2450}}", "panels.overrides.7: black_hz and white_hz must differ"),
    ("robot.camera_mount.rpy_deg=[1, 2]", "robot.camera_mount.rpy_deg: must be three numbers, as in"),
    ("robot.camera_mount.position_m=[0, 0, 1200]", "robot.camera_mount.position_m.2: must be less than or equal to 10"),
    ("panels.overrides={99999999: {}}", "panels.overrides.99999999: must be less than or equal to 65535"),
    ("panels.ids=5", "panels.ids: must be a list, as in [7, 23], not 5"),
    ("panels.ids=[]", "panels.ids: must not be empty, not []"),
    ("panels.ids=[7, 1, 07]", "panels.ids: must list each ID once, and lists 7 twice, not [7, 1, 7]"),
    ("panels.overrides={7: {measured: soon}}", "panels.overrides.7.measured: must be a date, as in 2026-11-25, not"),
    ("serial.port=''", "serial.port: must not be empty, not ''"),
    (
        "serial.port=udpout:10.0.0.2:14550",
        "serial.port: must be a serial port's path; to an address poses go by outputs",
    ),
    ("serial.baud=3", "serial.baud: must be greater than or equal to 1200, not 3"),
    ("decode.method=magic", "decode.method: must be "),
]


@pytest.mark.parametrize(("override", "expected"), MISTAKES, ids=[override for override, _ in MISTAKES])
def test_a_mistake_is_one_line(override: str, expected: str) -> None:
    """Each kind of mistake gives one line with the file, the key, and what is right, and counts once."""
    text = message(SHIPPED, override)
    assert text.startswith(f"{SHIPPED}: ")
    assert expected in text
    assert "\n" not in text
    assert " more: `" not in text
    assert "pydantic" not in text
    assert "Settings" not in text


def test_further_mistakes_are_counted() -> None:
    """The first mistake is told in full, the others are counted once each, with the command that lists them."""
    text = message(SHIPPED, "camera.frame_duration_us=abc", "camera.row_time_us=x", "serial.baud=3")
    assert text.endswith(f"(and 2 more: `ledpi config check --config {SHIPPED}` lists them)")


def test_missing_size_names_the_key(tmp_path: Path) -> None:
    """Without panels.side_m that very key is named, whether or not there is a panels section."""
    for text in ("{}", "panels: {}", "panels:"):
        assert message(write(tmp_path, text)).endswith("panels.side_m: must be given (it has no default)")


def test_without_any_configuration_it_is_reported_where_one_is_sought() -> None:
    """Rather than which key is missing from none."""
    assert message(None) == NO_CONFIGURATION


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("map", 'map: "a\\0b"'),
        ("camera.intrinsics", 'camera: {intrinsics: "a\\0b"}'),
        ("camera.source", 'camera: {source: "recording:a\\0b"}'),
        ("serial.port", 'serial: {port: "a\\0b"}'),
    ],
)
def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path, key: str, text: str) -> None:
    """The operating system would refuse it only later, and without the key."""
    said = message(write(tmp_path, f"panels: {{side_m: 0.16}}\n{text}\n"))
    assert f"config.yaml: {key}: must hold no null character" in said


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"camera: [1", "not valid YAML"),
        (b"panels: \xff", "byte 8 is not UTF-8 text"),
        (b"- 1\n- 2\n", "must be sections (camera:, panels:,"),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, content: bytes, expected: str) -> None:
    """A file that is not a configuration at all gives one line with its name."""
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    text = message(path)
    assert text.startswith(f"{path}: ")
    assert expected in text
    assert "\n" not in text


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    """A file that is not there gives one line with its name."""
    path = tmp_path / "no.yaml"
    assert message(path) == f"{path}: cannot be read: No such file or directory"


@pytest.mark.parametrize("override", ["camera", "=3", "camera.source={"])
def test_a_malformed_override_is_named(override: str) -> None:
    """--set without key, without value, or with half a YAML value is an error that repeats it."""
    assert message(SHIPPED, override).startswith(f"--set {override}: ")


def test_an_override_whose_key_is_no_text_is_refused() -> None:
    """As bytes on the command line that are not UTF-8."""
    assert message(SHIPPED, "\udcff=3").startswith(r"--set \udcff=3: must be KEY=VALUE")


def test_override_wins_over_the_file(tmp_path: Path) -> None:
    """--set replaces the file's value and leaves its neighbours."""
    path = write(tmp_path, "panels: {side_m: 0.2, black_hz: 1000}")
    config = load_config(path, ("panels.side_m=0.3", "camera.frame_duration_us=20000"))
    assert (config.panels.side_m, config.panels.black_hz) == (0.3, 1000)
    assert config.camera.frame_duration_us == 20000


def test_override_of_one_panel_joins_the_file(tmp_path: Path) -> None:
    """--set panels.overrides.7.side_m means the same ID 7 as the file's."""
    path = write(tmp_path, "panels: {side_m: 0.2, overrides: {7: {black_hz: 1262}}}")
    spec = load_config(path, ("panels.overrides.7.side_m=0.3",)).panels.spec(7)
    assert (spec.side_m, spec.black_hz, spec.white_hz) == (0.3, 1262, 2450)


def test_ids_that_a_part_or_a_reflection_of_a_panel_can_show_must_be_listed() -> None:
    """The others exist unless panels.ids says which ones do."""
    given = ("panels.side_m=0.16",)
    unsaid, said = (load_config(None, (*given, *ids)).panels for ids in ((), ("panels.ids=[3, 7]",)))
    assert set(range(50)) - unsaid.existing_ids() == {3, 8, 9, 17, 22, 30, 33, 37, 47}
    assert said.existing_ids() == {3, 7}
    note = "ID 3 is reported only if panels.ids lists it: a part or a reflection of a panel can look the same"
    assert unsaid.unreported_note([3, 7, 50]) == note
    assert said.unreported_note([3, 7, 8]) == "ID 8 is reported only if panels.ids lists it"
    assert said.unreported_note([3, 7]) == ""


def test_listed_ids_that_a_mirror_can_show_are_named() -> None:
    """Word 9 is its own mirror image; 70 and 124 of the larger dictionary are each other's, which 70 alone is not."""
    for dictionary, ids, named in (
        ("DICT_4X4_50", "[7, 9]", "9"),
        ("DICT_4X4_250", "[7, 70, 124]", "70, 124"),
        ("DICT_4X4_250", "[7, 70]", ""),
        ("DICT_4X4_50", "null", ""),
    ):
        given = ("panels.side_m=0.16", f"panels.dictionary={dictionary}", f"panels.ids={ids}")
        note = load_config(None, given).panels.reflection_note()
        said = f"a mirror, window or glossy floor can show {named} where there is no such panel"
        assert note == (said if named else "")


def test_a_dictionary_of_mirror_images_needs_its_ids_listed(tmp_path: Path) -> None:
    """Else no ID would be reported, of whatever panel; one line says so."""
    text = "nmarkers: 2\nmarkersize: 4\nmarker_0: '1101001010100100'\nmarker_1: '1011010001010010'\n"
    (tmp_path / "words.yml").write_text(text)
    config = write(tmp_path, f"panels: {{side_m: 0.2, dictionary: {tmp_path}/words.yml}}")
    with pytest.raises(ConfigError) as caught:
        load_config(config)
    assert str(caught.value) == (
        f"{config}: panels.ids: a part or a reflection of a panel can show each ID of {tmp_path}/words.yml, so none "
        "would be reported; panels.ids must list the panels that exist"
    )
    assert load_config(config, ("panels.ids=[0, 1]",)).panels.existing_ids() == {0, 1}


def test_paths_in_the_file_are_relative_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths in a file are meant from where the file is, wherever the command is started."""
    (tmp_path / "robot").mkdir()
    camera = "{source: 'recording:r', intrinsics: c.yaml}"
    write(tmp_path / "robot", f"{{camera: {camera}, map: m.yaml, panels: {{side_m: 1}}}}")
    monkeypatch.chdir(tmp_path)
    config = load_config(Path("robot/config.yaml"))
    assert config.camera.source == f"recording:{tmp_path}/robot/r"
    assert config.camera.intrinsics == tmp_path / "robot/c.yaml"
    assert config.map == tmp_path / "robot/m.yaml"


def test_paths_on_the_command_line_are_relative_to_the_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths given with --set are meant from the working directory; / and ~ are what they always are."""
    (tmp_path / "robot").mkdir()
    path = write(tmp_path / "robot", "panels: {side_m: 1}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/pi")
    overrides = ("camera.source=recording:r", "camera.intrinsics=~/c.yaml", "map=/m.yaml")
    config = load_config(path, overrides)
    assert config.camera.source == f"recording:{tmp_path}/r"
    assert (config.camera.intrinsics, config.map) == (Path("/home/pi/c.yaml"), Path("/m.yaml"))


def test_lookup_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """--config is taken as it is; without it ./config.yaml, if it is there."""
    monkeypatch.chdir(tmp_path)
    assert find_config(Path("given.yaml")) == Path("given.yaml")
    write(tmp_path, "panels: {side_m: 1}")
    assert find_config(None) == Path("config.yaml")


@pytest.mark.parametrize("value", ["2001-99-99", "!!timestamp x"])
def test_a_date_that_is_none_is_reported_in_one_line(tmp_path: Path, value: str) -> None:
    """PyYAML raises what is no YAMLError there; the file is named all the same, and so is the override."""
    file = tmp_path / "config.yaml"
    file.write_text(f"panels: {{side_m: {value}}}\n")
    with pytest.raises(ConfigError, match=r"config\.yaml: not valid YAML"):
        load_config(file)
    with pytest.raises(ConfigError, match="is not a YAML value"):
        load_config(None, (f"panels.side_m={value}",))


def test_an_override_of_a_thousand_brackets_is_reported_in_one_line() -> None:
    """PyYAML goes as deep as Python lets it, and no further."""
    with pytest.raises(ConfigError, match="is not a YAML value"):
        load_config(None, (f"panels.side_m={'[' * 5000}",))


def test_an_override_of_an_id_of_a_thousand_digits_is_reported_in_one_line() -> None:
    """Python makes no number of so many."""
    assert "maximum size" in message(SHIPPED, f"panels.overrides.{'1' * 5000}.side_m=0.2")


def test_antiphase_is_one_frequency_for_both_classes(tmp_path: Path) -> None:
    """The panel has one wave then."""
    text = "panels: {side_m: 0.2, phase: antiphase, black_hz: 1253.33, white_hz: 1253.33}"
    panels = load_config(write(tmp_path, text)).panels
    assert panels.spec().waves_hz == (1253.33,)
    assert panels.frequencies_hz() == (1253.33,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("panels: {side_m: 0.2, phase: antiphase}", "black_hz and white_hz must be equal, not 1250 and 2450"),
        ("panels: {side_m: 0.2, black_hz: 1300, white_hz: 1300}", "must differ, both are 1300.*phase: antiphase"),
        ("panels: {side_m: 0.2, phase: antiphase, white_hz: 1250, duty: 0.4}", "needs a duty of 0.5, not 0.4"),
        ("panels: {side_m: 0.2, phase: opposite}", "panels.phase: must be 'free' or 'antiphase'"),
        (
            "panels: {side_m: 0.2, phase: antiphase, white_hz: 1250, overrides: {7: {black_hz: 1251}}}",
            "panels.overrides.7: .*must be equal, not 1251 and 1250",
        ),
        (
            "panels: {side_m: 1, dictionary: DICT_4X4_100, phase: antiphase, white_hz: 1250, overrides: {38: {}}}",
            "panels.overrides.38: DICT_4X4_100: ID 38 is the negative .* must be one of 0 to 37, 39 to 68",
        ),
        (
            "{panels: {side_m: 0.2, phase: antiphase, white_hz: 1250}, decode: {method: bands}}",
            "decode.method: uemura .* must be likelihood",
        ),
    ],
)
def test_what_is_no_antiphase_panel_is_refused(tmp_path: Path, text: str, message: str) -> None:
    """In one line, with what would be right."""
    with pytest.raises(ConfigError, match=message):
        load_config(write(tmp_path, text))


def test_a_dictionary_of_which_antiphase_tells_no_id_is_refused(tmp_path: Path) -> None:
    """A word and its negative: in antiphase they are one pattern."""
    words = 'marker_0: "1000"\nmarker_1: "0111"\n'
    (tmp_path / "two.yml").write_text(f"%YAML:1.0\n---\nnmarkers: 2\nmarkersize: 2\n{words}")
    text = "panels: {side_m: 0.2, dictionary: two.yml, phase: antiphase, white_hz: 1250}"
    with pytest.raises(ConfigError, match=r"panels: no ID of .*two.yml .* in antiphase; panels.phase must be free"):
        load_config(write(tmp_path, text))


def test_one_panel_may_be_in_antiphase(tmp_path: Path) -> None:
    """Among others of two frequencies."""
    override = "{9: {phase: antiphase, black_hz: 1653, white_hz: 1653}}"
    panels = load_config(write(tmp_path, f"panels: {{side_m: 0.2, overrides: {override}}}")).panels
    assert panels.spec(9).waves_hz == (1653.0,)
    assert panels.frequencies_hz() == (1250.0, 1653.0, 2450.0)


OLD = [("soft", "likelihood"), ("bands", "uemura")]


@pytest.mark.parametrize(("old", "new"), OLD)
def test_an_old_name_in_a_file_is_read_and_noted(
    old: str, new: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, with the file, the key and today's name."""
    file = tmp_path / "config.yaml"
    file.write_text(f"panels: {{side_m: 0.16}}\ndecode: {{method: {old}}}\n")
    assert load_config(file).decode.method == new
    assert capsys.readouterr().err == f"ledpi: {file}: decode.method: {old} is now called {new}\n"
