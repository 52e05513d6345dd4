"""What the documents tell people to type exists."""

from __future__ import annotations

import functools
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from benchmark.cli import COMMANDS, main
from vision.localizer import Localizer

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = tuple(
    path.relative_to(ROOT).as_posix() for path in sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
)


def read(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def console_commands(text: str) -> list[str]:
    """The lines that start with `$` in blocks fenced as console, continued lines joined."""
    blocks = re.findall(r"^```console\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [line.removeprefix("$").strip() for line in lines if line.startswith("$ ")]


def make_targets(makefile: str) -> set[str]:
    return set(re.findall(r"^([a-z][a-z0-9_-]*):(?!=)", makefile, flags=re.MULTILINE))


def make_variables(makefile: str) -> set[str]:
    return set(re.findall(r"^([A-Z_]+) \?=", makefile, flags=re.MULTILINE))


def documented_focalpick_commands() -> list[str]:
    commands = {command for path in DOCUMENTS for command in console_commands(read(path))}
    return sorted(command for command in commands if command.startswith("focalpick "))


def test_readme_shows_commands():
    commands = console_commands(read("README.md"))
    assert "make table1" in commands
    assert "make test" in commands
    assert any(command.startswith("focalpick ") for command in commands)


@pytest.mark.parametrize("path", DOCUMENTS)
def test_make_targets_and_variables_exist(path):
    makefile = read("Makefile")
    quoted = re.findall(r"`([^`\n]+)`", read(path))
    for command in [*console_commands(read(path)), *quoted]:
        if not command.startswith("make "):
            continue
        for word in shlex.split(command)[1:]:
            name, is_assignment, _ = word.partition("=")
            known = make_variables(makefile) if is_assignment else make_targets(makefile)
            assert name in known, f"{path}: `{command}`"


@pytest.mark.parametrize("path", DOCUMENTS)
def test_links_lead_somewhere(path):
    for link in re.findall(r"\]\(([^)\s]+)\)", read(path)):
        target, _, anchor = link.partition("#")
        if "://" in target:
            continue
        document = (ROOT / path).parent / target if target else ROOT / path
        assert document.exists(), f"{path}: {link}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", document.read_text(encoding="utf-8"), flags=re.MULTILINE)
            assert anchor in {
                re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings
            }


def test_every_subcommand_is_documented():
    text = "\n".join(read(path) for path in DOCUMENTS)
    assert [name for name in COMMANDS if f"`focalpick {name}`" not in text] == []


@pytest.fixture
def parsed(monkeypatch):
    """The names of the commands that were parsed, in order; nothing runs."""
    names: list[str] = []

    def recorder(name, command):
        @functools.wraps(command)
        def record(*_arguments, **_options):
            names.append(name)
            return 0

        return record

    monkeypatch.setattr("benchmark.cli.COMMANDS", {name: recorder(name, run) for name, run in COMMANDS.items()})
    return names


@pytest.mark.parametrize("command", documented_focalpick_commands())
def test_documented_command_parses(command, parsed):
    words = shlex.split(command)[1:]
    assert main(words) == 0
    assert parsed in ([words[0]], [" ".join(words[:2])])


@pytest.mark.parametrize("command", ["sweep --no-such-option 1", "no-such-command", "sweep --scenes many"])
def test_a_wrong_command_does_not_parse(command, parsed):
    with pytest.raises(SystemExit) as stop:
        main(shlex.split(command))
    assert stop.value.code == 2
    assert parsed == []


def test_readme_localizer_is_one():
    (source,) = re.findall(r"^```python\n(.*?)^```", read("README.md"), flags=re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(source, "README.md", "exec"), names)
    localizer = names["make"]([object()])
    assert isinstance(localizer, Localizer)
    assert localizer.localize([]).estimates == ()


def test_a_console_block_is_read_line_by_line():
    text = "```console\n$ make test\noutput\n$ focalpick run \\\n    --seed 7\n```\n```python\n$ no\n```\n"
    assert [command.split() for command in console_commands(text)] == [
        ["make", "test"],
        ["focalpick", "run", "--seed", "7"],
    ]


def test_only_targets_are_taken_for_targets():
    assert make_targets("OUT ?= a\nhelp:  ## x\n\techo a: b\nVAR := c\ntable1: install gl\n") == {"help", "table1"}
