"""The try-it button's work, with the belt pulley."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.lessons.model_trial import FALSE_COLOUR, MISSED_COLOUR, try_in_views, try_model
from benchmark.models import load_model
from tests.parts.belt_pulley import MESH
from tests.parts.taught_pulley import recorded
from vision.drawing.strokes import SALIENT_COLOUR
from vision.errors import InputError
from vision.teaching.session import build_model

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model():
    return build_model(*recorded())


@pytest.fixture(scope="module")
def scenes(model):
    reported = []
    outcomes = try_model(model, str(MESH), 2, seed=1, report=reported.append)
    assert tuple(reported) == outcomes
    return outcomes


def shows(picture, colour):
    return (np.abs(picture.astype(int) - colour).max(axis=2) <= 4).sum() > 20


def test_most_pieces_are_hit_and_their_errors_small(scenes):
    pieces = [piece for scene in scenes for piece in scene.pieces]
    hits = [p for p in pieces if p.status == "hit"]
    assert len([p for p in pieces if p.status != "false alarm"]) == 8
    assert len(hits) >= 7
    assert all(0 < p.visible <= 1 for p in hits)
    assert np.median([p.translation_mm for p in hits]) < 0.15
    assert np.median([p.rotation_deg for p in hits]) < 0.5


def test_scenes_are_numbered_and_drawn(scenes):
    assert [scene.number for scene in scenes] == [1, 2]
    for scene in scenes:
        assert all(piece.scene == scene.number for piece in scene.pieces)
        assert scene.picture.shape == (480, 640, 3)
        assert scene.picture.dtype == np.uint8
        assert shows(scene.picture, SALIENT_COLOUR)
        assert shows(scene.picture, FALSE_COLOUR) == any(p.status == "false alarm" for p in scene.pieces)
    assert not np.array_equal(scenes[0].picture, scenes[1].picture)


def test_the_seed_decides(model, scenes):
    again = try_model(model, str(MESH), 1, seed=1)
    assert again[0].pieces == scenes[0].pieces
    other = try_model(model, str(MESH), 1, seed=2)
    assert other[0].pieces != scenes[0].pieces


def test_a_model_that_is_wrong_misses(model):
    """Taught with circles a third too large, the pulley is nowhere."""
    large = replace(
        model,
        features=tuple(
            replace(f, circle=replace(f.circle, radius_m=1.3 * f.circle.radius_m)) for f in model.features
        ),
    )
    (scene,) = try_model(large, str(MESH), 1, seed=1)
    missed = [p for p in scene.pieces if p.status == "miss"]
    assert len(missed) == 4
    assert all(p.visible > 0 and p.translation_mm is None for p in missed)
    assert shows(scene.picture, MISSED_COLOUR)


def test_what_the_listener_raises_ends_the_trial(model):
    heard = []

    def stop(scene):
        heard.append(scene.number)
        raise KeyError("stop")

    with pytest.raises(KeyError):
        try_model(model, str(MESH), 5, seed=1, report=stop)
    assert heard == [1]


def test_parts_of_the_benchmark_are_tried_under_their_own_name():
    (scene,) = try_model(replace(load_model("cover2"), part="what the person called it"), "cover2", 1, seed=4)
    assert sum(p.status == "hit" for p in scene.pieces) >= 3


def test_unknown_part_is_refused(model):
    with pytest.raises(InputError, match="hub, cover1, cover2, or a mesh file"):
        try_model(model, "hat", 1, seed=0)


def test_without_a_mesh_the_taught_pictures_serve(model):
    heard = []
    outcomes = try_in_views(model, recorded()[1], 4, seed=0, report=heard.append)
    assert tuple(heard) == outcomes
    hits = [p for scene in outcomes for p in scene.pieces if p.status == "hit"]
    assert len(hits) == 4
    assert max(p.translation_mm for p in hits) < 0.3
    assert max(p.rotation_deg for p in hits) < 0.3
    front, back = outcomes[0].picture, outcomes[1].picture
    assert front.shape == back.shape == (480, 640, 3)
    assert not np.array_equal(front, back)


def test_a_wrong_model_is_not_found_in_the_taught_pictures(model):
    large = replace(
        model,
        features=tuple(
            replace(f, circle=replace(f.circle, radius_m=1.3 * f.circle.radius_m)) for f in model.features
        ),
    )
    outcomes = try_in_views(large, recorded()[1], 1, seed=0)
    assert outcomes[0].pieces[0].status == "miss"


def test_single_pictures_are_too_few(model):
    front, *_, back = recorded()[1]
    with pytest.raises(InputError, match="at least two of one face"):
        try_in_views(model, [front, back], 1, seed=0)
