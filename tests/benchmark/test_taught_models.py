"""A study's models: taught once, kept, loaded; a refused teaching is an outcome."""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest

import benchmark.study.taught_models
from benchmark.config import EpisodeConfig, SweepConfig, Variant, episodes
from benchmark.episodes.episode import run_episode
from benchmark.episodes.sweep import run_sweep
from benchmark.models import load_model
from benchmark.study.taught_models import NothingTaught, model_path, refusals, taught_models, teach_variants
from vision.errors import InputError
from vision.localizer import Localizer
from vision.model.model_file import model_to_json

GOOD, BAD = Variant(click_sigma_px=1, taught_views=5), Variant(click_sigma_px=5, taught_views=2)
CONFIG = SweepConfig(("cover1",), scenes=1, task="none", seed=4, variants=(Variant(hand_eye_mm=1), GOOD, BAD))


@pytest.fixture
def taught(monkeypatch):
    """The operators that taught, in order; teaching takes seconds and is replaced by the shipped models."""
    operators = []

    def teach(part, operator):
        operators.append((part, operator))
        if operator.click_sigma_px > 3:
            raise InputError("clicks", got="nonsense", expected="agreement")
        return load_model(part)

    monkeypatch.setattr(benchmark.study.taught_models, "teach", teach)
    return operators


def test_models_are_taught_once_and_loaded(taught, tmp_path):
    progress = []
    for _ in range(2):
        teach_variants(CONFIG, tmp_path, lambda done, total: progress.append((done, total)))
    assert [(part, o.click_sigma_px, o.views, o.seed) for part, o in taught] == [
        ("cover1", 1, 5, 4),
        ("cover1", 5, 2, 4),
    ]
    assert progress == [(1, 2), (2, 2)] * 2
    (model,) = taught_models(tmp_path, GOOD, ("cover1",))
    assert model_to_json(model) == model_to_json(load_model("cover1"))
    assert model_path(tmp_path, GOOD, "cover1") == tmp_path / "models" / "clicks-1px-5views" / "cover1.json"


def test_a_refused_teaching_leaves_its_reason_and_no_model(taught, tmp_path):
    teach_variants(CONFIG, tmp_path)
    assert taught_models(tmp_path, BAD, ("cover1",)) == []
    assert refusals(tmp_path) == {"clicks-5px-2views/cover1": "clicks: got nonsense; expected agreement"}
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["cover1.json", "cover1.refused.txt"]


def test_models_that_were_never_taught_are_an_error(tmp_path):
    with pytest.raises(InputError, match="Teach the part first"):
        taught_models(tmp_path, GOOD, ("cover1",))


def test_untaught_is_a_localizer_that_finds_nothing():
    localizer = NothingTaught("focal")
    assert isinstance(localizer, Localizer)
    assert localizer.localize([]).estimates == ()


def test_an_episode_of_a_taught_variant_needs_its_directory():
    (config,) = (c for c in episodes(CONFIG) if c.variant == GOOD)
    with pytest.raises(InputError, match="models of variant clicks-1px-5views: got none"):
        run_episode(config)


@pytest.mark.sweep
@pytest.mark.slow
def test_a_study_runs_and_resumes_with_the_models_of_its_variants(taught, tmp_path):
    run = functools.partial(run_episode, study=tmp_path)
    records = run_sweep(CONFIG, tmp_path, run, prepare=lambda: teach_variants(CONFIG, tmp_path))
    assert [record.error for record in records] == [None] * 3
    by_variant = {record.key.rpartition("/")[2]: record for record in records}
    shipped = run_episode(EpisodeConfig(("cover1",), seed=CONFIG.episode("cover1", 0).seed, task="none"))
    assert by_variant["clicks-1px-5views"].pieces == shipped.pieces
    assert not any(piece.results["focal"].matched for piece in by_variant["clicks-5px-2views"].pieces)
    found = {
        name: [p.results["focal"].errors.translation_mm for p in record.pieces if p.results["focal"].matched]
        for name, record in by_variant.items()
    }
    assert min(found["hand-eye-1mm"]) > max(found["clicks-1px-5views"])  # one calibration error moves all pieces
    again = run_sweep(CONFIG, tmp_path, run)
    assert [replace(r, timings_s={}) for r in again] == [replace(r, timings_s={}) for r in records]
    assert len(taught) == 2
