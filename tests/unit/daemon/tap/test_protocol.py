"""The tap's lines: what is a request and what is not, and how lines are written."""

from __future__ import annotations

import json

import pytest

from ledpi.daemon.tap.protocol import RequestError, read_line, read_request, with_dropped, write_line


def test_a_request_is_read_with_all_that_it_asks() -> None:
    """Its id may be a number or a text."""
    request = read_request(b'{"do": "picture", "id": "a", "with": ["evidence", "rejected"]}')
    assert (request.do, request.id, request.extras) == ("picture", "a", {"evidence", "rejected"})
    assert read_request(b'{"do": "record", "id": 4, "seconds": 60}').seconds == 60.0
    assert read_request(b'{"do": "save"}').id is None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"picture", "is not JSON"),
        (b"\xff\xfe", "is not JSON"),
        (b"[" * 4000, "is not JSON"),
        (b'{"do": "save", "id": ' + b"9" * 4000 + b"}", "id: must be"),
        (b"[1]", "must be a JSON object"),
        (b'{"id": 1}', "do: must be one of picture, config, save"),
        (b'{"do": ["save"], "id": 1}', "do: must be one of"),
        (b'{"do": "reboot", "id": 1}', "do: must be one of"),
        (b'{"do": "picture", "id": 1, "size": 2}', "size: unknown key; picture has the keys do, id, with"),
        (b'{"do": "picture", "id": 1, "with": "evidence"}', "with: must be a list of rejected, evidence"),
        (b'{"do": "picture", "id": 1, "with": ["all"]}', "with: must be a list of"),
        (b'{"do": "record", "id": 1, "seconds": NaN}', "seconds: must be a number from 1 to 600"),
        (b'{"do": "record", "id": 1, "seconds": true}', "seconds: must be"),
        (b'{"do": "odometry", "t_ns": 1.5, "left_m": 0, "right_m": 0}', "t_ns: must be a whole number"),
        (b'{"do": "odometry", "t_ns": 1, "left_m": 0}', "left_m, right_m: must be two numbers, or none"),
        (b'{"do": "odometry", "t_ns": 1, "yaw_rad": NaN}', "yaw_rad: must be a number"),
        (b'{"do": "odometry", "t_ns": 1, "yaw_rad": 0, "lifted": 1}', "lifted: must be true or false"),
        (b'{"do": "save", "id": true}', "id: must be a whole number"),
        (b'{"do": "save", "id": {}}', "id: must be a whole number"),
    ],
)
def test_what_is_no_request_is_named(line: bytes, said: str) -> None:
    """The message says what is wrong and what would be right."""
    with pytest.raises(RequestError, match=r".") as caught:
        read_request(line)
    assert said in str(caught.value)


def test_a_refusal_bears_the_id_where_that_could_be_read() -> None:
    """So the client knows which of its requests it was."""
    with pytest.raises(RequestError) as caught:
        read_request(b'{"do": "reboot", "id": 17}')
    assert caught.value.id == 17


def test_a_line_is_json_whatever_is_in_it() -> None:
    """JSON has no infinity, and text may hold what is no UTF-8: neither breaks the line."""
    line = write_line({"type": "x", "values": [1.0, float("inf"), {"a": float("nan")}], "text": "é\udcff\n"})
    assert line.count(b"\n") == 1
    assert json.loads(line)["values"] == [1.0, None, {"a": None}]
    assert json.loads(line)["text"].startswith("é")


def test_what_a_client_has_missed_is_added_to_its_line() -> None:
    """The line is written once for all clients."""
    line = with_dropped(write_line({"type": "decoded", "seq": 4}), 17)
    assert json.loads(line) == {"type": "decoded", "seq": 4, "dropped": 17}
    assert line.endswith(b"}\n")


@pytest.mark.parametrize("line", [b"", b"{}", b"[]", b'{"type": 1}', b"\xff"])
def test_a_client_knows_what_is_no_line_of_a_tap(line: bytes) -> None:
    """It may have been led to another program's socket."""
    with pytest.raises(ValueError, match=r"."):
        read_line(line)
