"""``focalpick teach`` without its page: what it refuses, what it prepares, and the replay."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from benchmark.cli import main
from benchmark.lessons.page_services import open_mesh, open_part, open_views
from benchmark.world.parts import get_part
from vision.model.model_file import model_to_json
from vision.teaching.editor.server import listen
from vision.teaching.editor.services import Services
from vision.teaching.session import digests
from vision.teaching.session_file import replay
from vision.teaching.view_directory import load_part_name, load_views

ROOT = Path(__file__).resolve().parents[2]
SESSIONS = ROOT / "assets" / "models" / "sessions"
PULLEY = ROOT / "tests" / "parts" / "belt_pulley.obj"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "arguments: got none of them; expected exactly one of --part, --views, --mesh and --replay"),
        (("--part", "hub", "--views", "here"), "arguments: got --part and --views"),
        (("--part", "gear"), "part: got 'gear'"),
        (("--views", "nowhere"), "nowhere"),
        (("--mesh", "nowhere.obj"), "nowhere.obj"),
        (("--mesh", str(PULLEY), "--unit", "inch"), "unit of a mesh: got 'inch'; expected m or mm"),
        (("--replay", "nowhere"), "nowhere"),
    ],
)
def test_bad_arguments_are_told_in_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["teach", "--no-show", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_is_told(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["teach", "--no-show", "--views", str(SESSIONS / "cover2"), "--port", str(port)]) == 2
    assert f"port: got {port}, which is taken" in capsys.readouterr().err


def test_two_pages_at_once_have_ports_of_their_own():
    with listen(None) as one, listen(None) as other:
        ports = [listener.getsockname()[1] for listener in (one, other)]
        assert ports[0] != ports[1]
        for port in ports:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()


def test_a_port_that_does_not_exist_is_told(capsys):
    assert main(["teach", "--no-show", "--views", str(SESSIONS / "cover2"), "--port", "70000"]) == 2
    assert "expected 0 to 65535" in capsys.readouterr().err


@pytest.mark.slow
def test_a_part_is_photographed_once(tmp_path):
    directory, services = open_part("cover1", tmp_path / "cover1")
    before = digests(load_views(directory))
    assert load_part_name(directory) == "cover1"
    assert len(before) == 10
    (directory / "front_1.png").touch()
    stamp = (directory / "front_1.png").stat().st_mtime_ns
    assert digests(load_views(open_part("cover1", directory)[0])) == before
    assert (directory / "front_1.png").stat().st_mtime_ns == stamp
    part = get_part("cover1")
    told = services.description
    assert (told.name, told.diameter_m, told.symmetry_fold) == ("cover1", part.diameter_m, part.symmetry.fold)


@pytest.mark.slow
def test_a_mesh_is_photographed_too(tmp_path):
    directory, services = open_mesh(PULLEY, "m", tmp_path / "pulley")
    assert len(load_views(directory)) == 10
    assert get_part(services.source).name == services.description.name == "belt_pulley"


def test_pictures_alone_are_described_by_their_directory():
    directory, services = open_views(SESSIONS / "cover2", 65.0)
    assert directory == SESSIONS / "cover2"
    assert (services.description.name, services.description.diameter_m) == ("cover2", 0.065)
    assert open_views(SESSIONS / "cover2", None)[1].description is None
    assert "taught pictures" in services.trial_note


def test_services_are_what_the_page_asks_for():
    services: Services = open_views(SESSIONS / "cover2", None)[1]
    assert services.trial_note


@pytest.mark.slow
def test_replay_writes_the_model_of_the_session(tmp_path):
    assert main(["teach", "--replay", str(SESSIONS / "cover1"), "--out", str(tmp_path / "model.json")]) == 0
    assert (tmp_path / "model.json").read_text() == model_to_json(replay(SESSIONS / "cover1"))
