from __future__ import annotations

import json
import random
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import pytest
from rich.console import Console

from benchmark.config import SweepConfig, episodes
from benchmark.episodes.metrics import wilson_interval
from benchmark.records.episode_record import (
    EpisodeRecord,
    LocalizerResult,
    NormalizedError,
    PickRecord,
    PieceRecord,
    PoseErrors,
)
from benchmark.report.figures import save_figures
from benchmark.report.table_text import as_markdown, print_table
from benchmark.report.tables import build_table, to_dict
from vision.errors import InputError

CONFIG = SweepConfig(parts=("cover2", "hub", "cover1"), scenes=1)
FOUND, MISSED = LocalizerResult(True, False), LocalizerResult(False, False)


def matched(translation_mm: float, tilt_deg: float = 1.0) -> LocalizerResult:
    return LocalizerResult(True, True, PoseErrors(translation_mm, tilt_deg, 0.5, 2 * tilt_deg, translation_mm))


def piece(
    index: int, visibility: float, part: str = "hub", in_bin: bool = True, **results: LocalizerResult
) -> PieceRecord:
    methods = {f"focal-{name}" if name in ("region", "group") else name: found for name, found in results.items()}
    failed = None if results.get("focal") != MISSED else "extraction"
    return PieceRecord(index, part, visibility, in_bin, methods, failed)


def record(kind: str = "hub", scene: int = 0, **fields: object) -> EpisodeRecord:
    config = CONFIG.episode(kind, scene)
    base = EpisodeRecord(config.key, config.parts, scene, config.seed, config.config_hash)
    return replace(base, **fields)


HUB = record(
    pieces=(
        piece(0, 0.9, region=matched(1.0), group=FOUND, previous=matched(1.0), paper=FOUND, focal=matched(1.0)),
        piece(
            1, 0.5, region=MISSED, group=matched(2.0), previous=MISSED, paper=matched(2.0), focal=matched(3.0, 2.0)
        ),
        piece(2, 0.2, region=matched(5.0), group=MISSED, previous=matched(5.0), paper=MISSED, focal=MISSED),
        piece(
            3,
            0.05,
            region=matched(50.0),
            group=matched(50.0),
            previous=matched(50.0),
            paper=matched(50.0),
            focal=matched(50.0),
        ),
        piece(4, 0.9, in_bin=False, region=MISSED, group=MISSED, previous=MISSED, paper=MISSED, focal=MISSED),
    ),
    picks=(PickRecord(True, 0, True), PickRecord(True, None, False, "grip"), PickRecord(False, None, False)),
    false_positives={"focal": 2},
)


def success(table: dict, **wanted: object) -> dict:
    (row,) = (r for r in table["fig10"] if all(r[k] == v for k, v in wanted.items()))
    return row


def test_rates_are_counted_over_what_is_visible_enough_and_in_the_bin() -> None:
    table = to_dict(build_table(CONFIG, [HUB]))
    row = success(table, part="hub", method="focal", stage="matching", min_visibility=0.5)
    assert (row["n"], row["successes"], row["rate"], row["published"]) == (2, 2, 1.0, None)
    assert success(table, part="hub", method="paper", stage="matching", min_visibility=0.5)["published"] == 0.77
    assert (row["low"], row["high"]) == wilson_interval(2, 2)
    row = success(table, part="hub", method="focal", stage="matching", min_visibility=0.1)
    assert (row["n"], row["successes"]) == (3, 2)
    row = success(table, part="hub", method="focal-region", stage="extraction", min_visibility=0.1)
    assert (row["n"], row["successes"], row["published"]) == (3, 2, None)
    row = success(table, part="hub", method="focal-group", stage="extraction", min_visibility=0.5)
    assert (row["n"], row["successes"]) == (2, 2)


def test_margin_of_focal_over_region_growing_is_over_the_same_pieces() -> None:
    scenes = [
        record(
            scene=i,
            pieces=(piece(0, 0.9, region=MISSED, focal=matched(1.0)), piece(1, 0.3, region=FOUND, focal=FOUND)),
        )
        for i in range(12)
    ]
    table = build_table(CONFIG, scenes)
    half, any_ = (m for m in to_dict(table)["margins"] if m["part"] == "hub")
    assert (half["min_visibility"], half["n"], half["method_only"], half["margin"]) == (0.5, 12, 12, 1.0)
    assert (any_["n"], any_["scenes"], any_["rival_only"], any_["margin"]) == (24, 12, 0, 0.5)
    assert half["excludes_zero"]
    (row,) = (line.split() for line in shown(table).splitlines() if line.lstrip().startswith("≥ 10%") and "+" in line)
    assert row[2:8] == ["Hub", "24", "12", "12", "0", "+50.0"]
    assert row[-1] == "yes"


def test_without_both_localizers_there_is_no_comparison_of_them() -> None:
    table = build_table(CONFIG, [record(pieces=(piece(0, 0.9, region=matched(1.0)),))])
    assert {margin["n"] for margin in to_dict(table)["margins"]} == {0}
    assert "Excludes zero" not in shown(table)
    assert "lost it" not in shown(table)


def test_what_one_extractor_lost_and_focal_matched_is_counted() -> None:
    hit, lost = matched(1.0), MISSED
    trios = [
        (hit, hit, hit),  # both extracted it
        (FOUND, FOUND, FOUND),
        (lost, hit, hit),  # region growing lost it
        (lost, FOUND, hit),
        (lost, FOUND, FOUND),
        (hit, lost, hit),  # edge grouping lost it
        (lost, lost, hit),  # an arc was enough
        (lost, lost, lost),
    ]
    pieces = tuple(piece(i, 0.9, region=r, group=g, focal=d) for i, (r, g, d) in enumerate(trios))
    unjudged = (piece(8, 0.9, region=lost, focal=hit), piece(9, 0.9, in_bin=False, region=lost, group=hit, focal=hit))
    table = build_table(CONFIG, [record(pieces=pieces + unjudged)])
    (row,) = (r for r in to_dict(table)["recovered"] if (r["part"], r["min_visibility"]) == ("hub", 0.5))
    counts = {name: (r["successes"], r["n"]) for name, r in {**row["extraction"], **row["matching"]}.items()}
    assert counts == {
        "both": (1, 2),
        "region_lost": (2, 3),
        "group_lost": (1, 1),
        "region_missed": (3, 6),
        "group_missed": (3, 6),
        "both_missed": (2, 5),
    }
    assert "2 of 3 (21% to 94%)" in shown(table)
    assert max(map(len, shown(table).splitlines())) <= 120


def believed(squared: float, components: int = 6) -> LocalizerResult:
    return replace(matched(1.0), normalized=NormalizedError(squared, components))


def test_coverage_is_the_share_of_matched_pieces_inside_the_ellipsoid() -> None:
    """The 95 % quantiles of chi-square are 12.59 for six components and 11.07 for five."""
    pieces = [believed(12.5), believed(12.7), believed(11.2, 5), believed(11.0, 5), matched(1.0), FOUND]
    table = build_table(CONFIG, [record(pieces=tuple(piece(i, 0.9, focal=p) for i, p in enumerate(pieces)))])
    (row,) = (
        r
        for r in to_dict(table)["accuracy"]
        if (r["part"], r["method"], r["min_visibility"]) == ("hub", "focal", 0.5)
    )
    assert (row["n"], row["coverage"]["n"], row["coverage"]["successes"]) == (5, 4, 2)
    assert (row["coverage"]["low"], row["coverage"]["high"]) == wilson_interval(2, 4)
    text = shown(table)
    lines = [line.split() for line in text[text.index("Inside the 95% ellipsoid") :].splitlines()]
    hub, cover1 = (next(line for line in lines if line[:1] == [word]) for word in ("Hub", "Alternator"))
    assert hub == ["Hub", "4", "50%", "(15%", "to", "85%)"]
    assert cover1[-2:] == ["0", "–"]


def test_table1_is_over_matched_pieces_of_the_paper_and_of_ours() -> None:
    table = to_dict(build_table(CONFIG, [HUB]))
    methods = ("previous", "paper", "focal")
    assert [(row["part"], row["method"]) for row in table["table1"]] == [
        (part, method) for part in ("hub", "cover1", "cover2") for method in methods
    ]
    previous, paper, focal = table["table1"][:3]
    assert (previous["n"], previous["translation_mm_mean"], previous["translation_mm_median"]) == (2, 3.0, 3.0)
    assert previous["translation_mm_std"] == pytest.approx(8**0.5)
    assert (previous["rotation_deg_mean"], previous["tilt_deg_mean"], previous["inplane_deg_mean"]) == (2.0, 1.0, 0.5)
    assert previous["published"] == {
        "translation_mm_mean": 3.4,
        "translation_mm_std": 1.9,
        "rotation_deg_mean": 11.3,
        "rotation_deg_std": 5.7,
    }
    assert (paper["n"], paper["translation_mm_mean"], paper["translation_mm_std"]) == (1, 2.0, None)
    assert paper["published"]["translation_mm_mean"] == 3.5
    assert focal["published"] is None


def test_empty_groups_are_null() -> None:
    table = to_dict(build_table(CONFIG, []))
    text = json.dumps(table, allow_nan=False)
    assert "NaN" not in text
    assert all(row["n"] == 0 and row["translation_mm_mean"] is None for row in table["table1"])
    assert all(row["rate"] is row["low"] is row["high"] is None for row in table["fig10"] + table["picks"])
    assert table["episodes"] == {"planned": 3, "recorded": 0, "failed": {}}


def test_what_is_in_no_rate_is_counted_apart() -> None:
    (count,) = (c for c in to_dict(build_table(CONFIG, [HUB]))["counts"] if c["part"] == "hub")
    assert (count["pieces"], count["out_of_bin"], count["barely_visible"]) == (5, 1, 1)
    assert count["false_positives"] == {"focal": 2}
    assert count["lost_at"] == {"extraction": 2}


def test_only_attempted_picks_count_and_a_pick_of_nothing_is_a_failure() -> None:
    picks = {row["part"]: row for row in to_dict(build_table(CONFIG, [HUB]))["picks"]}
    assert (picks["hub"]["n"], picks["hub"]["successes"]) == (2, 1)
    assert picks["cover1"]["n"] == 0


def test_false_poses_are_a_share_of_all_that_were_reported() -> None:
    table = build_table(CONFIG, [HUB, record("cover1", pieces=(piece(0, 0.9, "cover1", focal=MISSED),))])
    shares = {(row["part"], row["method"]): (row["successes"], row["n"]) for row in to_dict(table)["false_poses"]}
    assert shares["hub", "focal"] == (2, 5)  # three pieces matched, one of them hardly visible
    assert shares["hub", "focal-region"] == (0, 3)
    assert shares["cover1", "focal"] == (0, 0)
    for text in (shown(table), as_markdown(table)):
        assert "2 of 5: 40.0% (11.8% to 76.9%)" in text


def test_poses_are_held_to_what_they_say(tmp_path: Path) -> None:
    sure, unsure = (replace(matched(1.0), probability=p) for p in (0.97, 0.6))
    pieces = tuple(piece(i, 0.9, focal=sure if i < 9 else unsure) for i in range(10))
    scene = record(pieces=pieces, false_positives={"focal": 3}, false_probabilities={"focal": (0.96, 0.7, 0.1)})
    table = build_table(CONFIG, [scene])
    rows = {row["low"]: row["right"] for row in to_dict(table)["reliability"]["focal"]}
    assert [(rows[low]["successes"], rows[low]["n"]) for low in (0.0, 0.5, 0.95, 0.99)] == [
        (0, 1),
        (1, 2),
        (9, 10),
        (0, 0),
    ]
    assert "| focal | 0% to 50% | 1 | 10.0% |" in as_markdown(table)
    assert [path.name for path in save_figures(table, [scene], tmp_path)][-1] == "reliability.png"
    assert "Reliability" not in shown(build_table(CONFIG, [HUB]))


def test_mixed_scenes_count_for_each_part() -> None:
    config = SweepConfig(parts=("hub+cover1",), scenes=1)
    mixed = EpisodeRecord(
        key="hub+cover1/000",
        parts=("hub", "cover1"),
        scene=0,
        seed=0,
        config_hash="",
        pieces=(piece(0, 0.9, "hub", focal=matched(1.0)), piece(1, 0.9, "cover1", focal=MISSED)),
        picks=(PickRecord(True, 1, True),),
    )
    table = to_dict(build_table(config, [mixed]))
    rates = {
        part: success(table, part=part, method="focal", stage="matching", min_visibility=0.5)
        for part in ("hub", "cover1")
    }
    assert (rates["hub"]["successes"], rates["cover1"]["successes"]) == (1, 0)
    assert {row["part"]: row["n"] for row in table["picks"]} == {"hub": 0, "cover1": 1}


def test_failed_episodes_are_reported_and_in_no_rate() -> None:
    table = build_table(CONFIG, [HUB, record("cover1", error="ZeroDivisionError: x")])
    assert table.failed == {"cover1/000": "ZeroDivisionError: x"}
    for text in (as_markdown(table), shown(table)):
        assert "Incomplete: 2 of 3 episodes" in text
        assert "cover1/000: ZeroDivisionError: x" in text


def test_the_order_of_the_records_and_their_timings_do_not_matter() -> None:
    records = [
        record(
            config.kind, 0, pieces=tuple(piece(j, 0.9, config.kind, focal=matched(0.1 * i + j / 7)) for j in range(4))
        )
        for i, config in enumerate(episodes(CONFIG))
    ]
    shuffled = [replace(r, timings_s={"total": 1.0 * i}) for i, r in enumerate(records)]
    random.Random(1).shuffle(shuffled)
    assert to_dict(build_table(CONFIG, records)) == to_dict(build_table(CONFIG, shuffled))


def test_the_users_own_localizer_gets_rows() -> None:
    table = build_table(CONFIG, [record(pieces=(piece(0, 0.9, mine=matched(1.0)),))])
    row = success(to_dict(table), part="hub", method="mine", stage="matching", min_visibility=0.5)
    assert (row["n"], row["successes"]) == (1, 1)
    assert "mine" in shown(table)


def shown(table: object) -> str:
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    print_table(table, console)
    console.file.close()
    return console.export_text()


def test_text_has_the_measured_beside_the_published() -> None:
    text = shown(build_table(CONFIG, [HUB]))
    hub = next(line for line in text.splitlines() if line.startswith(" Hub") and "previous" in line)
    assert hub.split()[:10] == ["Hub", "previous", "2", "3.00", "±", "2.83", "3.00", "3.4", "±", "1.9"]
    assert "77%" in text
    assert max(map(len, text.splitlines())) <= 120


def test_markdown_rows_have_as_many_cells_as_their_heading() -> None:
    for block in as_markdown(build_table(CONFIG, [HUB])).split("\n\n"):
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({row.count("|") for row in rows}) <= 1


@pytest.mark.parametrize("records", [[HUB], []])
def test_figures_are_drawn(tmp_path: Path, records: list[EpisodeRecord]) -> None:
    paths = save_figures(build_table(CONFIG, records), records, tmp_path / "new")
    assert [path.name for path in paths] == ["fig10.png", "errors.png"]
    for path in paths:
        assert matplotlib.image.imread(path).std() > 0.05


def test_figures_that_cannot_be_written_are_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="writable directory"):
        save_figures(build_table(CONFIG, []), [], tmp_path / "file")
