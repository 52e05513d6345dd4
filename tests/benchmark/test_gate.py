from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmark.config import SweepConfig
from benchmark.records.episode_record import (
    EpisodeRecord,
    LocalizerResult,
    NormalizedError,
    PickRecord,
    PieceRecord,
    PoseErrors,
)
from benchmark.report.gate import Verdict, check, read_thresholds
from benchmark.report.tables import build_table
from vision.errors import FileFormatError, InputError

CONFIG = SweepConfig(parts=("hub",), scenes=1)
ERRORS = PoseErrors(0.8, 1.0, None, 1.0, 2.0)
RESULTS = [{"focal": LocalizerResult(True, True, ERRORS, NormalizedError(e, 5))} for e in (1.0, 3.0, 5.0, 40.0)]
EPISODE = CONFIG.episode("hub", 0)
RECORD = EpisodeRecord(
    key=EPISODE.key,
    parts=("hub",),
    scene=0,
    seed=EPISODE.seed,
    config_hash=EPISODE.config_hash,
    pieces=tuple(PieceRecord(i, "hub", 0.9, True, result) for i, result in enumerate(RESULTS)),
    picks=(PickRecord(True, 0, True),),
    false_positives={"focal": 1},
)  # four of four matched: the lower bound is 51 %; three of four inside their ellipsoid; one of five poses is false


def judge(tmp_path: Path, text: str, *records: EpisodeRecord) -> dict[str, Verdict]:
    file = tmp_path / "thresholds.toml"
    file.write_text(text)
    thresholds = read_thresholds(file)
    table = build_table(CONFIG, records or [RECORD], (thresholds.min_visibility,))
    return {verdict.limit.name: verdict for verdict in check(table, thresholds)}


@pytest.mark.parametrize(
    ("section", "key", "good", "bad"),
    [
        ("focal.hub", "matching_rate_low", 0.5, 0.52),
        ("focal.hub", "extraction_rate_low", 0.5, 0.52),
        ("focal.hub", "translation_mm_mean", 0.81, 0.79),
        ("focal.hub", "translation_mm_median", 0.81, 0.79),
        ("focal.hub", "tilt_deg_mean", 1.0, 0.9),
        ("focal.hub", "false_poses_max", 0.21, 0.19),
        ("focal.hub", "coverage_min", 0.75, 0.76),
        ("focal.hub", "coverage_max", 0.75, 0.74),
        ("picks.hub", "rate_low", 0.2, 0.21),
    ],
)
def test_a_threshold_is_met_or_missed(tmp_path: Path, section: str, key: str, good: float, bad: float) -> None:
    name = f"{section}.{key}"
    assert judge(tmp_path, f"[{section}]\n{key} = {good}")[name].passed
    verdict = judge(tmp_path, f"[{section}]\n{key} = {bad}")[name]
    assert not verdict.passed
    assert verdict.shortfall == pytest.approx(abs(verdict.value - bad))
    assert str(verdict).startswith(f"{name}: ")
    assert "missed by" in str(verdict)


@pytest.mark.parametrize("section", ["focal.cover1", "focal-region.hub", "focal-group.hub"])
def test_an_empty_sample_misses_every_threshold(tmp_path: Path, section: str) -> None:
    verdicts = judge(tmp_path, f"[{section}]\nmatching_rate_low = 0.0\ntranslation_mm_mean = 99")
    for key in ("matching_rate_low", "translation_mm_mean"):
        assert not verdicts[f"{section}.{key}"].passed
        assert "nothing measured" in str(verdicts[f"{section}.{key}"])


def test_records_without_covariances_miss_a_coverage(tmp_path: Path) -> None:
    old = tuple(replace(piece, results={"focal": LocalizerResult(True, True, ERRORS)}) for piece in RECORD.pieces)
    verdict = judge(tmp_path, "[focal.hub]\ncoverage_max = 1.0", replace(RECORD, pieces=old))[
        "focal.hub.coverage_max"
    ]
    assert (verdict.passed, verdict.value, verdict.n) == (False, None, 0)


def test_a_visibility_of_its_own(tmp_path: Path) -> None:
    text = "min_visibility = 0.95\n[focal.hub]\nmatching_rate_low = 0.1"
    assert judge(tmp_path, text)["focal.hub.matching_rate_low"].n == 0


def test_failed_and_missing_episodes_miss_unless_allowed(tmp_path: Path) -> None:
    failed = replace(RECORD, error="x", pieces=())
    assert not judge(tmp_path, "", failed)["episodes.failed"].passed
    assert judge(tmp_path, "[episodes]\nfailed = 1", failed)["episodes.failed"].passed
    assert judge(tmp_path, "")["episodes.missing"].passed
    stranger = replace(CONFIG, scenes=3)
    file = tmp_path / "thresholds.toml"
    verdicts = check(build_table(stranger, [RECORD]), read_thresholds(file))
    assert {v.limit.key: v.value for v in verdicts}["missing"] == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[focal.hub]\nmatch_rate = 0.5",
            r"focal.hub.match_rate: got an unknown key; expected one of .*matching_rate_low",
        ),
        ("[picks.hub]\nmatching_rate_low = 0.5", r"expected one of rate_low"),
        ("[episodes]\nlost = 0", r"expected one of failed, missing"),
        ("visibility = 0.5", r"visibility: got an unknown key"),
        ("[focal]\nmatching_rate_low = 0.5", r"a section \[focal.PART\]"),
        ("[focal.hub]\nmatching_rate_low = 'high'", r"got 'high'; expected a number"),
        ("[focal.hub]\nmatching_rate_low = true", r"expected a number"),
        (
            "[duel.hub]\nmatching_rate_low = 0.5",
            r"got duel; expected one of previous, paper, focal-region, focal-group, focal, picks",
        ),
        ("[focal.hat]\nmatching_rate_low = 0.5", r"got hat; expected one of hub, cover1, cover2"),
        ("min_visibility = 2", r"a share from 0 to 1"),
        ("[focal.hub", r"expected TOML"),
    ],
)
def test_a_wrong_file_is_refused_with_what_would_be_right(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        judge(tmp_path, text)


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="readable"):
        read_thresholds(tmp_path / "none.toml")


@pytest.mark.parametrize("file", sorted((Path(__file__).parents[2] / "benchmark" / "thresholds").glob("*.toml")))
def test_every_file_is_valid_and_bounds_the_false_poses_of_every_part(file: Path) -> None:
    thresholds = read_thresholds(file)
    assert len(check(build_table(CONFIG, [RECORD]), thresholds)) == len(thresholds.limits) > 6
    limited = {limit.part for limit in thresholds.limits if limit.key == "false_poses_max"}
    assert limited == {"hub", "cover1", "cover2"}
