"""Real episodes, from the drop to the verdict."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmark.config import EpisodeConfig
from benchmark.episodes.cells import CellPool, bin_stations
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.records.episode_record import to_json, vision_stage
from benchmark.world.scene import cell_config

pytestmark = pytest.mark.sweep

SEEDS = {"hub": 10_101, "cover1": 10_102, "cover2": 10_103}


def config(part, **changes):
    fields = {"seed": SEEDS[part], "sensor": "lab", "localizer": "focal", "task": "none"} | changes
    return EpisodeConfig((part,), **fields)


@pytest.fixture(scope="module")
def records():
    """One finished episode of every part."""
    return {part: run_episode(config(part)) for part in SEEDS}


@pytest.mark.parametrize("part", SEEDS)
def test_a_piece_is_found_within_a_millimetre(part, records):
    record = records[part]
    found = [p.results["focal"].errors.translation_mm for p in record.pieces if p.results["focal"].matched]
    assert found
    assert min(found) < 1.0


@pytest.mark.parametrize("part", SEEDS)
def test_the_record_tells_what_was_run_and_what_became_of_each_piece(part, records):
    record, asked = records[part], config(part)
    assert record.error is None
    assert (record.key, record.seed, record.config_hash) == (asked.key, asked.seed, asked.config_hash)
    assert len(record.pieces) == asked.pieces
    assert record.picks == ()
    assert set(record.false_positives) == {"focal-region", "focal-group", "focal"}
    for piece in record.pieces:
        assert set(piece.results) == {"focal-region", "focal-group", "focal"}
        assert 0 <= piece.visibility <= 1
        assert (piece.failed_stage is None) == (piece.in_bin and piece.results["focal"].matched)
        for result in piece.results.values():
            assert (result.errors is not None) == result.matched


def test_others_look_at_the_same_pictures_and_change_nothing(records):
    record = run_episode(config("cover1", compared=("previous", "oracle")))
    assert [p.visibility for p in record.pieces] == [p.visibility for p in records["cover1"].pieces]
    assert set(record.false_positives) == {"focal-region", "focal-group", "focal", "previous", "oracle"}
    for piece, alone in zip(record.pieces, records["cover1"].pieces, strict=True):
        assert piece.results["focal"] == alone.results["focal"]
        assert piece.failed_stage == alone.failed_stage
        assert piece.results["oracle"].matched
    assert record.timings_s.keys() >= {"vision", vision_stage("previous"), vision_stage("oracle")}
    assert any(piece.results["previous"].extracted for piece in record.pieces)


def test_the_oracle_matches_every_piece_without_error(records):
    record = run_episode(config("cover1", localizer="oracle"))
    assert [p.visibility for p in record.pieces] == [p.visibility for p in records["cover1"].pieces]
    for piece in record.pieces:
        assert piece.results["oracle"].matched
        assert piece.results["oracle"].errors.translation_mm < 1e-6
    assert record.false_positives == {"oracle": 0}


def test_a_seed_gives_the_same_record_again_and_an_observer_changes_nothing(records):
    class Notes(EpisodeObserver):
        def __init__(self):
            self.told = []

        def begin(self, cell, config):
            self.told.append("begin")

        def looked(self, index, view):
            self.told.append(view.name)

        def localized(self, localization, verdict):
            self.told.append(f"localized {len(localization.estimates)} {len(verdict.owner)}")

    notes = Notes()
    record = run_episode(config("cover1"), notes)
    matched = sum(p.results["focal"].matched for p in record.pieces)
    estimates = matched + record.false_positives["focal"]
    assert notes.told == ["begin", "view 1", "view 2", "view 3", f"localized {estimates} {estimates}"]
    assert to_json(replace(record, timings_s={})) == to_json(replace(records["cover1"], timings_s={}))


def test_a_bin_that_fits_into_one_picture_has_one_station():
    for part in ("hub", "cover1", "cover2"):
        assert bin_stations(cell_config((part,))).tolist() == [[0.0, 0.0]]


def test_a_bin_larger_than_a_picture_is_photographed_from_several_stations():
    longer_lens = replace(cell_config(("cover2",), 4), focal_length_m=0.022)
    cells = CellPool(lambda *_: longer_lens)
    places = bin_stations(longer_lens)
    watcher = Watcher()
    record = run_episode(EpisodeConfig(("cover2",), seed=10_000, views=2, task="none"), watcher, cells=cells)
    cells.close()
    assert len(places) > 1
    assert len(watcher.views) == 2 * len(places)
    assert sum(piece.results["focal"].matched for piece in record.pieces) >= 3


class Watcher(EpisodeObserver):
    def __init__(self):
        self.views = []

    def looked(self, index, view):
        self.views.append(view)
