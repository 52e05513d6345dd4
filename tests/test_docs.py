"""What the documents tell people to type exists."""

from __future__ import annotations

import functools
import json
import re
import shlex
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import benchmark.cli
import vision
from benchmark.cli import COMMANDS, main
from benchmark.localizers.registry import make_localizer
from benchmark.models import load_model

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

    load = benchmark.cli._load
    monkeypatch.setattr("benchmark.cli._load", lambda name: recorder(name, load(name)))
    return names


@pytest.mark.parametrize("command", documented_focalpick_commands())
def test_documented_command_parses(command, parsed):
    words = shlex.split(command)[1:]
    assert main(words) == 0
    assert parsed in ([words[0]], [" ".join(words[:2])])


@pytest.mark.parametrize("command", ["sweep --no-such-option 1", "no-such-command", "sweep --scenes many"])
def test_a_wrong_command_does_not_parse(command, parsed):
    assert main(shlex.split(command)) == 2
    assert parsed == []


def python_blocks(path="README.md"):
    return re.findall(r"^```python\n(.*?)^```", read(path), flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def pieces():
    """The true poses of the pieces in the pictures of docs/vision.md, 4x4; no example reads them."""
    return [np.array(piece["T_world_part"]) for piece in json.loads(read("docs/images/three_views/truth.json"))]


def assert_found(estimates, pieces, fold=3):
    """Every piece once, and nothing else: within 0.2 mm and 0.3 degrees, up to the part's symmetry."""
    assert len(estimates) == len(pieces)
    turns = Rotation.from_rotvec(np.outer(np.arange(fold) * 2 * np.pi / fold, [0, 0, 1]))
    for piece in pieces:
        off_mm = [1e3 * np.linalg.norm(e.T_world_part.translation - piece[:3, 3]) for e in estimates]
        assert sorted(off_mm)[0] < 0.2
        nearest = estimates[int(np.argmin(off_mm))]
        turned = ((Rotation.from_matrix(piece[:3, :3]) * turns).inv() * nearest.T_world_part.rotation).magnitude()
        assert np.degrees(turned.min()) < 0.3


def test_the_librarys_examples_find_the_four_pieces(monkeypatch, capsys, pieces):
    monkeypatch.chdir(ROOT)
    names = {}
    for source in python_blocks("docs/vision.md"):
        exec(compile(source, "docs/vision.md", "exec"), names)
    assert len(pieces) == 4
    assert_found(names["found"].estimates, pieces)
    sigma_m = [np.sqrt(np.diag(estimate.covariance)[:3]).max() for estimate in names["found"].estimates]
    assert max(sigma_m) < 0.1e-3
    assert capsys.readouterr().out.count("cover2: (") == 4
    assert names["region_growing_alone"].name == "focal-region"
    assert {feature.extractor for feature in names["rims"]} == {"region"}
    assert len(names["large"]) >= 1
    assert len(names["grouping"].features) >= 10


def test_readme_pose_example_finds_the_four_pieces(monkeypatch, capsys, pieces):
    (source,) = [block for block in python_blocks() if "load_views" in block]
    monkeypatch.chdir(ROOT)
    exec(compile(source, "README.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) == len(pieces)


def test_every_public_name_is_in_the_table_of_names():
    table = read("docs/vision.md").partition("## Names")[2]
    named = {name for row in re.findall(r"^\| (`.*?) \|", table, flags=re.MULTILINE) for name in row.split("`")[1::2]}
    assert named == set(vision.__all__)


def test_views_json_of_the_document_is_what_is_read(tmp_path):
    (text,) = re.findall(r"^```json\n(.*?)^```", read("docs/vision.md"), flags=re.MULTILINE | re.DOTALL)
    (tmp_path / "views.json").write_text(text, encoding="utf-8")
    cv2.imwrite(str(tmp_path / "left.png"), np.zeros((480, 640), np.uint8))
    assert [view.name for view in vision.load_views(tmp_path)] == ["left"]


def test_readme_detector_example_runs(tmp_path, monkeypatch, capsys):
    (source,) = [block for block in python_blocks() if "detect_ellipses" in block]
    disc = cv2.ellipse(np.full((200, 300), 30, np.uint8), (150, 100), (80, 50), 20, 0, 360, 200, -1, cv2.LINE_AA)
    cv2.imwrite(str(tmp_path / "photo.jpg"), disc)
    monkeypatch.chdir(tmp_path)
    exec(compile(source, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("(150.0, 100.0)  80.")


@pytest.fixture
def own_localizer(tmp_path, monkeypatch):
    """The name that the README gives its localizer, whose file lies in the working directory."""
    (source,) = [block for block in python_blocks() if "def localize" in block]
    (name,) = {
        name for command in documented_focalpick_commands() for name in re.findall(r"--localizer (\S+:\S+)", command)
    }
    (tmp_path / f"{name.partition(':')[0]}.py").write_text(source, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, name.partition(":")[0], raising=False)
    return name


def test_readme_localizer_hands_on_what_the_papers_system_is_most_sure_of(own_localizer):
    models = [load_model("cover2")]
    views = vision.load_views(ROOT / "docs/images/three_views")
    everything = make_localizer("focal", models, tuple).localize(views).estimates
    (only,) = make_localizer(own_localizer, models, tuple).localize(views).estimates
    assert len(everything) == 4
    assert only.score == max(estimate.score for estimate in everything)
    assert np.array_equal(only.T_world_part.as_matrix(), everything[0].T_world_part.as_matrix())


@pytest.mark.sweep
def test_readme_localizer_runs_an_episode(own_localizer, capsys):
    assert main(["run", "--part", "cover2", "--seed", "7", "--task", "none", "--localizer", own_localizer]) == 0
    out = capsys.readouterr().out
    assert "cautious" in out
    assert out.count(" mm, tilt ") == 1  # of four pieces
    assert out.count("not found") + out.count("not matched") == 3


def test_readme_entry_point_leads_to_the_localizer(own_localizer, monkeypatch):
    (text,) = re.findall(r"^```toml\n(.*?)^```", read("README.md"), flags=re.MULTILINE | re.DOTALL)
    groups = tomllib.loads(text)["project"]["entry-points"]
    points = [EntryPoint(name, value, group) for group, named in groups.items() for name, value in named.items()]
    monkeypatch.setattr(
        "benchmark.localizers.registry.entry_points", lambda group: [p for p in points if p.group == group]
    )
    (point,) = points
    assert point.value == own_localizer
    assert make_localizer(point.name, [load_model("cover1")], tuple).name == "cautious"


def test_a_console_block_is_read_line_by_line():
    text = "```console\n$ make test\noutput\n$ focalpick run \\\n    --seed 7\n```\n```python\n$ no\n```\n"
    assert [command.split() for command in console_commands(text)] == [
        ["make", "test"],
        ["focalpick", "run", "--seed", "7"],
    ]


def test_only_targets_are_taken_for_targets():
    assert make_targets("OUT ?= a\nhelp:  ## x\n\techo a: b\nVAR := c\ntable1: install gl\n") == {"help", "table1"}
