from __future__ import annotations

import itertools

import pytest
from scipy.stats import multinomial

from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PieceRecord, PoseErrors
from benchmark.report.margins import design_effect, newcombe_interval, paired_margin

HIT, MISS = LocalizerResult(True, True, PoseErrors(0.1, 0.1, None, 0.1, 0.1)), LocalizerResult(True, False)
BOTH, FOCAL, REGION, NEITHER = (HIT, HIT), (HIT, MISS), (MISS, HIT), (MISS, MISS)


def scene(number: int, *outcomes: tuple[LocalizerResult, LocalizerResult], visibility: float = 0.9) -> EpisodeRecord:
    pieces = tuple(
        PieceRecord(i, "hub", visibility, True, {"focal": focal, "focal-region": region})
        for i, (focal, region) in enumerate(outcomes)
    )
    return EpisodeRecord(f"hub/{number:03d}", ("hub",), number, 0, "", pieces=pieces)


def margin(records: list[EpisodeRecord], min_visibility: float = 0.5):
    return paired_margin(records, "hub", ("focal", "focal-region"), min_visibility)


def test_interval_is_the_one_in_newcombes_paper():
    assert newcombe_interval(36, 12, 2, 0) == pytest.approx((0.0569, 0.3404), abs=5e-5)


@pytest.mark.parametrize(
    "rates", [(0.9, 0.05, 0.02, 0.03), (0.8, 0.1, 0.1, 0.0), (0.5, 0.2, 0.1, 0.2), (0.2, 0.0, 0.4, 0.4)]
)
def test_interval_holds_the_true_difference_as_often_as_it_says(rates):
    """Over all samples of 24 pieces, each with its probability."""
    n, covered = 24, 0.0
    for both, first, second in itertools.product(range(n + 1), repeat=3):
        neither = n - both - first - second
        if neither >= 0:
            low, high = newcombe_interval(both, first, second, neither)
            if low <= rates[1] - rates[2] <= high:
                covered += multinomial.pmf((both, first, second, neither), n, rates)
    assert covered > 0.94


def test_interval_turns_with_the_sign_of_the_difference():
    low, high = newcombe_interval(30, 9, 3, 8)
    assert newcombe_interval(30, 3, 9, 8) == pytest.approx((-high, -low))


@pytest.mark.parametrize("counts", [(10, 0, 0, 0), (0, 0, 0, 10), (0, 10, 0, 0), (0, 0, 10, 0), (0.5, 0.5, 0, 0)])
def test_interval_of_extreme_counts_holds_the_difference(counts):
    low, high = newcombe_interval(*counts)
    assert -1 <= low <= (counts[1] - counts[2]) / sum(counts) <= high <= 1
    assert high - low > 0.1


def test_margin_counts_each_piece_once():
    records = [scene(0, BOTH, FOCAL, FOCAL, NEITHER), scene(1, BOTH, REGION, BOTH), scene(2, NEITHER)]
    found = margin(records)
    assert (found.n, found.scenes, found.method_only, found.rival_only) == (8, 3, 2, 1)
    assert found.margin == pytest.approx(1 / 8)


def test_only_pieces_that_are_visible_in_the_bin_and_judged_by_both_count():
    records = [
        scene(0, BOTH, FOCAL),
        scene(1, FOCAL, FOCAL, visibility=0.3),
        EpisodeRecord(
            "hub/002",
            ("hub",),
            2,
            0,
            "",
            pieces=(
                PieceRecord(0, "hub", 0.9, False, {"focal": HIT, "focal-region": MISS}),
                PieceRecord(1, "hub", 0.9, True, {"focal": HIT}),
                PieceRecord(2, "cover1", 0.9, True, {"focal": HIT, "focal-region": MISS}),
            ),
        ),
    ]
    assert (margin(records, 0.5).n, margin(records, 0.5).method_only) == (2, 1)
    assert (margin(records, 0.1).n, margin(records, 0.1).method_only) == (4, 3)


def test_a_clear_margin_excludes_zero_and_a_single_disagreement_does_not():
    clear = [scene(i, BOTH, BOTH, BOTH, FOCAL) for i in range(20)]
    assert margin(clear).excludes_zero is True
    assert margin(clear).low > 0.1
    lone = [scene(0, BOTH, FOCAL), *(scene(i, BOTH, BOTH) for i in range(1, 20))]
    assert margin(lone).excludes_zero is False
    against = [scene(i, BOTH, BOTH, BOTH, REGION) for i in range(20)]
    assert margin(against).excludes_zero is True
    assert margin(against).margin == -0.25


def test_pieces_that_only_repeat_their_scene_are_worth_no_more_than_one():
    single = [scene(i, outcome) for i, outcome in enumerate([BOTH] * 14 + [FOCAL] * 5 + [REGION] + [NEITHER] * 4)]
    fourfold = [
        scene(i, *[outcome] * 4) for i, outcome in enumerate([BOTH] * 14 + [FOCAL] * 5 + [REGION] + [NEITHER] * 4)
    ]
    assert margin(fourfold).margin == margin(single).margin
    # The design effect is four, but for the degrees of freedom that the scenes' own mean costs.
    assert margin(fourfold).low == pytest.approx(margin(single).low, abs=0.01)
    assert margin(fourfold).high == pytest.approx(margin(single).high, abs=0.01)


def test_design_effect_is_one_for_scenes_that_have_nothing_in_common():
    assert design_effect([[1, 0], [0, 1], [1, 0], [0, 1]]) == 1.0
    assert design_effect([[0, 0], [0, 0]]) == 1.0


def test_design_effect_of_scenes_that_agree_within_is_their_size():
    scenes = [[1.0] * 3, [0.0] * 3] * 50
    assert design_effect(scenes) == pytest.approx(3, rel=0.02)


def test_one_scene_or_none_has_no_interval():
    one = margin([scene(0, BOTH, FOCAL)])
    assert (one.margin, one.low, one.high, one.excludes_zero) == (0.5, None, None, None)
    none = margin([])
    assert (none.n, none.margin, none.excludes_zero) == (0, None, None)
