"""Corrupted streams into both receivers, Python's and C's: is a false packet ever accepted, or a whole one missed?

Frames of all kinds, of which most are damaged as lines damage them: flipped bits, bytes lost, doubled, put in
or exchanged, delimiters lost or put in, noise, two frames run together. Whatever lies between two delimiters and is
byte for byte a frame that was sent must be received; nothing else may be. Both must agree to the last counter.
Exit status 1 where one of this does not hold. Needs gcc.

    python -m evaluation.endurance.receivers [--bytes 10000000] [--seed 1]
"""

from __future__ import annotations

import argparse
import random
import time

from evaluation import end
from ledpi import wire
from ledpi.wire.codec import decode, encode
from tests.builders.receiver import Received, received_in_c

WHOLE_SHARE = 0.3  # of the frames
POOL = 3000  # different frames


def random_message(rng: random.Random) -> wire.Message:
    """Any that ledpi sends, with values over their whole ranges."""
    kind = rng.randrange(5)
    if kind == 4:
        return wire.TimeAsk(number=rng.getrandbits(16))
    if kind == 3:
        return wire.StateMessage(
            position_m=(rng.uniform(-838, 838), rng.uniform(-9, 9)),
            yaw_rad=rng.uniform(-3.1, 3.1),
            velocity=(rng.uniform(-2, 2), rng.uniform(-3, 3)),
            deviations=(rng.uniform(0, 0.01), rng.uniform(0, 1), rng.uniform(0, 3)),
            correlations=(rng.uniform(-1, 1), 0.0, 1.0),
            clock_us=rng.getrandbits(32),
            mode=rng.choice((wire.Mode.PANELS, wire.Mode.ODOMETRY)),
            contested=rng.random() < 0.2,
        )
    if kind == 2:
        state, no_fix = rng.choice(list(wire.State)), rng.choice(list(wire.NoFix))
        return wire.StatusMessage(
            state=state, no_fix=no_fix, frames=rng.getrandbits(31), temperature_c=rng.randint(-40, 90)
        )
    q = [rng.gauss(0, 1) for _ in range(4)]
    norm = sum(v * v for v in q) ** 0.5
    w, x, y, z = (v / norm for v in q)
    pose = wire.WirePose(
        position_m=(rng.uniform(-838, 838), rng.uniform(-9, 9), rng.uniform(-1, 1)),
        quaternion_wxyz=(w, x, y, z),
        deviation_m=(rng.uniform(0, 0.01), rng.uniform(0, 1), rng.uniform(0, 60)) if rng.random() < 0.7 else None,
        deviation_rad=(0.0, rng.uniform(0, 0.1), rng.uniform(0, 3)) if rng.random() < 0.7 else None,
    )
    if kind == 1:
        used, resets = rng.randint(1, 300), rng.randrange(256)
        return wire.FixMessage(age_us=rng.getrandbits(17), pose=pose, panels_used=used, map_resets=resets)
    return wire.MarkerMessage(
        id=rng.getrandbits(16), age_us=rng.getrandbits(17), pose=pose, ambiguous=rng.random() < 0.2
    )


DAMAGES = ("flip", "flip", "lose", "double", "put in", "exchange", "noise", "delimit", "run together")


def damage(frame: bytearray, rng: random.Random) -> None:
    """Harms it as lines do."""
    kind = rng.choice(DAMAGES)
    if kind == "flip":
        for _ in range(rng.randint(1, 5)):
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    elif kind == "noise":
        frame[:] = rng.randbytes(rng.randint(1, 120))
    elif kind == "run together":
        del frame[-1]
    else:
        at = rng.randrange(len(frame))
        if kind == "lose":
            del frame[at : at + rng.randint(1, 12)]
        elif kind == "double":
            frame[at:at] = frame[at : at + rng.randint(1, 12)]
        elif kind == "put in":
            frame[at:at] = rng.randbytes(rng.randint(1, 3))
        elif kind == "delimit":
            frame[at] = 0
        else:
            other = rng.randrange(len(frame))
            frame[at], frame[other] = frame[other], frame[at]


def corrupted_stream(count: int, rng: random.Random) -> tuple[bytes, list[wire.Message]]:
    """At least so many bytes between two delimiters, and the messages that are whole in it."""
    pool = [encode(random_message(rng), rng.getrandbits(16)) for _ in range(POOL)]
    stream = bytearray(b"\0")
    while len(stream) < count:
        frame = bytearray(rng.choice(pool))
        if rng.random() > WHOLE_SHARE:
            damage(frame, rng)
        stream += frame
    stream += b"\0"
    sent = {frame[:-1]: decode(frame[:-1])[1] for frame in pool}
    return bytes(stream), [sent[piece] for piece in bytes(stream).split(b"\0")[:-1] if piece in sent]


def received_in_python(stream: bytes) -> Received:
    receiver = wire.Receiver()
    return Received(messages=receiver.feed(stream), counters=receiver.counters)


def faults(stream: bytes, whole: list[wire.Message]) -> list[str]:
    """Lists what the two receivers did wrong."""
    python, c = received_in_python(stream), received_in_c(stream)
    found = []
    for name, received in (("Python", python), ("C", c)):
        if received.messages != whole:
            found.append(f"{name}: {len(received.messages)} messages, not the {len(whole)} that are whole")
    if python.counters != c.counters:
        found.append(f"they count differently: {python.counters}, {c.counters}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    stream, whole = corrupted_stream(arguments.bytes, random.Random(arguments.seed))
    started = time.monotonic()
    found = faults(stream, whole)
    counters = received_in_python(stream).counters
    print(f"{len(stream)} bytes in {time.monotonic() - started:.1f} s; {len(whole)} whole frames; {counters}")
    end("receivers", dict.fromkeys(found, True))


if __name__ == "__main__":
    main()
