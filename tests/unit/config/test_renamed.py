"""The decoding methods' old names: still read, and noted on standard error."""

from __future__ import annotations

from pathlib import Path

import pytest

from ledpi.config.settings import load_config

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


@pytest.mark.parametrize(("old", "new"), OLD)
def test_an_old_name_on_the_command_line_is_read_and_noted(
    old: str, new: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """As --set has it, and --method, which is the same."""
    assert load_config(None, ("panels.side_m=0.16", f"decode.method={old}")).decode.method == new
    assert capsys.readouterr().err == f"ledpi: configuration: decode.method: {old} is now called {new}\n"


@pytest.mark.parametrize("name", ["likelihood", "uemura"])
def test_todays_names_are_not_noted(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is printed."""
    assert load_config(None, ("panels.side_m=0.16", f"decode.method={name}")).decode.method == name
    assert capsys.readouterr().err == ""
