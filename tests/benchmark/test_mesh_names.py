"""Mesh files on the command line: how they are named, and that the advice in an error works where it is given."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from benchmark.cli import main
from benchmark.commands.common import split_parts
from benchmark.models import load_model
from benchmark.world import mesh_part
from benchmark.world.parts import get_part
from vision.errors import InputError
from vision.model.model_file import save_model


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working directory with a ring in millimetres, under several names."""
    ring = (Manifold.cylinder(12, 30, 30, 96, True) - Manifold.cylinder(20, 10, 10, 96, True)).to_mesh()
    mesh = trimesh.Trimesh(ring.vert_properties, ring.tri_verts.astype(np.int64), process=False)
    (tmp_path / "a,b+c").mkdir()
    for name in ("ring.stl", "ring,v2.stl", "M8+ring.stl", "a,b+c/ring.stl", "my ring.stl"):
        mesh.export(tmp_path / name)
    (tmp_path / "ring.step").write_text("ISO-10303-21;")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(mesh_part.CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr("benchmark.commands.common.prepare_process", lambda: None)
    monkeypatch.setattr("benchmark.commands.teach.prepare_process", lambda: None)
    get_part.cache_clear()
    yield tmp_path
    get_part.cache_clear()


@pytest.fixture
def page(monkeypatch):
    """What the teaching page would be opened with; nothing is drawn, and cover 1 is all that is taught."""
    opened = []

    def serve(directory, out, services, *_):
        opened.append(services.source)
        out.parent.mkdir(parents=True, exist_ok=True)
        save_model(load_model("cover1"), out)

    monkeypatch.setattr("vision.teaching.editor.server.serve", serve)
    monkeypatch.setattr("benchmark.world.studio.Studio.__enter__", lambda self: self)
    monkeypatch.setattr("benchmark.world.studio.Studio.__exit__", lambda *_: None)
    monkeypatch.setattr("benchmark.world.studio.Studio.photograph", lambda *_: [])
    monkeypatch.setattr("benchmark.lessons.page_services.save_views", lambda *_: None)
    return opened


def told(capsys, *arguments):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize("name", ["ring,v2.stl:mm", "M8+ring.stl:mm", "a,b+c/ring.stl:mm", "hub,M8+ring.stl:mm"])
@pytest.mark.parametrize("command", [("run", "--part"), ("sweep", "--parts"), ("sweep", "--part")])
def test_a_comma_or_plus_in_a_name_is_told(command, name, folder, capsys):
    error = told(capsys, *command, name)
    assert "commas separate parts, and + mixes them" in error
    (folder / "link.stl").symlink_to(folder / re.search("the file (.*?);", error)[1])
    assert split_parts("hub,link.stl:mm") == ("hub", "link.stl:mm")


def test_commas_and_plus_still_separate_and_mix():
    assert split_parts("hub, ring.stl:mm+cover1") == ("hub", "ring.stl:mm+cover1")


@pytest.mark.parametrize(
    "command", [("run", "--part"), ("sweep", "--parts"), ("teach", "--part"), ("teach", "--mesh")]
)
def test_a_step_file_is_told_which_files_do(command, capsys):
    assert re.search("OBJ, STL or PLY.*Export it as one of these", told(capsys, *command, "ring.step"))


@pytest.mark.parametrize("command", [("run", "--part"), ("sweep", "--parts"), ("teach", "--part")])
def test_a_unit_that_is_none_is_told(command, capsys):
    assert "Write :m or :mm for the unit, not :in." in told(capsys, *command, "ring.stl:in")


@pytest.mark.parametrize(
    "command", [("run", "--part"), ("sweep", "--parts"), ("teach", "--part"), ("teach", "--mesh")]
)
def test_a_mesh_in_the_wrong_unit_is_told_words_that_work(command, page, capsys):
    advised = re.search(
        r"write (\S*ring\.stl:mm); focalpick teach also takes (--unit mm)\.", told(capsys, *command, "ring.stl")
    )
    assert split_parts(advised[1]) == (advised[1],)
    for arguments in (("--mesh", advised[1]), ("--part", advised[1]), ("--mesh", "ring.stl", *advised[2].split())):
        assert main(["teach", *arguments]) == 0
    assert all(source.endswith("ring.stl:mm") for source in page)


def test_two_units_at_once_are_told(page, capsys):
    assert "--unit: got m; expected mm, as in ring.stl:mm" in told(
        capsys, "teach", "--mesh", "ring.stl:mm", "--unit", "m"
    )
    assert main(["teach", "--mesh", "ring.stl:mm", "--unit", "mm"]) == 0


def test_lessons_of_a_mesh_lie_in_the_working_directory(folder, monkeypatch, page):
    kept = []
    monkeypatch.setattr("vision.teaching.editor.server.serve", lambda directory, *_: kept.append(str(directory)))
    assert main(["teach", "--part", f"{folder}/ring.stl:mm"]) == 0
    assert main(["teach", "--mesh", "ring.stl:mm"]) == 0
    assert kept == ["teaching/ring", "teaching/ring"]


@pytest.mark.parametrize("name", ["ring.stl:mm", "my ring.stl:mm"])
@pytest.mark.parametrize("models", [None, "taught"])
def test_a_mesh_without_a_model_is_told_the_command_that_teaches_it(name, models, page):
    with pytest.raises(InputError, match="Teach the part first: focalpick teach") as caught:
        load_model(name, models)
    command, given = re.search("first: focalpick (.*?)\\. Then give --models (.*?)\\.$", str(caught.value)).groups()
    assert main(shlex.split(command)) == 0
    load_model.cache_clear()
    assert load_model(name, *shlex.split(given)).part == name


def test_localize_asks_for_the_model_of_a_mesh(capsys):
    assert "Give the model that you taught with --model" in told(
        capsys, "localize", "--views", "nowhere", "--part", "ring.stl:mm"
    )
