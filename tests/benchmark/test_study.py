"""The curves of a study from constructed records with known answers."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest
from rich.console import Console

from benchmark.cli import main
from benchmark.config import EpisodeConfig, SweepConfig, Variant, episodes
from benchmark.episodes.metrics import Summary
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PieceRecord, PoseErrors
from benchmark.records.store import RecordWriter
from benchmark.report.circle_errors import CircleErrors
from benchmark.report.study import Crossing, Study, build_study, last_within, study_to_dict
from benchmark.report.study_figures import save_study_figures
from benchmark.report.study_text import print_study, study_as_markdown

CALIBRATION = SweepConfig(
    ("hub", "cover2"), scenes=2, task="none", variants=tuple(Variant(hand_eye_mm=e) for e in (0, 1, 2))
)
TEACHING = SweepConfig(
    ("hub",),
    scenes=2,
    task="none",
    variants=tuple(Variant(click_sigma_px=c, taught_views=v) for v in (5, 2) for c in (0, 5)),
)
MISS = LocalizerResult(True, False)


def hit(translation_mm: float, rotation_deg: float) -> LocalizerResult:
    return LocalizerResult(True, True, PoseErrors(translation_mm, rotation_deg, None, rotation_deg, translation_mm))


def recorded(config: EpisodeConfig, *results: LocalizerResult) -> EpisodeRecord:
    pieces = tuple(
        PieceRecord(i, config.parts[0], 0.9, True, dict.fromkeys(("focal-region", "focal-group", "focal"), r))
        for i, r in enumerate(results)
    )
    return EpisodeRecord(config.key, config.parts, config.scene, config.seed, config.config_hash, pieces=pieces)


def calibrated(config: EpisodeConfig) -> EpisodeRecord:
    """Errors of 4 mm and 1 degree per mm of hand-eye error, in scenes 0 and 1 as much below as above."""
    error = config.variant.hand_eye_mm
    sign = 1 if config.scene else -1
    found = hit(max(4 * error + 0.1 * sign, 0.0), error)
    return recorded(config, found, found, found, MISS if error == 2 else found)


def taught(config: EpisodeConfig) -> EpisodeRecord:
    is_bad = config.variant == Variant(click_sigma_px=5, taught_views=2)
    return recorded(config, hit(0.1, 0.1), MISS if is_bad else hit(0.3, 0.3))


def calibration() -> Study:
    return build_study(CALIBRATION, [calibrated(config) for config in episodes(CALIBRATION)])


def teaching() -> Study:
    circles = {
        (TEACHING.variants[0], "hub"): CircleErrors(*(Summary(4, mean, 0.5, mean) for mean in (1.5, 2.5, 3.5)))
    }
    refused = {"clicks-5px-2views/hub": "no agreement"}
    return build_study(TEACHING, [taught(c) for c in episodes(TEACHING)], refused, circles)


def shown(study: Study) -> str:
    with open("/dev/null", "w") as nowhere:
        console = Console(width=120, record=True, file=nowhere)
        print_study(study, console)
    return console.export_text()


def test_each_variant_has_its_own_point():
    curve = calibration().curve("hub", "focal")
    assert [point.variant.hand_eye_mm for point in curve] == [0, 1, 2]
    assert [(point.half_visible.n, point.half_visible.successes) for point in curve] == [(8, 8), (8, 8), (8, 6)]
    assert [point.errors["translation_mm"].mean for point in curve] == pytest.approx([0.05, 4.0, 8.0])
    assert [point.errors["rotation_deg"].mean for point in curve] == pytest.approx([0, 1, 2])


def test_the_calibration_that_meets_table_1_is_interpolated():
    hub, _, _, cover, *_ = calibration().calibration_limits
    assert (hub.part, hub.method, hub.published.translation_mm_mean) == ("hub", "focal", 3.4)
    assert hub.translation == Crossing(pytest.approx((3.4 - 0.05) / (4 - 0.05)))
    assert hub.rotation == Crossing(2, is_beyond=True)
    assert hub.both == hub.translation
    assert hub.matched == 1.0
    assert (cover.part, cover.published.translation_mm_mean) == ("cover2", 1.9)


def test_processes_are_held_to_their_own_rows():
    published = {
        (limit.part, limit.method): limit.published.translation_mm_mean for limit in calibration().calibration_limits
    }
    assert published["hub", "focal-group"] == 3.5
    assert published["cover2", "focal-region"] == 2.2


@pytest.mark.parametrize(
    ("y", "limit", "crossing"),
    [
        ([0, 1, 3], 2, Crossing(1.5)),
        ([0, 1, 3], 1, Crossing(1.0)),
        ([0, 3, 1], 2, Crossing(pytest.approx(2 / 3))),
        ([0, 1, 2], 2, Crossing(2, is_beyond=True)),
        ([3, 1, 0], 2, Crossing(None)),
        ([1, None, 1], 2, Crossing(0)),
        ([None, 1, 1], 2, Crossing(None)),
        ([], 2, Crossing(None)),
    ],
)
def test_a_curve_meets_a_limit_until_it_first_rises_above(y, limit, crossing):
    assert last_within([0, 1, 2][: len(y)], y, limit) == crossing


def test_matched_share_is_taken_where_the_limit_is():
    records = [
        recorded(c, hit(2 * c.variant.hand_eye_mm, 0), MISS if c.variant.hand_eye_mm == 2 else hit(0, 0))
        for c in episodes(CALIBRATION)
    ]
    (hub, *_) = build_study(CALIBRATION, records).calibration_limits
    # Means of the matched pieces are 0, 1 and 4 mm, and 100, 100 and 50 % are matched: 3.4 mm is at 1.8 mm.
    assert hub.both.at == pytest.approx(1.8)
    assert hub.matched == pytest.approx(0.6)


def test_text_of_a_calibration_has_the_curve_and_the_limits():
    text = shown(calibration())
    (row,) = (line.split() for line in text.splitlines() if line.startswith(" Hub") and "focal" in line)
    assert row == ["Hub", "focal", "3.4", "0.85", "11.3", ">", "2", "0.85", "100%"]
    assert "4.00 ± 0.11" in text
    assert max(map(len, text.splitlines())) <= 120


def test_text_of_a_teaching_has_a_column_for_each_number_of_views():
    text = shown(teaching())
    rows = [line.split() for line in text.splitlines()]
    assert ["Object", "Clicks", "(px)", "2", "views", "5", "views"] in rows
    assert ["Hub", "0", *(2 * ["0.200", "±", "0.115,", "0.200"])] in rows
    assert ["5", "0.100", "±", "0.000,", "0.100", "0.200", "±", "0.115,", "0.200"] in rows
    assert ["Hub", "0", "–", "1.500", "±", "0.500,", "1.500"] in rows  # the centres of the one model that there is
    assert ["Hub", "0", "–", "2.500", "±", "0.500,", "2.500"] in rows  # and its radii
    assert "clicks-5px-2views/hub (no agreement)" in " ".join(text.split())


def test_a_teaching_that_was_refused_counts_as_nothing_found():
    records = [taught(c) if c.variant.taught_views == 5 else recorded(c, MISS, MISS) for c in episodes(TEACHING)]
    curve = {p.variant.name: p for p in build_study(TEACHING, records).curve("hub", "focal")}
    assert curve["clicks-5px-2views"].half_visible.rate == 0.0
    assert curve["clicks-5px-2views"].errors["translation_mm"].mean is None
    assert curve["clicks-5px-5views"].half_visible.rate == 1.0


def test_missing_and_failed_episodes_are_reported():
    first, *rest = episodes(CALIBRATION)
    failed = EpisodeRecord(first.key, first.parts, 0, first.seed, first.config_hash, error="ZeroDivisionError: x")
    study = build_study(CALIBRATION, [failed, *map(calibrated, rest[:3])])
    for text in (shown(study), study_as_markdown(study)):
        assert "Incomplete: 4 of 12 episodes" in text
        assert "hub/000/hand-eye-0mm: ZeroDivisionError: x" in text


@pytest.mark.parametrize("study", [calibration(), teaching(), build_study(CALIBRATION, [])])
def test_json_has_every_point_of_every_method(study):
    values = json.loads(json.dumps(study_to_dict(study), allow_nan=False))
    methods = {curve["method"] for curve in values["curves"]}
    assert methods in ({"focal"}, {"focal-region", "focal-group", "focal"})
    assert len(values["curves"]) == len(methods) * len(study.parts) * len(study.config.variants)
    assert values["config_hash"] == study.config.config_hash


@pytest.mark.parametrize(
    ("study", "name"),
    [
        (calibration(), "calibration.png"),
        (teaching(), "teaching.png"),
        (build_study(CALIBRATION, []), "calibration.png"),
    ],
)
def test_figures_are_drawn(study, name, tmp_path):
    (path,) = save_study_figures(study, tmp_path / "new")
    assert path == tmp_path / "new" / name
    assert matplotlib.image.imread(path).std() > 0.05


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    with RecordWriter(tmp_path, CALIBRATION) as writer:
        for config in episodes(CALIBRATION):
            writer.append(calibrated(config))
    return tmp_path


def test_table_prints_a_study_in_every_format(directory, capsys):
    assert main(["table", str(directory), "--figures", str(directory)]) == 0
    assert "hand-eye error" in capsys.readouterr().out
    assert (directory / "calibration.png").exists()
    assert main(["table", str(directory), "--format", "md"]) == 0
    assert "| Alternator Cover 2 | focal |" in capsys.readouterr().out
    assert main(["table", str(directory), "--format", "json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["calibration_limits"]) == 6


def test_a_study_has_no_thresholds(directory, capsys):
    thresholds = Path(__file__).resolve().parents[2] / "benchmark" / "thresholds" / "smoke.toml"
    assert main(["check", str(directory), "--thresholds", str(thresholds)]) == 2
    assert "got a study" in capsys.readouterr().err
