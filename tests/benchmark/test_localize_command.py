"""`focalpick localize` on drawn plates: their poses on standard output, their outlines in pictures."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmark import cli
from tests.vision.conftest import photograph, plate, pose  # noqa: F401
from vision.files.views import load_views, save_views
from vision.model.model_file import save_model

BOX = ["--workspace", "-0.08", "-0.08", "-0.03", "0.08", "0.08", "0.03"]


@pytest.fixture(scope="module")
def scene(pose):  # noqa: F811
    return [pose(-33, 0, 0, about=(5, 3, 11)), pose(33, 4, 1, about=(-4, 6, 70))]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory, photograph, scene):  # noqa: F811
    directory = tmp_path_factory.mktemp("pictures")
    save_views(directory, photograph(scene, 3))
    return directory


@pytest.fixture(scope="module")
def model(tmp_path_factory, plate):  # noqa: F811
    path = tmp_path_factory.mktemp("models") / "plate.json"
    save_model(plate, path)
    return path


def test_poses_are_printed_for_programs(pictures, model, scene, capsys):
    command = ["localize", "--views", str(pictures), "--model", str(model), *BOX, "--format", "json"]
    assert cli.main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found) == 2
    for truth in scene:
        at = [np.array(e["T_world_part"])[:3, 3] for e in found]
        assert min(np.linalg.norm(t - truth.translation) for t in at) < 1e-4
    for e in found:
        assert (e["part"], e["views"], e["inplane_known"]) == ("plate", 3, True)
        assert 0.5 < e["score"] <= 1
        assert np.shape(e["covariance"]) == (6, 6)


def test_poses_are_printed_for_people_and_drawn(pictures, model, scene, tmp_path, capsys):
    out = tmp_path / "a" / "b"
    assert cli.main(["localize", "--views", str(pictures), "--model", str(model), *BOX, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "2 found in 3 views" in text
    for truth in scene:
        x, y, _ = 1e3 * truth.translation
        assert any(
            abs(float(words[1]) - x) < 0.1 and abs(float(words[2]) - y) < 0.1
            for words in (line.split() for line in text.splitlines())
            if words and words[0] == "plate"
        )
    drawn = sorted(out.iterdir())
    assert [path.name for path in drawn] == ["1_view_0.png", "2_view_1.png", "3_view_2.png"]
    for path in drawn:
        image = cv2.imread(str(path))
        assert image.shape == (960, 1280, 3)
        blue, green, red = (image[..., k].astype(int) for k in range(3))
        assert np.count_nonzero((green > blue + 60) & (green > red + 60)) > 500  # the model, in green


def test_one_extractor_can_be_chosen(pictures, model, capsys):
    command = ["localize", "--views", str(pictures), "--model", str(model), *BOX, "--format", "json"]
    assert cli.main([*command, "--localizer", "focal-region"]) == 0
    assert {e["process"] for e in json.loads(capsys.readouterr().out)} == {"region"}


def test_nothing_found_is_no_error(pictures, model, capsys):
    far = ["--workspace", "1", "1", "1", "1.1", "1.1", "1.1"]
    command = ["localize", "--views", str(pictures), "--model", str(model), *far]
    assert cli.main([*command, "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert cli.main(command) == 0
    assert "0 found in 3 views" in capsys.readouterr().out


def test_poses_that_the_pictures_contradict_are_named(pictures, model, tmp_path, capsys):
    views = load_views(pictures)
    command = ["localize", "--views", str(tmp_path), "--model", str(model), "--format", "json"]
    save_views(tmp_path, [replace(view, T_world_camera=view.T_world_camera.inv()) for view in views])
    assert cli.main(command) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out) == []
    assert printed.err.startswith("focalpick: warning: the pictures contradict the camera poses")
    assert "read as T_camera_world" in printed.err
    assert printed.err.count("\n") == 1


def test_right_poses_are_not_doubted(pictures, model, capsys):
    assert cli.main(["localize", "--views", str(pictures), "--part", "cover1", *BOX]) == 0
    assert cli.main(["localize", "--views", str(pictures), "--model", str(model), *BOX]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--part and --model: got neither; expected one of them"),
        (["--part", "cover2", "--model", "{model}"], "got both"),
        (["--part", "hat"], "got hat; expected one of hub"),
        (["--model", "nowhere.json"], "nowhere.json"),
        (["--model", "{model}", "--workspace", "0", "0", "0", "-1", "1", "1"], "workspace: got"),
        (["--model", "{model}", "--workspace", "0", "0", "0"], "--workspace"),
        (["--model", "{model}", "--localizer", "oracle"], "got oracle; expected one that needs no truth"),
        (["--model", "{model}", "--localizer", "best"], "got best"),
        (["--model", "{model}", "--views", "nowhere"], "views.json"),
        (["--model", "{model}", "--out", "{model}"], "Choose another --out"),
    ],
    ids=str,
)
def test_mistakes_are_one_line(arguments, message, pictures, model, capsys):
    given = [word.format(model=model) for word in arguments]
    assert cli.main(["localize", "--views", str(pictures), *given]) == 2
    err = capsys.readouterr().err
    assert err.startswith("focalpick: ")
    assert err.count("\n") == 1
    assert message in err


def test_a_broken_picture_is_one_line(photograph, pose, model, tmp_path, capfd):  # noqa: F811
    save_views(tmp_path, photograph([pose()], 1))
    content = (tmp_path / "view_0.png").read_bytes()
    (tmp_path / "view_0.png").write_bytes(content[: len(content) // 2])
    assert cli.main(["localize", "--views", str(tmp_path), "--model", str(model)]) == 2
    err = capfd.readouterr().err
    assert "view_0.png: got a file that cannot be decoded" in err
    assert err.count("\n") == 1
