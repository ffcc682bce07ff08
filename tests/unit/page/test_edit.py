"""Settings over HTTP: what is told of them, and who may not change them, or with what."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from ledpi.page.guard import MAX_UPLOAD_BYTES
from ledpi.workshop import backup
from tests.unit.page.test_http import RIGHT, Site

TEXT = "# mine\npanels: {side_m: 0.16}\nmap: markers.yaml\nview: {edit: true, token: the-token-of-a-file}\n"
MAP = "panels: {7: {position_m: [0, 0, 2], quaternion_wxyz: [1, 0, 0, 0]}}\n"
CHANGE = json.dumps({"do": "set", "key": "panels.side_m", "value": "0.2"}).encode()


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration that may be changed."""
    monkeypatch.setattr(backup, "RULES", tmp_path / "rules.d")
    (tmp_path / "markers.yaml").write_text(MAP, encoding="utf-8")
    (tmp_path / "config.yaml").write_text(TEXT, encoding="utf-8")
    return tmp_path / "config.yaml"


@pytest.fixture
def site(tmp_path: Path, file: Path) -> Iterator[Site]:
    """A page without a daemon."""
    made = Site(tmp_path / "tap.sock", file)
    yield made
    made.close()


def test_changes_are_made_and_no_secret_is_told(site: Site, file: Path) -> None:
    """Not either where the file has a mistake, which is told; and a backup has no token."""
    assert site.ask("POST", "/api/edit", body=CHANGE).json()["says"].startswith("panels.side_m: saved")
    assert file.read_text(encoding="utf-8") == TEXT.replace("0.16", "0.2")
    told = site.ask("GET", "/api/config")
    keys = {row["key"]: row for row in told.json()["keys"]}
    assert [keys["panels.side_m"][part] for part in ("text", "from", "default")] == ["0.2", str(file), "none"]
    assert (keys["view.token"]["text"], keys["serial.baud"]["from"]) == ("set", "default")
    assert told.json()["edit"]["undo"] == {"to": "config.yaml.bak-1", "changes": ["panels.side_m: 0.2 → 0.16"]}
    archive = site.ask("GET", "/api/backup").body
    file.write_text(TEXT.replace("the-token-of-a-file", "a wrong word"), encoding="utf-8")
    wrong = site.ask("GET", "/api/config")
    assert wrong.json()["edit"]["mistakes"] == [f"{file}: view.token: must be letters, digits and any of . _ ~ + / = -"]
    unpacked = b"".join(kept.content for kept in backup.unpack(archive, "").files)
    for secret in (b"the-token", b"a wrong word"):
        assert secret not in told.body + wrong.body + unpacked


@pytest.mark.parametrize(
    ("key", "value", "then"),
    [
        ("view.listen", "127.0.0.1:8089", "; start ledpi view again to apply it"),
        ("view.edit", "false", ""),
        ("outputs.field", "{kind: mqtt, host: 10.0.0.2}", "; start its bridge again to apply it"),
    ],
)
def test_the_answer_names_what_must_be_started_again(site: Site, key: str, value: str, then: str) -> None:
    """Nothing for `view.edit`, which counts at once."""
    body = json.dumps({"do": "set", "key": key, "value": value}).encode()
    says = site.ask("POST", "/api/edit", body=body).json()["says"]
    assert says.startswith(f"{key}: saved{then}")
    assert ("start" in says) == bool(then)


def test_a_backup_comes_back_and_the_token_stays(site: Site, file: Path) -> None:
    """The older map is kept."""
    archive = site.ask("GET", "/api/backup").body
    (file.parent / "markers.yaml").write_text("panels: {}\n", encoding="utf-8")
    file.write_text(TEXT.replace("0.16", "0.3"), encoding="utf-8")
    assert site.ask("POST", "/api/restore", body=archive).status == 200
    assert file.read_text(encoding="utf-8") == TEXT
    assert (file.parent / "markers.yaml").read_text(encoding="utf-8") == MAP
    assert (file.parent / "markers.yaml.bak-1").read_text(encoding="utf-8") == "panels: {}\n"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 401),
        ({"Authorization": "Bearer the-token-of-a-file"}, 401),
        (RIGHT | {"Host": "evil.example"}, 421),
        (RIGHT | {"Origin": "http://evil.example"}, 403),
        (RIGHT | {"Origin": "null"}, 403),
        (RIGHT | {"Sec-Fetch-Site": "cross-site"}, 403),
    ],
)
def test_nothing_is_changed_for_others(site: Site, file: Path, headers: dict[str, str], status: int) -> None:
    """Without the token, or asked by another site's page; a backup is not given either."""
    for path in ("/api/edit", "/api/restore", "/api/reload"):
        assert site.ask("POST", path, headers, CHANGE).status == status
    assert site.ask("GET", "/api/backup", headers).status == status
    assert file.read_text(encoding="utf-8") == TEXT


def test_without_view_edit_nothing_is_offered_and_all_is_refused(site: Site, file: Path) -> None:
    """From the moment on that the file says so."""
    assert site.ask("GET", "/api/config").json()["edit"] is not None
    file.write_text(TEXT.replace("edit: true", "edit: false"), encoding="utf-8")
    assert site.ask("GET", "/api/config").json()["edit"] is None
    for method, path in (
        ("POST", "/api/edit"),
        ("POST", "/api/restore"),
        ("POST", "/api/reload"),
        ("GET", "/api/backup"),
    ):
        answer = site.ask(method, path, body=CHANGE)
        assert (answer.status, answer.json()["error"]) == (403, f"view.edit is not true in {file}")
    assert not [*file.parent.glob("*.bak-*")]


def test_what_cannot_be_put_back_changes_nothing(site: Site, file: Path) -> None:
    """Too large, no archive, one that leads outside of the folder, or one that names a file of this machine."""
    whole = site.ask("GET", "/api/backup").body
    outside = _changed(whole, (b'"markers', b'"../markers'), (b"map: ", b"map: ../"))
    named = _changed(whole, (b"map: ", b"camera: {intrinsics: /etc/passwd}\nmap: "))
    most = MAX_UPLOAD_BYTES["/api/restore"]
    assert most == backup.MAX_BYTES
    for body, size, status, said in (
        (b"", most + 1, 413, f"a body must have {most} bytes at most"),  # it is not read
        (b"x" * most, most, 400, "backup: is no whole backup"),
        (outside, len(outside), 400, "map: ../markers.yaml in the backup: must be below"),
        (named, len(named), 400, "camera.intrinsics: /etc/passwd is not in the backup"),
    ):
        answer = site.ask("POST", "/api/restore", RIGHT | {"Content-Length": str(size)}, body)
        assert answer.status == status
        assert answer.json()["error"].startswith(said)
    assert {path.name for path in file.parent.iterdir()} == {"config.yaml", "markers.yaml"}
    assert not (file.parent.parent / "markers.yaml").exists()


def _changed(archive: bytes, *replaced: tuple[bytes, bytes]) -> bytes:
    """The archive, with other words in its files."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            for before, after in replaced:
                content = content.replace(before, after)
            new.writestr(name, content)
    return out.getvalue()
