"""Studies as part of the configuration; old results keep their hashes."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from benchmark.config import PRESETS, EpisodeConfig, SweepConfig, Variant, as_fields, episodes, preset
from benchmark.records.store import RecordWriter, read_config, read_records
from benchmark.strict_json import decode
from benchmark.world.sensor import SENSORS, sensor_config, with_hand_eye_error
from vision.errors import FileFormatError, InputError

REFERENCE = Path(__file__).resolve().parents[2] / "results" / "table1"
STUDIES = ("calibration", "teaching")


def test_reference_records_are_those_of_the_preset_and_would_be_resumed():
    config, records = read_config(REFERENCE), read_records(REFERENCE)
    assert config == preset("table1", workers=config.workers)
    hashes = {episode.key: episode.config_hash for episode in episodes(config)}
    assert {record.key: record.config_hash for record in records} == hashes


def test_a_sweep_of_the_first_version_is_read_and_keeps_its_hash():
    fields = {"parts": ["hub", "cover1", "cover2"], "scenes": 35, "pieces": 4, "sensor": "lab", "localizer": "focal"}
    fields |= {"views": 3, "seed": 0, "task": "pick", "workers": 2}
    config = decode(SweepConfig, fields, "x")
    assert as_fields(config) == {**fields, "parts": tuple(fields["parts"])}
    assert config.config_hash == "7551527bc8eafb2c0f537b9310815238935bc76acaa78ba0dbafa6629dce7811"


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_comes_back_from_its_file(name, tmp_path):
    config = preset(name)
    with RecordWriter(tmp_path, config):
        pass
    assert read_config(tmp_path) == config


@pytest.mark.parametrize("name", STUDIES)
def test_every_variant_of_a_scene_is_an_episode_of_its_own_with_the_same_seed(name):
    plan = episodes(preset(name, scenes=2, parts=("hub",)))
    assert len({episode.key for episode in plan}) == len({e.config_hash for e in plan}) == len(plan)
    assert len({(episode.scene, episode.seed) for episode in plan}) == 2
    assert {episode.task for episode in plan} == {"none"}


def test_calibration_goes_from_0_to_2_mm_and_teaching_over_clicks_and_views():
    assert [v.hand_eye_mm for v in preset("calibration").variants] == [0, 0.25, 0.5, 1, 1.5, 2]
    taught = {(v.click_sigma_px, v.taught_views) for v in preset("teaching").variants}
    assert taught == {(click, views) for click in (0, 1, 2, 3, 5) for views in (2, 3, 4, 5)}


def test_heaps_have_as_many_pieces_as_their_seed_says():
    plan = episodes(preset("table1"))
    counts = Counter(episode.pieces for episode in plan)
    assert set(counts) == {4, 5, 6}
    assert min(counts.values()) >= 20  # of 105; 35 are expected
    again = {episode.key: episode.pieces for episode in episodes(preset("table1", parts=("cover1",), scenes=3))}
    assert again.items() <= {episode.key: episode.pieces for episode in plan}.items()
    assert {episode.pieces for episode in episodes(preset("heap"))} == {8, 9, 10, 11, 12}


def test_a_range_of_pieces_is_stored_and_one_number_is_none(tmp_path):
    config = preset("heap")
    with RecordWriter(tmp_path, config):
        pass
    assert read_config(tmp_path) == config
    assert "most_pieces" in as_fields(config)
    five = SweepConfig(("hub",), pieces=5, most_pieces=5)
    assert five == SweepConfig(("hub",), pieces=5)
    assert "most_pieces" not in as_fields(five)
    assert (config.pieces_in_words, five.pieces_in_words) == ("8 to 12", "5")


@pytest.mark.parametrize("most", [3, 13, True])
def test_a_range_of_pieces_that_makes_no_sense_is_refused(most):
    with pytest.raises(InputError, match=r"most pieces: got .*a whole number, from 4 to 12"):
        SweepConfig(("hub",), pieces=4, most_pieces=most)


def test_another_study_in_the_directory_is_refused_by_name(tmp_path):
    with RecordWriter(tmp_path, preset("calibration")):
        pass
    changed = replace(preset("calibration"), variants=(Variant(hand_eye_mm=3),))
    with pytest.raises(InputError, match=r"variants=hand-eye-0mm,.*expected variants=hand-eye-3mm"):
        RecordWriter(tmp_path, changed)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"hand_eye_mm": -1.0}, "hand_eye_mm: got -1.0"),
        ({"hand_eye_mm": float("nan")}, "hand_eye_mm: got nan"),
        ({"click_sigma_px": 1.0}, "both or neither"),
        ({"taught_views": 3}, "both or neither"),
        ({"click_sigma_px": 1.0, "taught_views": 6}, "taught_views: got 6; expected a whole number, from 2 to 5"),
    ],
)
def test_a_variant_that_makes_no_sense_is_refused(fields, message):
    with pytest.raises(InputError, match=message):
        Variant(**fields)


def test_whole_and_decimal_numbers_make_the_same_episode():
    sweep = SweepConfig(("hub",))
    whole, decimal = (sweep.episode("hub", 0, Variant(hand_eye_mm=error)) for error in (1, 1.0))
    assert whole.config_hash == decimal.config_hash


def test_equal_variants_are_refused():
    with pytest.raises(InputError, match="variants: got hand-eye-1mm, hand-eye-1mm"):
        SweepConfig(("hub",), variants=(Variant(hand_eye_mm=1), Variant(hand_eye_mm=1.0)))


def test_a_missing_field_that_files_always_had_is_still_an_error():
    fields = json.loads(json.dumps(as_fields(EpisodeConfig(("hub",)))))
    assert decode(EpisodeConfig, fields, "x") == EpisodeConfig(("hub",))
    del fields["sensor"]
    with pytest.raises(FileFormatError, match="field sensor: got nothing"):
        decode(EpisodeConfig, fields, "x")


def test_hand_eye_error_turns_as_much_as_the_shopfloor_pairs_it():
    shopfloor = SENSORS["shopfloor"]
    same = with_hand_eye_error(shopfloor, shopfloor.hand_eye_translation_m)
    assert same == shopfloor
    lab = with_hand_eye_error(sensor_config("lab"), 0.002)
    assert lab.hand_eye_translation_m == 0.002
    assert lab.hand_eye_rotation_rad == pytest.approx(4 * shopfloor.hand_eye_rotation_rad)
    assert replace(lab, hand_eye_translation_m=0.0, hand_eye_rotation_rad=0.0) == sensor_config("lab")
    assert with_hand_eye_error(sensor_config("lab"), 0.0) == sensor_config("lab")


def test_a_sweep_has_limits_that_its_file_can_hold_and_its_table_can_count() -> None:
    with pytest.raises(InputError, match="seed: got 9223372036854775808; expected a whole number, from 0 to"):
        SweepConfig(("hub",), scenes=1, seed=2**63)
    parts = tuple(f"part{i}" for i in range(40))
    with pytest.raises(InputError, match=r"episodes .*: got 4000000; expected a whole number, from 1 to 1000000"):
        SweepConfig(parts, scenes=100_000)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_what_is_planned_is_counted_without_making_it(name: str) -> None:
    assert preset(name).planned == len(episodes(preset(name)))
