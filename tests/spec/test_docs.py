"""Things that the documents point to: they are there."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.exceptions import TyperException
from typer.main import get_command

from ledpi.camera.recovering import DEADLINE_S
from ledpi.cli import COMMANDS, app, main
from tests.builders import ROOT

_GLOBS = ("README.md", "CONTRIBUTING.md", "docs/*.md", "firmware/*/*.md")
DOCUMENTS = [str(path.relative_to(ROOT)) for glob in _GLOBS for path in sorted(ROOT.glob(glob))]
TEXTS = {document: (ROOT / document).read_text(encoding="utf-8") for document in DOCUMENTS}


def found(pattern: str) -> list[tuple[str, Any]]:
    """Each match of all documents, with the document it is in."""
    return [(document, match) for document, text in TEXTS.items() for match in re.findall(pattern, text)]


def test_links_lead_to_files() -> None:
    """Every relative link and picture, from where the document lies."""
    targets = [(document, target) for document, target in found(r"\]\(([^)#\s]+)") if "://" not in target]
    assert [(of, target) for of, target in targets if not ((ROOT / of).parent / target).exists()] == []


def test_a_link_that_is_named_as_a_source_leads_to_it() -> None:
    """`[settings.py](../ledpi/config/settings.py)`: a file that was renamed is renamed in the text as well."""
    named = found(r"\[`([\w./-]+\.(?:py|c|h))`\]\(([^)#\s]+)")
    assert [(of, name) for of, (name, target) in named if not f"/{target}".endswith(f"/{name}")] == []


def test_functions_that_the_algorithm_names_exist() -> None:
    """Each name of two words or more in backticks that is no key; symbols begin with a single letter."""
    page = (ROOT / "docs/algorithm.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`([a-z]{2,}(?:_[a-z]+)+)`", page)) - {"side_m"}
    sources = [path for kind in ("py", "c", "h") for path in (ROOT / "ledpi").rglob(f"*.{kind}")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    assert names
    assert [name for name in sorted(names) if f"{name}(" not in code] == []


def anchors(page: Path) -> set[str]:
    """Returns what a link may name after `#`: the headings, in lower case, blanks as hyphens, without punctuation."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_lead_to_headings() -> None:
    """Looks in this page or another, where a link names one."""
    targets = [
        (document, (ROOT / document).parent / page if page else ROOT / document, heading)
        for document, (page, heading) in found(r"\]\(([^):]*)#([^)]+)\)")
    ]
    assert [(of, heading) for of, page, heading in targets if heading not in anchors(page)] == []


def test_every_page_can_be_reached_from_the_readme() -> None:
    """By links, a folder standing for its README.md."""
    reached: set[Path] = set()
    waiting = [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page.suffix == ".md" and page.is_file() and page not in reached:
            reached.add(page)
            targets = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
            there = [(page.parent / target).resolve() for target in targets if "://" not in target]
            waiting += [path / "README.md" if path.is_dir() else path for path in there]
    assert [document for document in DOCUMENTS if ROOT / document not in reached] == []


def test_when_a_lost_camera_is_given_up() -> None:
    """Wherever a page says it, it says what the code does."""
    said = found(r"[Aa]fter (\d+) s\s(?:without a frame|it ends|ends)")
    pages = ("docs/architecture.md", "docs/faults.md", "docs/raspberry-pi.md")
    assert [each for each in said if each[0] in pages] == [(page, f"{DEADLINE_S:g}") for page in pages]


def test_every_reason_is_on_the_page() -> None:
    """Each that any stage, a camera or the capture may give has its row, once; and no other."""
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "ledpi").rglob("*.py")]
    given = {f"{a}.{b}" for text in sources for a, b in re.findall(r'Rejected\(stage="(\w+)", reason="(\w+)"', text)}
    page = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+\.\w+)` \|", page, re.MULTILINE)
    assert given - set(rows) == set(), "docs/troubleshooting.md lacks a row"
    assert sorted(rows) == sorted(given)


def test_the_only_notice_of_what_hardware_has_not_seen_is_the_readme_s() -> None:
    """Other pages link to it."""
    repeated = [
        document
        for document, _ in found("(?i)not seen on hardware|not flown")
        if document != "docs/results.md"  # is generated
    ]
    assert repeated == ["README.md"]


def commands(group: Any, path: str = "ledpi") -> Iterator[tuple[str, Any]]:
    """Every command and group, with what is typed to call it."""
    for name, command in group.commands.items():
        yield f"{path} {name}", command
        if hasattr(command, "commands"):
            yield from commands(command, f"{path} {name}")


def loaded(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns the command line, once it has loaded its commands."""
    monkeypatch.setattr("sys.argv", ["ledpi", "--help", *COMMANDS])
    with pytest.raises(SystemExit):
        main()
    return get_command(app)


def test_the_help_of_every_command_has_an_example(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that calls this very command."""
    without = [path for path, command in commands(loaded(monkeypatch)) if f"Example: {path}" not in command.help]
    assert without == []


def test_the_help_of_all_says_of_each_command_what_its_own_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """There no command is loaded."""
    own = {name: command.get_short_help_str(100) for name, command in loaded(monkeypatch).commands.items()}
    assert own == COMMANDS


def test_a_list_of_commands_is_not_cut_short(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Compares what a command does with the 80 columns of its group's help."""
    for group in ([], ["calibrate"], ["config"], ["panel"], ["map"]):
        monkeypatch.setattr("sys.argv", ["ledpi", *group, "--help"])
        with pytest.raises(SystemExit):
            main()
    listed = capsys.readouterr().out.splitlines()
    assert [line for line in listed if line.endswith("...") and not line.startswith("Usage: ")] == []


def test_the_page_of_commands_has_every_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heading for each that can be run, and below it an example that calls this very command."""
    groups_too = commands(loaded(monkeypatch))
    runnable = [path for path, command in groups_too if getattr(command, "invoke_without_command", True)]
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## (ledpi .+)\n((?:(?!## ).*\n)*)", page, re.MULTILINE))
    assert sorted(sections) == sorted(runnable)
    assert [path for path, text in sections.items() if f"\n    {path}" not in text] == []


def test_the_benchmarks_that_a_page_names_are_there() -> None:
    """`python -m evaluation.speed.latency`, as it is typed."""
    for document, (folder, name) in found(r"python -m evaluation\.(\w+)(?:\.(\w+))?"):
        there = ROOT / "evaluation" / folder
        assert there.is_dir() or there.with_suffix(".py").is_file(), document
        assert not name or (there / f"{name}.py").is_file(), f"{document}: {folder} {name}"


def typed_commands(text: str) -> list[list[str]]:
    """The calls of ledpi in a page's code blocks, in words; continued lines are joined, comments dropped."""
    blocks = re.findall(r"^```(?:sh|bash)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    blocks += re.findall(r"(?:^    .*\n)+", text, re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    calls = [re.search(r"^(?:.*?(?:&&|;) |)\s*(?:sudo |)ledpi (.*)", line) for line in lines]
    return [shlex.split(call[1], comments=True) for call in calls if call is not None]


def test_commands_have_the_options_that_a_page_gives_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """And arguments of the right kinds; they are parsed, not run."""
    top, refused = loaded(monkeypatch), []
    for document, typed in [(document, typed) for document, text in TEXTS.items() for typed in typed_commands(text)]:
        command, words = top, typed
        while hasattr(command, "commands") and words and words[0] in command.commands:
            command, words = command.commands[words[0]], words[1:]
        try:
            assert not (hasattr(command, "commands") and words), f"no command {words[0]}"
            command.make_context("ledpi", list(words))
        except (AssertionError, TyperException) as error:
            refused.append((document, typed, str(error)))
    assert refused == []


def test_a_page_does_not_write_twice_into_a_new_folder() -> None:
    """`panel firmware` wants a folder of its own; whoever follows the page has the first one already."""
    folders = [
        (document, words[words.index("--out") + 1])
        for document, text in TEXTS.items()
        for words in typed_commands(text)
        if words[:2] == ["panel", "firmware"]
    ]
    assert len(set(folders)) == len(folders)
