"""Lesson directories: views survive the way to files and back; wrong descriptions are refused, naming the field."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.schema_rules import follows
from vision.errors import FileFormatError, InputError
from vision.files import views as view_directory
from vision.geometry.camera import View
from vision.teaching.session import Session
from vision.teaching.view_directory import load_part_name, load_views, save_views

MODELS = Path(__file__).resolve().parents[2] / "assets" / "models"
SCHEMA = json.loads((MODELS / "teaching_views.schema.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def views(photograph, pose):
    return photograph([pose()], views=2)


@pytest.fixture
def lesson(tmp_path, views):
    save_views(tmp_path, views, "plate")
    return tmp_path


def described(lesson, path, value):
    """views.json with the value at a path replaced; ``...`` deletes the key."""
    document = json.loads((lesson / "views.json").read_text(encoding="utf-8"))
    target = copy.deepcopy(document)
    inner = target
    for step in path[:-1]:
        inner = inner[step]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    (lesson / "views.json").write_text(json.dumps(target), encoding="utf-8")
    return target


def test_views_come_back(lesson, views):
    loaded = load_views(lesson)
    assert load_part_name(lesson) == "plate"
    for before, after in zip(views, loaded, strict=True):
        assert np.array_equal(before.gray, after.image)
        assert (before.camera, before.name) == (after.camera, after.name)
        assert np.allclose(before.T_world_camera.as_matrix(), after.T_world_camera.as_matrix(), rtol=0, atol=1e-12)
    Session.start(views).check(loaded)
    assert follows(json.loads((lesson / "views.json").read_text(encoding="utf-8")), SCHEMA)


def test_colour_pictures_are_read_as_rgb_and_saved_grey(lesson, views):
    colour = np.zeros((480, 640, 3), np.uint8)
    colour[:, :, 2] = 200  # OpenCV writes blue, green, red
    cv2.imwrite(str(lesson / "view_0.png"), colour)
    assert load_views(lesson)[0].image[0, 0].tolist() == [200, 0, 0]
    save_views(lesson, load_views(lesson), "plate")
    assert load_views(lesson)[0].image.ndim == 2


def test_lens_distortion_is_taken_out(lesson, views):
    described(lesson, ("views", 0, "camera", "distortion"), [-0.2, 0.05, 0.0, 0.0, 0.0])
    flat, other = load_views(lesson)
    assert not any(flat.camera.distortion)
    assert not np.array_equal(flat.image, views[0].gray)
    assert np.array_equal(other.image, views[1].gray)


WRONG = [
    (("schema_version",), 2),
    (("part",), ""),
    (("unit",), "inch"),
    (("views",), []),
    (("views",), ...),
    (("views", 0, "name"), 5),
    (("views", 0, "camera", "fx"), 0),
    (("views", 0, "camera", "width_px"), 640.5),
    (("views", 0, "camera", "distortion"), [0, 0, 0]),
    (("views", 0, "camera", "skew"), 0),
    (("views", 1, "T_part_camera"), [[1, 0, 0, 0]]),
    (("views", 1, "T_part_camera", 2), [1, 0, 0]),
]


@pytest.mark.parametrize(("path", "value"), WRONG, ids=str)
def test_wrong_field_is_named_and_refused_by_reader_and_schema_alike(path, value, lesson):
    assert not follows(described(lesson, path, value), SCHEMA)
    named = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")
    with pytest.raises(FileFormatError) as refusal:
        load_views(lesson)
    assert f"views.json: {named}: got" in str(refusal.value)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("views", 0, "T_part_camera", 0), [2, 0, 0, 0], "T_part_camera"),
        (("views", 0, "T_part_camera", 3), [0, 0, 0, 2], "T_part_camera"),
        (("views", 0, "camera", "width_px"), 320, "image"),
        (("views", 0, "image"), "../view_0.png", "image"),
    ],
)
def test_reader_also_refuses_what_a_schema_cannot_say(path, value, named, lesson):
    described(lesson, path, value)
    with pytest.raises(FileFormatError, match=rf"views\.json: views\[0\]\.{named}: got"):
        load_views(lesson)


def test_missing_files_and_pictures_that_are_none_are_refused(lesson, tmp_path):
    (lesson / "view_1.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"picture .*view_1\.png: got"):
        load_views(lesson)
    (lesson / "view_1.png").unlink()
    with pytest.raises(InputError, match=r"picture .*view_1\.png: got"):
        load_views(lesson)
    with pytest.raises(InputError, match=r"views\.json"):
        load_views(tmp_path / "nowhere")


def test_views_of_one_name_are_refused(tmp_path, views):
    with pytest.raises(InputError, match="different names"):
        save_views(tmp_path, [views[0], replace(views[1], name=views[0].name)], "plate")


def test_the_views_of_a_scene_come_back_as_they_were_taken(tmp_path, views):
    bent = View(
        views[0].image, replace(views[0].camera, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0)), views[0].T_world_camera
    )
    view_directory.save_views(str(tmp_path), [bent])
    (loaded,) = view_directory.load_views(str(tmp_path))
    assert (loaded.camera, loaded.name) == (bent.camera, bent.name)
    assert np.array_equal(loaded.image, bent.image)
    assert np.allclose(loaded.T_world_camera.as_matrix(), bent.T_world_camera.as_matrix(), rtol=0, atol=1e-12)


def test_a_lesson_is_a_scene_too(lesson, views):
    for before, after in zip(views, view_directory.load_views(lesson), strict=True):
        assert np.array_equal(before.gray, after.image)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("views",), [], "views"),
        (("views", 0, "T_world_camera"), ..., r"views\[0\]\.T_world_camera"),
        (("views", 0, "T_part_camera"), np.eye(4).tolist(), r"views\[0\]\.T_part_camera"),
        (("views", 0, "T_world_camera", 3), [0, 0, 1, 1], r"views\[0\]\.T_world_camera"),
        (("unit",), "mm", "unit"),
        (("scene",), "bin", "scene"),
    ],
    ids=str,
)
def test_a_wrong_description_of_a_scene_is_refused(path, value, named, tmp_path, views):
    view_directory.save_views(tmp_path, views)
    described(tmp_path, path, value)
    with pytest.raises(FileFormatError, match=rf"views\.json: {named}: got"):
        view_directory.load_views(tmp_path)


def test_a_directory_without_a_description_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"views\.json.*docs/vision\.md"):
        view_directory.load_views(tmp_path)
