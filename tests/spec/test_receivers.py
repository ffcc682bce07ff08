"""The reference receiver in C: the page's vectors, the same decisions as Python's, and an emulated microcontroller."""

from __future__ import annotations

import itertools
import random
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluation.endurance.receivers import corrupted_stream, faults, received_in_python
from ledpi.wire import (
    FixMessage,
    MarkerMessage,
    Message,
    NoFix,
    OdometryMessage,
    Receiver,
    State,
    StatusMessage,
    TimeAnswer,
    TimeAsk,
    WirePose,
)
from ledpi.wire.codec import FROM_CONTROLLER, decode, encode
from tests.builders.receiver import HEADER, ROOT, STRICT, Received, needs_gcc, received_in_c
from tests.builders.simavr import CLOCK_HZ, PinTrace, build_with_make, emulate, needs_simavr
from tests.builders.waiting import limit_s
from tests.builders.wire import RejectedVector, Vector, controller_vectors, rejected_vectors, vectors

VECTORS = vectors()
BYTES = st.integers(0, 255)

# ---- On this machine


@needs_gcc
@pytest.mark.parametrize("vector", VECTORS, ids=lambda v: v.name)
def test_the_bytes_on_the_page_become_the_message(vector: Vector) -> None:
    """Each vector of docs/wire.md gives what Python reads from it, which its own test compares with the page."""
    received = received_in_c(vector.frame)
    assert received.messages == [decode(vector.frame[:-1])[1]]
    assert (received.counters.good, received.counters.bad, received.counters.skipped) == (1, {}, {})


@needs_gcc
@pytest.mark.parametrize("vector", rejected_vectors(), ids=lambda v: v.name)
def test_what_the_page_rejects_is_rejected_for_that_reason(vector: RejectedVector) -> None:
    """And the next frame is received."""
    received = received_in_c(b"\0" + vector.frame + VECTORS[0].frame)
    assert len(received.messages) == 1
    assert received.counters.bad | received.counters.skipped == {vector.reason: 1}


@needs_gcc
def test_a_corrupted_stream_gives_the_whole_frames_and_no_other() -> None:
    """Gives both receivers what is byte for byte a frame that was sent, and no more; they count alike.

    The long form is `evaluation/endurance/receivers.py`: ten million bytes.
    """
    stream, whole = corrupted_stream(300_000, random.Random(6))
    assert len(whole) > 1000
    assert faults(stream, whole) == []


@needs_gcc
def test_a_zero_ahead_of_each_frame_is_nothing() -> None:
    """As ledpi writes it: between two frames there are two, and both receivers take the empty frame for none."""
    stream = b"".join(b"\0" + vector.frame for vector in VECTORS)
    for received in (received_in_c(stream), received_in_python(stream)):
        assert received.messages == [decode(vector.frame[:-1])[1] for vector in VECTORS]
        assert received.counters.bad == {}


WHOLE = st.sampled_from([vector.frame for vector in VECTORS])  # with their delimiters
PIECES = st.one_of(
    WHOLE,
    st.binary(max_size=60),
    st.builds(lambda frame, at, byte: frame[:at] + bytes([byte]) + frame[at + 1 :], WHOLE, st.integers(0, 39), BYTES),
    st.builds(lambda frame, start, end: frame[start:end], WHOLE, st.integers(0, 40), st.integers(0, 40)),
    st.builds(lambda body: cobs.encode(body + zlib.crc32(body).to_bytes(4, "little")) + b"\0", st.binary(max_size=38)),
)


@pytest.mark.slow
@needs_gcc
@settings(max_examples=40)
@given(st.lists(PIECES, max_size=40), st.lists(st.integers(1, 90), min_size=1, max_size=5))
def test_both_decide_alike_on_any_stream(pieces: list[bytes], cuts: list[int]) -> None:
    """Whole frames, pieces of them, right checksums around anything, noise: the same messages and counters.

    Python is given it in pieces of other lengths, C byte by byte.
    """
    stream, receiver, lengths = b"".join(pieces), Receiver(), itertools.cycle(cuts)
    messages: list[Message] = []
    fed = 0
    while fed < len(stream):
        length = next(lengths)
        messages += receiver.feed(stream[fed : fed + length])
        fed += length
    assert received_in_c(stream) == Received(messages=messages, counters=receiver.counters)


@needs_gcc
def test_a_false_packet_would_be_seen() -> None:
    """The check above can fail: a whole frame that nobody sent is reported for both receivers."""
    stream, whole = corrupted_stream(2000, random.Random(6))
    assert len(faults(stream + VECTORS[0].frame, whole)) == 2


@pytest.mark.slow
@needs_gcc
def test_both_decide_alike_on_what_a_wrong_sender_could_send() -> None:
    """20,000 bodies of random bytes, types, versions and lengths with a right CRC: the same messages and counters."""
    rng = random.Random(7)
    stream = bytearray(b"\0")
    for _ in range(20_000):
        header = bytes([rng.choice([1, 1, 1, 1, 2]), rng.choice([1, 1, 1, 2, 2, 3, 4, 4, 9])]) + rng.randbytes(2)
        body = bytearray(rng.randbytes(rng.choice([30, 30, 30, 30, 29, 0])))
        if len(body) == 30 and rng.random() < 0.8:
            body[2] &= 7 if header[1] == 1 else 0  # flags
            body[16:24] = np.array([32767, 0, rng.randint(-1600, 1600), 0], "<i2").tobytes()  # lengths around 1.001
            if header[1] == 4:
                body[6:8], body[26] = rng.choice([b"\x00\x7d", b"\x01\x7d"]), rng.choice([0, 1, 2, 3, 58])
        content = header + bytes(body)
        stream += cobs.encode(content + zlib.crc32(content).to_bytes(4, "little")) + b"\0"
    in_c, in_python = received_in_c(bytes(stream)), received_in_python(bytes(stream))
    assert in_c == in_python
    assert in_c.counters.good > 3000
    assert set(in_c.counters.bad | in_c.counters.skipped) == {"length", "value", "version", "type", "flags"}


WRITER = """
#include <stdio.h>
#include "ledpi_receiver.h"
/* Reads "SEQUENCE CLOCK LEFT RIGHT YAW RESTARTED LIFTED SLIPPING" thrice and writes odometry; then a time's numbers. */
int main(void)
{
    static uint8_t buffer[LEDPI_ODOMETRY_BYTES + 1];
    unsigned sequence, restarted, lifted, slipping, number, arrived, left;
    buffer[LEDPI_ODOMETRY_BYTES] = 0x55; /* no byte more is written */
    for (int i = 0; i < 3; i++) {
        ledpi_odometry o;
        if (scanf("%u %u %d %d %d %u %u %u", &sequence, &o.clock_us, &o.left_100um, &o.right_100um, &o.yaw_100urad,
                  &restarted, &lifted, &slipping) != 8)
            return 1;
        o.restarted = restarted, o.lifted = lifted, o.slipping = slipping;
        ledpi_sender sender = {(uint16_t)sequence};
        fwrite(buffer, 1, ledpi_write_odometry(buffer, &sender, &o), stdout);
    }
    if (scanf("%u %u %u %u", &sequence, &number, &arrived, &left) != 4)
        return 1;
    ledpi_sender sender = {(uint16_t)sequence};
    fwrite(buffer, 1, ledpi_write_time(buffer, &sender, (uint16_t)number, arrived, left), stdout);
    return buffer[LEDPI_ODOMETRY_BYTES] == 0x55 && sender.sequence == sequence + 1 ? 0 : 2;
}
"""


@needs_gcc
def test_the_c_writer_writes_the_page_s_bytes(tmp_path: Path) -> None:
    """Odometry and an answer, each with a zero ahead."""
    (tmp_path / "writer.c").write_text(WRITER)
    subprocess.run(["gcc", *STRICT, "-o", str(tmp_path / "writer"), str(tmp_path / "writer.c")], check=True)
    told = [[v.sequence, *list(v.values.values())[1:]] for v in controller_vectors()]
    numbers = " ".join(str(-(2**31) if value is None else int(value)) for values in told for value in values)
    done = subprocess.run([tmp_path / "writer"], input=numbers.encode(), capture_output=True, check=True)
    assert done.stdout == b"".join(b"\0" + vector.frame for vector in controller_vectors())


FUZZ_ON_STDIN = """
#include <stdio.h>
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int main(void)
{
    uint8_t data[256];
    for (int size; (size = getchar()) != EOF;)
        LLVMFuzzerTestOneInput(data, fread(data, 1, (size_t)size, stdin));
    return 0;
}
"""


@pytest.mark.slow
@needs_gcc
def test_what_the_fuzzer_asks_holds_on_seeded_input(tmp_path: Path) -> None:
    """receiver_fuzz.c, which clang's libFuzzer drives, given 5,000 inputs: its promises and gcc's sanitizers."""
    source = tmp_path / "fuzz.c"
    source.write_text((ROOT / "tests/builders/receiver_fuzz.c").read_text(encoding="utf-8") + FUZZ_ON_STDIN)
    sanitize = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    subprocess.run(["gcc", *STRICT, *sanitize, "-o", str(tmp_path / "fuzz"), str(source)], check=True)
    rng = random.Random(11)
    inputs = []
    for _ in range(5000):
        sealed = [bytes([34 << 1 | 1, 1, rng.randint(1, 4)]) + rng.randbytes(32) for _ in range(rng.randint(0, 2))]
        inputs.append(b"".join(sealed) + rng.randbytes(rng.randrange(100)))
    stream = b"".join(bytes([len(data)]) + data for data in inputs)
    subprocess.run([tmp_path / "fuzz"], input=stream, check=True, timeout=limit_s(30))


@pytest.mark.skipif(shutil.which("g++") is None, reason="not installed: g++")
def test_the_header_is_good_for_arduino(tmp_path: Path) -> None:
    """An Arduino sketch is C++."""
    sketch = tmp_path / "sketch.cpp"
    sketch.write_text(
        '#include "ledpi_receiver.h"\nledpi_receiver receiver;\nledpi_guard guard = {300, false, 0};\n'
        "int main() { return ledpi_feed(&receiver, 0) + ledpi_guard_may_drive(&guard, 0); }\n"
    )
    command = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-I", str(HEADER.parent), str(sketch)]
    subprocess.run([*command, "-o", str(tmp_path / "sketch")], check=True)
    assert subprocess.run([tmp_path / "sketch"], check=False).returncode == 0


GUARD = """
#include <stdio.h>
#include <string.h>
#include "ledpi_receiver.h"
/* Reads "fix NOW AGE_MS", "status NOW NO_FIX", "ask NOW" and answers each ask with 0 or 1. */
int main(void)
{
    static ledpi_receiver r;
    ledpi_guard guard = {.timeout_ms = 300};
    char what[8];
    unsigned now, value;
    while (scanf("%7s %u", what, &now) == 2) {
        if (!strcmp(what, "ask")) {
            printf("%d", ledpi_guard_may_drive(&guard, now));
            continue;
        }
        if (scanf("%u", &value) != 1)
            return 1;
        if (!strcmp(what, "fix"))
            r.message.fix.age_us = value * 1000;
        else
            r.message.status.no_fix = (uint8_t)value;
        ledpi_guard_take(&guard, &r, *what == 'f' ? LEDPI_FIX : LEDPI_STATUS, now);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("guard")
    (folder / "guard.c").write_text(GUARD)
    subprocess.run(["gcc", *STRICT, "-o", str(folder / "guard"), str(folder / "guard.c")], check=True)
    return folder / "guard"


@needs_gcc
@pytest.mark.parametrize(
    ("story", "answers"),
    [
        pytest.param("ask 0  ask 1000", "00", id="nothing was said"),
        pytest.param("fix 1000 20  ask 1000  ask 1279  ask 1280", "110", id="300 ms from the exposure on"),
        pytest.param("fix 1000 300  ask 1000", "0", id="a fix that came too old"),
        pytest.param("fix 1000 20  status 1050 5  ask 1050", "0", id="a status that says no fix"),
        pytest.param("fix 1000 20  status 1050 0  ask 1050", "1", id="a status that says there is one"),
        pytest.param("fix 1000 20  status 1050 5  fix 1060 20  ask 1060", "1", id="a fix after it"),
        pytest.param("fix 10 20  ask 10  ask 289  ask 290", "110", id="a fix exposed before the clock began"),
        pytest.param("fix 4294967290 20  ask 4294967290  ask 100  ask 274", "110", id="the clock wraps"),
        pytest.param("fix 1000 20  ask 2000  ask 1100", "00", id="once timed out, always until the next fix"),
    ],
)
def test_a_robot_drives_on_a_young_fix_only(guard: Path, story: str, answers: str) -> None:
    """Times in ms; the guard's timeout is 300."""
    done = subprocess.run([guard], input=story, capture_output=True, text=True, check=True)
    assert done.stdout == answers


# ---- On an ATmega328P, emulated

BAUD = 115200
PACKETS = 1200
STARTED_S = 0.05
PACKET_S = 41 * (10 * CLOCK_HZ // BAUD) / CLOCK_HZ  # the emulator sends a byte in whole clock cycles


def full_line() -> bytes:
    """Packets back to back, each after a zero: two markers and a fix a frame, at times a status."""
    level = (1.0, 0.0, 0.0, 0.0)
    pose = WirePose(position_m=(1.5, -0.25, 0.0), quaternion_wxyz=level, deviation_m=None, deviation_rad=None)
    frames = []
    for n in range(PACKETS):
        if n % 30 == 0:
            frames.append(encode(StatusMessage(state=State.RUNNING, no_fix=NoFix.NONE, uptime_s=n), n))
        elif n % 3 == 2:
            frames.append(encode(FixMessage(age_us=30_000, pose=pose, panels_used=2), n))
        else:
            frames.append(encode(MarkerMessage(id=n % 50, age_us=30_000, pose=pose), n))
    return b"".join(b"\0" + frame for frame in frames)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("receiver") / "sources"
    shutil.copytree(HEADER.parent, folder, ignore=shutil.ignore_patterns("*.elf", "*.hex"))
    return build_with_make(folder)


@pytest.fixture(scope="module")
def run(built: Path, tmp_path_factory: pytest.TempPathFactory) -> PinTrace:
    """The robot's program: a full line for 1200 packets, then silence until its next line of text."""
    work = tmp_path_factory.mktemp("run")
    end_s = STARTED_S + PACKETS * PACKET_S
    return emulate(built, np.ceil(end_s) + 0.1, work=work, arrivals=[(STARTED_S, full_line())], baud=BAUD)


@pytest.mark.slow
@needs_simavr
def test_a_full_line_is_received_without_loss(run: PinTrace) -> None:
    """Every packet of 1200 back to back at 115200 baud, from Python's encoder; no byte found its queue full."""
    last = run.said.decode().splitlines()[-1]
    fixes = sum(n % 3 == 2 for n in range(PACKETS))
    assert last == f"stop x 1500 y -250 mm; {PACKETS} good 0 lost {fixes} fixes 0 overruns"


@pytest.mark.slow
@needs_simavr
def test_the_motors_stop_in_time(run: PinTrace) -> None:
    """From the first fix on the pin is high, through to the end of the fixes; then it falls once, for good.

    It may be at most 300 ms and a tick of 1 ms after the last fix's last byte; and not before 300 ms less the age
    that the fix came with.
    """
    rise, fall = run.edges["PB1"] / CLOCK_HZ
    first_fix_s = STARTED_S + 3 * PACKET_S
    last_fix_s = STARTED_S + PACKETS * PACKET_S
    assert first_fix_s <= rise <= first_fix_s + 0.005
    assert last_fix_s + 0.269 <= fall <= last_fix_s + 0.301


@needs_simavr
def test_it_takes_less_than_a_kilobyte(built: Path) -> None:
    """The program with its queue and its line of text: data and bss together, as avr-size counts them."""
    command = ["avr-size", str(built.with_suffix(".elf"))]
    table = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    _, data, bss = (int(number) for number in re.findall(r"\d+", table[1])[:3])
    assert 0 < data + bss <= 1024


@needs_simavr
def test_the_two_way_line_on_a_microcontroller(tmp_path: Path) -> None:
    """Odometry and answers go out whole while states come in; the stamps keep pace with the emulator's own time.

    All of it takes less than 600 bytes of RAM.
    """
    elf, program = tmp_path / "two_way.elf", tmp_path / "two_way.hex"
    source = ROOT / "tests/builders/avr_two_way.c"
    compiler = ["avr-gcc", "-mmcu=atmega328p", "-DF_CPU=16000000UL", "-std=c99", "-Os", "-Wall", "-Wextra", "-Werror"]
    include = [f"-I{HEADER.parent}", f"-I{ROOT / 'firmware/drive'}"]
    subprocess.run([*compiler, *include, "-o", str(elf), str(source), "-lm"], check=True)
    subprocess.run(["avr-objcopy", "-O", "ihex", "-R", ".eeprom", str(elf), str(program)], check=True)
    state = next(v.frame for v in VECTORS if v.name == "state")
    asked_s = [0.1 + 0.0613 * n for n in range(10)]
    asks = [(at_s, b"\0" + encode(TimeAsk(number=n), n)) for n, at_s in enumerate(asked_s)]
    states = [(at_s + 0.03, b"\0" + state) for at_s in asked_s]
    told = emulate(program, 0.8, work=tmp_path, arrivals=asks + states, baud=BAUD)

    receiver = Receiver(FROM_CONTROLLER)
    messages = receiver.feed(told.said)
    assert (receiver.counters.bad, receiver.counters.lost) == ({}, 0)
    odometry = [m for m in messages if isinstance(m, OdometryMessage)]
    answers = [m for m in messages if isinstance(m, TimeAnswer)]
    assert [m.number for m in answers] == list(range(10))
    came_us = [(at_s + 13 * PACKET_S / 41) * 1e6 for at_s in asked_s]
    offsets_us = [m.arrived_us - came for m, came in zip(answers, came_us, strict=True)]
    assert max(offsets_us) - min(offsets_us) < 150
    assert all(0 < m.left_us - m.arrived_us < 6000 for m in answers)
    assert len(odometry) == pytest.approx(38, abs=2)
    assert [(m.left_100um, m.right_100um) for m in odometry] == [(50 * n, 100 * n) for n in range(1, len(odometry) + 1)]
    assert [m.restarted for m in odometry] == [True] + [False] * (len(odometry) - 1)
    assert told.is_high("PB1", told.end)
    table = subprocess.run(["avr-size", str(elf)], capture_output=True, text=True, check=True).stdout.splitlines()
    _, data, bss = (int(number) for number in re.findall(r"\d+", table[1])[:3])
    assert 0 < data + bss <= 600
