"""Bags: what others read in ours, what we read in others', and that a recording survives both ways."""

from __future__ import annotations

import filecmp
import json
import os
import random
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard

pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")

from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapFileWriter
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ledpi.camera.recording.reader import load_recording
from ledpi.core.errors import RecordingError
from ledpi.core.records import Decoded, Frame
from ledpi.links.bags.bag_writer import BagWriter
from ledpi.links.bags.contents import Compressed, Image, Info, checked, lens_of_info, luma_of_compressed, luma_of_image
from ledpi.links.bags.reading import messages
from tests.builders import ROOT
from tests.builders.command import LEDPI, Run, in_process, ledpi
from tests.builders.waiting import limit_s, wait_until
from tests.unit.links.bags.conftest import FRAMES, OFFSET_NS

OWN_ROW_TIME = ("--set", "camera.row_time_us=33.67", "--set", "camera.exposure_us=9966.32")


@pytest.fixture(scope="module")
def bag(take: Path) -> Path:
    out = take.parent / "take.mcap"
    done = ledpi("export", take, out)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def wanted(take: Path) -> dict[int, dict[str, Any]]:
    """Returns what `ledpi decode` says, by sensor time."""
    lines = map(json.loads, ledpi("decode", take).stdout.splitlines())
    return {line["sensor_timestamp_ns"]: line for line in lines}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    return in_process(monkeypatch, capsys)


def decoded(path: Path, topic: str | None = None) -> list[Any]:
    """Every message, or a topic's, by mcap-ros2-support."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [each.decoded_message for each in reader.iter_decoded_messages(topics=topic)]


def exposed_ns(line: dict[str, Any], row: float) -> int:
    """Unix time of a row's mid-exposure, by the shutter's equation."""
    return int(line["sensor_timestamp_ns"]) + round(row * 33670 - 9966.32e3 / 2) + OFFSET_NS


# ---- What others read in ours


@pytest.mark.slow
def test_mcap_ros2_support_finds_every_pose(bag: Path, wanted: dict[int, dict[str, Any]]) -> None:
    """Another author's CDR: poses and covariances as `ledpi decode` gives them, at the panel's own time."""
    found = decoded(bag, "/ledpi/panel_7")
    lines = [line for line in wanted.values() if line["markers"] and line["markers"][0]["alternate"] is None]
    assert len(found) == len(lines) > 3
    for message, line in zip(found, lines, strict=True):
        (marker,) = line["markers"]
        position, turned = message.pose.pose.position, message.pose.pose.orientation
        np.testing.assert_allclose([position.x, position.y, position.z], marker["position_m"], atol=1e-9)
        np.testing.assert_allclose([turned.w, turned.x, turned.y, turned.z], marker["quaternion_wxyz"], atol=1e-9)
        np.testing.assert_allclose(list(message.pose.covariance), marker["covariance"], rtol=1e-9)
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        row = np.mean(marker["corners_px"], axis=0)[1]
        assert abs(stamp_ns - exposed_ns(line, row)) < 200_000  # of the diagonals' crossing, six rows at most
        assert message.header.frame_id == "camera_optical_frame"


def test_mcap_reads_every_message_and_its_index(bag: Path) -> None:
    """Each topic has its schema; each frame its picture, its lens and its detections."""
    with bag.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = {summary.channels[key].topic: n for key, n in summary.statistics.channel_message_counts.items()}
    everywhere = ("/camera/image_raw/compressed", "/camera/camera_info", "/ledpi/detections", "/ledpi/decoded")
    assert {topic: counts[topic] for topic in everywhere} == dict.fromkeys(everywhere, FRAMES)
    assert len(decoded(bag)) == sum(counts.values())


def test_a_frame_is_decoded_when_its_read_out_ends_on_either_clock(take: Path, tmp_path: Path) -> None:
    """As a bag has no other time of it: 240.5 rows and half an exposure after the picture's middle was exposed."""
    recording, bag = load_recording(take), tmp_path / "bag.mcap"
    times: dict[str, Any] = {"seq": 0, "row0_readout_ns": 10**9, "host_offset_ns": 10**12}  # a camera on another clock
    own: dict[str, Any] = {"exposure_us": 9966.32, "row_time_us": 33.67, "transfer": "srgb"}
    frame = Frame(pixels=np.zeros((480, 640), np.uint8), **own, **times)
    with BagWriter(bag, camera=recording.camera, dictionary="DICT_4X4_50", panel=recording.panel) as writer:
        writer.write(frame)
        writer.write_live(frame, Decoded(markers=(), robot=None, rejected=(), stage_ms={}, **times))
    (message,) = decoded(bag, "/ledpi/decoded")
    told = json.loads(message.data)
    assert told["decoded_ns"] == 10**9 + 10**12 + 480 * 33670
    assert told["decoded_ns"] - told["exposed_ns"] == pytest.approx(240.5 * 33670 + 9966.32e3 / 2, abs=1000)


def test_rosbags_reads_pictures_lens_and_transforms(bag: Path, take: Path, tmp_path: Path) -> None:
    """As a ROS 2 bag's folder, which its tool makes of a file; the pictures are the recording's, to the bit."""
    with AnyReader([bag]) as reader:
        got: dict[str, list[Any]] = {}
        for connection, _, data in reader.messages():
            got.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    first = cv2.imdecode(got["/camera/image_raw/compressed"][0].data, cv2.IMREAD_UNCHANGED)
    entry = load_recording(take).frames[0]
    np.testing.assert_array_equal(first, cv2.imread(str(entry.picture), cv2.IMREAD_UNCHANGED))
    lens = load_recording(take).camera.intrinsics
    assert lens is not None
    np.testing.assert_allclose(got["/camera/camera_info"][0].k, lens.matrix().ravel())
    transform = got["/tf"][-1].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("camera_optical_frame", "panel_7")
    assert got["/ledpi/detections"][-1].detections[0].results[0].hypothesis.class_id == "7"


# ---- And back


@pytest.mark.slow
def test_a_recording_comes_back_as_it_was(bag: Path, take: Path, tmp_path: Path) -> None:
    """Every file of it, to the byte."""
    done = ledpi("import", bag, tmp_path / "back")
    assert (done.returncode, done.stderr) == (0, "")
    names = [str(path.relative_to(take)) for path in take.rglob("*") if path.is_file()]
    assert len(names) == FRAMES + 3
    assert filecmp.cmpfiles(take, tmp_path / "back", names, shallow=False) == (names, [], [])


# ---- What we read in others'


STORE = get_typestore(Stores.ROS2_HUMBLE)
KINDS = STORE.types
Sent = tuple[str, Any]  # a type of ROS, and a message of it


def header(stamp_ns: int) -> Any:
    return KINDS["std_msgs/msg/Header"](KINDS["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "cam")


def grey(pixels: Any, *, encoding: str = "mono8", stamp_ns: int = 0, height: int | None = None) -> Sent:
    """An Image of rosbags."""
    size = (pixels.shape[0] if height is None else height, pixels.shape[1])
    kind = "sensor_msgs/msg/Image"
    return kind, KINDS[kind](header(stamp_ns), *size, encoding, 0, pixels.shape[1], pixels.ravel())


def compressed(pixels: Any, suffix: str = ".png", stamp_ns: int = 0) -> Sent:
    """A CompressedImage."""
    kind = "sensor_msgs/msg/CompressedImage"
    return kind, KINDS[kind](header(stamp_ns), suffix[1:], cv2.imencode(suffix, pixels)[1].ravel())


def bag_of(folder: Path, sent: Iterable[tuple[str, Sent]], plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """By rosbags, of these messages, each with its topic."""
    connections: dict[str, Any] = {}
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        for number, (topic, (kind, message)) in enumerate(sent, 1):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], number, STORE.serialize_cdr(message, kind))
    return folder


def odd_bag(folder: Path, *sent: Sent, plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """These messages on one topic."""
    return bag_of(folder, (("/cam/image", each) for each in sent), plugin)


def foreign_bag(folder: Path, take: Path, *, encoding: str = "mono8", topics: int = 1) -> Path:
    """Uncompressed pictures and a lens, as cameras' drivers publish them."""
    recording = load_recording(take)
    lens, told = recording.camera.intrinsics, "sensor_msgs/msg/CameraInfo"
    assert lens is not None

    def sent() -> Iterator[tuple[str, Sent]]:
        for entry in recording.frames:
            picture = cv2.imread(str(entry.picture), cv2.IMREAD_UNCHANGED)
            assert picture is not None
            time_ns = entry.row0_readout_ns + 10**18
            region = KINDS["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            matrices = (lens.matrix().ravel(), np.eye(3).ravel(), np.zeros(12))
            values = (header(time_ns), *picture.shape[:2], "plumb_bob", np.array(lens.distortion), *matrices)
            yield "/cam0/camera_info", (told, KINDS[told](*values, 0, 0, region))
            for number in range(topics):
                yield f"/cam{number}/image_raw", grey(picture, encoding=encoding, stamp_ns=time_ns)

    return bag_of(folder, sent())


@pytest.mark.slow
def test_a_bag_of_a_mono_camera_becomes_a_recording(take: Path, tmp_path: Path) -> None:
    """With its lens; row time and exposure are given. It decodes as the same pictures did."""
    bag = foreign_bag(tmp_path / "foreign", take)
    done = ledpi("import", bag, tmp_path / "back", *OWN_ROW_TIME)
    assert (done.returncode, done.stderr) == (0, "")
    lines = [json.loads(line) for line in ledpi("decode", tmp_path / "back").stdout.splitlines()]
    before = [json.loads(line) for line in ledpi("decode", take).stdout.splitlines()]
    assert [[marker["corners_px"] for marker in line["markers"]] for line in lines] == [
        [marker["corners_px"] for marker in line["markers"]] for line in before
    ]
    assert lines[-1]["markers"][0]["position_m"] is not None
    assert yaml.safe_load((tmp_path / "back/recording.yaml").read_text())["wall_clock_offset_ns"] == 0


def refused(run: Run, *arguments: object) -> str:
    """One line, and status 2."""
    status, _, errors = run("import", *arguments)
    assert status == 2
    (line,) = errors.splitlines()
    return line


@pytest.mark.slow
def test_what_a_bag_cannot_give_is_one_line(take: Path, tmp_path: Path, run: Run) -> None:
    """A mosaic of colours, several cameras, no row time, no such topic, no bag at all."""
    mosaic = foreign_bag(tmp_path / "mosaic", take, encoding="bayer_rggb8")
    two = foreign_bag(tmp_path / "two", take, topics=2)
    out, second = tmp_path / "out", ("--topic", "/cam1/image_raw")
    assert "/cam0/image_raw: is bayer_rggb8; must be mono8, mono16, bgr8" in refused(run, mosaic, out, *OWN_ROW_TIME)
    several = refused(run, two, tmp_path / "other", *OWN_ROW_TIME)
    assert "several topics; --topic /cam0/image_raw or /cam1/image_raw" in several
    assert "does not say its row time: add --set camera.row_time_us=33.67" in refused(run, two, out, *second)
    assert "has no pictures on /x" in refused(run, two, out, "--topic", "/x")
    assert "no such file or folder" in refused(run, tmp_path / "none.mcap", out)
    (tmp_path / "text.mcap").write_text("no bag\n" * 100, encoding="utf-8")
    assert "is no MCAP file" in refused(run, tmp_path / "text.mcap", out)
    assert "is no bag that can be read" in refused(run, ROOT / "README.md", out)


PLAIN = np.full((48, 64), 90, np.uint8)
LATER = 10**9
ODD: dict[str, tuple[list[Sent], str]] = {
    "nothing": ([], "is empty: it holds no message"),
    "no encoding": ([grey(PLAIN, encoding="")], "/cam/image: is of no encoding; must be mono8"),
    "unknown encoding": ([grey(PLAIN, encoding="x\ny")], r"/cam/image: is x\ny; must be mono8"),
    "16 bits": ([grey(PLAIN, encoding="mono16")], "holds a picture whose size is not as it says"),
    "no pixels": ([grey(np.zeros((0, 0), np.uint8))], "holds a broken message: width: must be greater than or equal"),
    "a large PNG": ([compressed(np.zeros((4, 5001), np.uint8))], "holds a picture of more than 5000 pixels a side"),
    "too few pixels": ([grey(PLAIN, height=49)], "holds a picture whose size is not as it says"),
    "other sizes": (
        [compressed(PLAIN), compressed(PLAIN[:, :32], stamp_ns=LATER)],
        "of several sizes; must be 64 × 48",
    ),
    "time back": ([grey(PLAIN, stamp_ns=LATER), grey(PLAIN)], "/cam/image: header stamps must increase"),
    "no stamps": ([grey(PLAIN), grey(PLAIN)], "and 0 ns follows 0 ns: bag the topic of a driver that stamps"),
}


@pytest.mark.parametrize("what", ODD)
def test_what_a_bag_must_not_hold_is_the_last_line(what: str, tmp_path: Path, run: Run) -> None:
    """And status 2: a person has to act. A line before it may say that there is no lens."""
    sent, said = ODD[what]
    status, _, errors = run("import", odd_bag(tmp_path / "bag", *sent), tmp_path / "out", *OWN_ROW_TIME)
    *before, last = errors.splitlines()
    assert status == 2
    assert said in last
    assert all("has no camera info" in line for line in before)


TALL = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)
LUMA = (TALL % 251).astype(np.uint8)
CODED = {
    "mono16": (TALL * 21).view(np.uint8),
    "bgr8": np.repeat(LUMA, 3, axis=1),
    "yuv422_yuy2": np.dstack([LUMA, LUMA // 2]).reshape(48, 128),
    "yuv422": np.dstack([LUMA // 2, LUMA]).reshape(48, 128),
    "nv21": np.vstack([LUMA, LUMA[:24] // 2]),
}


@pytest.mark.parametrize("encoding", CODED)
def test_of_colours_the_luma_is_taken(encoding: str) -> None:
    """As ROS's camera drivers code them; of 16 bits the upper eight."""
    kind, message = grey(CODED[encoding], encoding=encoding, height=48)
    message.width = 64
    wanted = ((TALL * 21) >> 8).astype(np.uint8) if encoding == "mono16" else LUMA
    np.testing.assert_array_equal(luma_of_image(checked(Image, message, kind), kind), wanted)


def info_of(**values: Any) -> Info:
    """As a driver tells it of the whole sensor: 640 × 480, its centre in the middle."""
    whole = {"width": 640, "height": 480, "k": [500.0, 0, 319.5, 0, 500, 239.5, 0, 0, 1], "d": [], "binning_x": 0}
    return Info.model_validate(whole | {"distortion_model": "plumb_bob"} | values)


def test_a_lens_is_of_the_picture_or_refused() -> None:
    """A region has its own centre, binned pixels are larger; pictures of another size are of another mode."""
    region = {"x_offset": 160, "y_offset": 120, "width": 320, "height": 240}
    cut = lens_of_info(info_of(roi=region), 320, 240, "x")
    binned = lens_of_info(info_of(binning_x=2, binning_y=2), 320, 240, "x")
    assert cut is not None
    assert binned is not None
    assert (cut.fx, cut.cx, cut.cy) == (500, 159.5, 119.5)
    assert (binned.fx, binned.cx, binned.cy) == (250, 159.5, 119.5)
    with pytest.raises(RecordingError, match="is of 640 × 480 pixels in steps of 1 × 1, but the picture has 320 × 240"):
        lens_of_info(info_of(), 320, 240, "x")


def test_a_damaged_picture_leaves_no_words_of_a_library(capfd: pytest.CaptureFixture[str]) -> None:
    """libpng prints its own, beside ledpi's one line."""
    png = bytearray(cv2.imencode(".png", PLAIN)[1].tobytes())
    png[20] ^= 1  # its width, so that a checksum is wrong
    header = {"stamp": {"sec": 1, "nanosec": 0}}
    picture = Compressed.model_validate({"header": header, "format": "png", "data": np.frombuffer(png, np.uint8)})
    with pytest.raises(RecordingError, match="holds a picture that cannot be decoded"):
        luma_of_compressed(picture, "x")
    assert capfd.readouterr().err == ""


def packed(path: Path, data: bytes, *, says: int, by: str = "zstd") -> Path:
    """An MCAP file of one chunk, which says how long it is unpacked."""
    body = zstandard.compress(data) if by == "zstd" else lz4.frame.compress(data)
    text = struct.pack("<I", len(by)) + by.encode()
    chunk = struct.pack("<QQQI", 0, 0, says, 0) + text + struct.pack("<Q", len(body)) + body
    head = b"\x01" + struct.pack("<QII", 8, 0, 0)
    path.write_bytes(b"\x89MCAP0\r\n" + head + b"\x06" + struct.pack("<Q", len(chunk)) + chunk)
    return path


# The most that it ever had, in kB: what the kernel tells of an ended child counts the tests that forked it, too.
TELLING_MEMORY = """
import re; from pathlib import Path; from ledpi.__main__ import main
try:
    main()
finally:
    print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
"""


@pytest.mark.slow
def test_bombs_take_no_memory(tmp_path: Path) -> None:
    """One line each: more than it says, a million empty records, an array of 300 million elements."""
    zeros = bytes(3 * 10**8)
    schema = struct.pack("<H", 1) + b"".join(
        struct.pack("<I", len(part)) + part for part in (b"sensor_msgs/msg/Image", b"ros2msg", b"string[300000000] a")
    )
    channel = struct.pack("<HH", 1, 1) + b"".join(struct.pack("<I", len(x)) + x for x in (b"/a", b"cdr", b""))
    message = struct.pack("<HIQQ", 1, 0, 0, 0) + b"\0\1\0\0"
    records = b"".join(
        bytes([code]) + struct.pack("<Q", len(part)) + part for code, part in ((3, schema), (4, channel), (5, message))
    )
    array = packed(tmp_path / "array.mcap", records, says=len(records))
    empty = packed(tmp_path / "empty.mcap", (b"\x09" + bytes(8)) * 1_000_000, says=9_000_000)
    bombs = [packed(tmp_path / f"{by}.mcap", zeros, says=1000, by=by) for by in ("zstd", "lz4")]
    del zeros
    for bag in (*bombs, empty, array):
        command = [sys.executable, "-c", TELLING_MEMORY, "import", str(bag), str(tmp_path / "out"), *OWN_ROW_TIME]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), (bag, done.stderr)
        assert int(done.stdout) < 400_000, bag


def test_a_bag_in_rosbag2s_older_form_is_read(tmp_path: Path, run: Run) -> None:
    """SQLite; and one that is cut off is a line."""
    sent = [grey(PLAIN, stamp_ns=LATER * k) for k in range(9)]
    bag = odd_bag(tmp_path / "bag", *sent, plugin=StoragePlugin.SQLITE3)
    assert run("import", bag, tmp_path / "out", *OWN_ROW_TIME)[:2] == (0, f"{tmp_path}/out: 9 frames\n")
    (database,) = bag.glob("*.db3")
    database.write_bytes(database.read_bytes()[: database.stat().st_size // 2])
    assert "is no bag that can be read" in refused(run, bag, tmp_path / "cut", *OWN_ROW_TIME)


def test_a_bag_of_ros_1_is_read(tmp_path: Path, run: Run) -> None:
    """One that is cut off needs its own tool, which is named."""
    store, bag = get_typestore(Stores.ROS1_NOETIC), tmp_path / "one.bag"
    kinds, kind = store.types, "sensor_msgs/msg/Image"
    with Ros1Writer(bag) as writer:
        connection = writer.add_connection("/cam/image", kind, typestore=store)
        for number in range(9):
            header = kinds["std_msgs/msg/Header"](number, kinds["builtin_interfaces/msg/Time"](number, 0), "cam")
            message = kinds[kind](header, 48, 64, "mono8", 0, 64, PLAIN.ravel())
            writer.write(connection, number + 1, store.serialize_ros1(message, kind))
    assert run("import", bag, tmp_path / "out", *OWN_ROW_TIME)[:2] == (0, f"{tmp_path}/out: 9 frames\n")
    bag.write_bytes(bag.read_bytes()[:20_000])
    assert "`rosbag reindex` makes the index anew" in refused(run, bag, tmp_path / "cut", *OWN_ROW_TIME)


def test_a_bag_whose_checksum_is_wrong_is_read_up_to_there(bag: Path, tmp_path: Path, run: Run) -> None:
    """A byte that has changed in a picture would else be believed."""
    data, changed = bytearray(bag.read_bytes()), tmp_path / "changed.mcap"
    data[len(data) // 2] ^= 0xFF
    changed.write_bytes(data)
    status, _, errors = run("import", changed, tmp_path / "out")
    said = "is damaged (a checksum is wrong); what stands before that is read: copy the bag once more"
    assert (status, errors) == (0, f"{changed}: {said}\n")
    assert 0 < len(load_recording(tmp_path / "out").frames) < FRAMES


@pytest.mark.slow
def test_a_video_that_is_cut_off_or_none_is_one_line(tmp_path: Path, run: Run) -> None:
    """FFmpeg's and OpenCV's own words are not shown; a video of a single frame is one."""
    clip = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"mp4v"), 50.0, (64, 48))
    writer.write(cv2.merge([PLAIN] * 3))
    writer.release()
    done = ledpi("import", clip, tmp_path / "out", *OWN_ROW_TIME)
    assert (done.returncode, done.stdout) == (0, f"{tmp_path}/out: 1 frame\n")
    clip.write_bytes(clip.read_bytes()[:500])
    done = ledpi("import", clip, tmp_path / "cut", *OWN_ROW_TIME)
    said = "cannot be read as a video; is it whole? One that was cut off has no index"
    assert (done.returncode, done.stderr) == (2, f"ledpi: {clip}: {said}\n")
    (avi := tmp_path / "clip.avi").write_bytes(b"RIFF" + bytes(4) + b"AVI LIST" + bytes(4) + b"drla" + bytes(200))
    assert ledpi("import", avi, tmp_path / "cut", *OWN_ROW_TIME).stderr == f"ledpi: {avi}: {said}\n"
    (tmp_path / "empty.mcap").touch()
    assert refused(run, tmp_path / "empty.mcap", tmp_path / "x").endswith("is no MCAP file (it ends at once)")


@pytest.mark.slow
def test_a_video_becomes_a_recording(take: Path, tmp_path: Path) -> None:
    """Its pictures in grey, at the video's own times."""
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (640, 480))
    for entry in load_recording(take).frames:
        picture = cv2.imread(str(entry.picture))
        assert picture is not None
        writer.write(picture)
    writer.release()
    done = ledpi("import", clip, tmp_path / "back", *OWN_ROW_TIME)
    assert done.returncode == 0, done.stderr
    times_ns = [entry.row0_readout_ns for entry in load_recording(tmp_path / "back").frames]
    assert len(times_ns) == FRAMES
    np.testing.assert_allclose(np.diff(times_ns), 20e6, atol=1e3)


def test_a_bag_that_is_cut_off_anywhere_is_read_up_to_there(bag: Path, tmp_path: Path) -> None:
    """Within a number, too; and where a power failure has left zeros in the place of its end."""
    data, short = bag.read_bytes(), tmp_path / "short.mcap"
    whole = sum(1 for _ in messages(bag, print))
    for size in random.Random(7).sample(range(len(data) // 2, len(data)), 60):
        for end in (b"", bytes(100_000)):
            short.write_bytes(data[:size] + end)
            said: list[str] = []
            assert whole / 4 < sum(1 for _ in messages(short, said.append)) <= whole
            damaged = "is damaged (a checksum is wrong)" if end else "is cut off"  # zeros may fill up a chunk
            assert all(f"{short}: is cut off" in line or damaged in line for line in said)
            assert len(said) <= 1


def large_bag(path: Path, take: Path, megabytes: int, pictures: int) -> None:
    """As many MB of another sensor's messages, with pictures of the take among them; and a message of no known kind."""
    image, text = "sensor_msgs/msg/Image", "std_msgs/msg/String"
    raw = [cv2.imread(str(entry.picture), cv2.IMREAD_UNCHANGED) for entry in load_recording(take).frames]
    cloud = STORE.serialize_cdr(KINDS[text]("x" * 1_000_000), text)
    with path.open("wb") as file:
        writer = McapFileWriter(file, compression=CompressionType.NONE)
        writer.start("ros2", "another program")
        channels = []
        for topic, kind in (("/lidar", text), ("/cam/image_raw", image)):
            definition = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
            channels.append(writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", definition)))
        writer.add_message(writer.register_channel("/notes", "cdr", 0), 0, b"", 0)
        for number in range(max(megabytes, pictures)):
            if number < megabytes:
                writer.add_message(channels[0], number, cloud, number)
            if number < pictures:
                _, message = grey(raw[number % len(raw)], stamp_ns=number * 16_666_667)
                writer.add_message(channels[1], number, STORE.serialize_cdr(message, image), number)
        writer.finish()


def test_a_topic_that_says_nothing_of_its_kind_is_passed_over(tmp_path: Path, take: Path, run: Run) -> None:
    """Beside pictures, which are read."""
    bag, out = tmp_path / "bag.mcap", tmp_path / "out"
    large_bag(bag, take, 1, 3)
    assert run("import", bag, out, *OWN_ROW_TIME)[:2] == (0, f"{out}: 3 frames\n")


def most_memory_kb(bag: Path, out: Path) -> int:
    """Returns what `ledpi import` takes at most."""
    command = [*LEDPI, "import", str(bag), str(out), *OWN_ROW_TIME]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return used.ru_maxrss


@pytest.mark.slow
def test_memory_does_not_grow_with_the_bag(take: Path, tmp_path: Path) -> None:
    """150 MB of it, where a small one is as long as two pictures."""
    used_kb = []
    for megabytes, pictures in ((2, 2), (120, 100)):
        large_bag(tmp_path / "large.mcap", take, megabytes, pictures)
        used_kb.append(most_memory_kb(tmp_path / "large.mcap", tmp_path / str(megabytes)))
        assert len(load_recording(tmp_path / str(megabytes)).frames) == pictures
    assert used_kb[1] < used_kb[0] + 20_000


# ---- Written as it happens

SIMULATED = ("--set", "panels.side_m=0.16", "--set", "camera.source=simulated")


@pytest.mark.slow
def test_record_writes_a_bag_that_becomes_a_recording(tmp_path: Path) -> None:
    """Holds what was decoded live, and today's date."""
    done = ledpi("record", tmp_path / "a.mcap", "--frames", 20, *SIMULATED)
    assert done.returncode == 0, done.stderr
    assert ledpi("import", tmp_path / "a.mcap", tmp_path / "back").returncode == 0
    recording = load_recording(tmp_path / "back")
    assert len(recording.frames) == 20
    assert any(entry.decoded for entry in recording.frames)
    assert recording.wall_clock_offset_ns is not None
    unix_s = (recording.frames[0].row0_readout_ns + recording.wall_clock_offset_ns) / 1e9
    assert abs(time.time() - unix_s) < 60
    assert decoded(tmp_path / "a.mcap", "/ledpi/detections")


@pytest.mark.slow
def test_a_bag_whose_recorder_was_killed_is_read(tmp_path: Path) -> None:
    """All but its last frames."""
    out = tmp_path / "a.mcap"
    command = [*LEDPI, "record", str(out), "--seconds", "60", *SIMULATED]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until(lambda: out.exists() and out.stat().st_size > 2_000_000)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = ledpi("import", out, tmp_path / "back")
    assert done.returncode == 0, done.stderr
    assert len(load_recording(tmp_path / "back").frames) > 5


def test_a_bag_is_not_written_over(bag: Path, take: Path, run: Run) -> None:
    """It may be the only one."""
    status, _, errors = run("export", take, bag)
    assert (status, errors) == (2, f"ledpi: {bag}: is there already; give a new name\n")


@pytest.mark.slow
def test_a_missing_package_is_named_with_its_extra(take: Path, tmp_path: Path) -> None:
    """As where only `pip install ledpi` was done."""
    hidden = "import sys; sys.modules['mcap'] = None; from ledpi.cli import main; main()"
    command = [sys.executable, "-c", hidden, "export", str(take), str(tmp_path / "x.mcap")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30), check=False)
    assert done.returncode == 2
    assert "pip install 'ledpi[bags]'" in done.stderr
    assert not os.path.exists(tmp_path / "x.mcap")
