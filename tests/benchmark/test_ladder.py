"""The ladder: its localizers differ in one thing each, and its rows count the same pieces."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise

import pytest
from rich.console import Console

from benchmark.config import LADDER, LOCALIZERS, SweepConfig, preset
from benchmark.localizers.ladder import PAPER_RUNGS, WITHOUT
from benchmark.localizers.registry import make_localizer
from benchmark.models import load_model
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PieceRecord, PoseErrors, vision_stage
from benchmark.report.grid import print_grids
from benchmark.report.ladder import build_ladder, is_ladder, ladder_grid, ladder_to_dict
from vision.errors import InputError
from vision.localizer import EllipseLocalizer
from vision.paper.localizer import PaperLocalizer

HIT = LocalizerResult(True, True, PoseErrors(1.0, 0.5, 0.5, 0.7, 1.2))
MISS = LocalizerResult(True, False)


def inner(name):
    localizer = make_localizer(name, [load_model("cover1")], tuple)
    assert localizer.name == name
    return getattr(localizer, "inner", localizer)


def test_every_rung_goes_by_its_name_and_is_another_localizer():
    made = {name: inner(name) for name in LADDER}
    settings = [(type(m), getattr(m, "extractors", m.name), m.parameters) for m in made.values()]
    assert all(a != b for i, a in enumerate(settings) for b in settings[:i])
    assert {name for name, m in made.items() if isinstance(m, PaperLocalizer)} == {"previous", "paper", *PAPER_RUNGS}


def test_each_rung_of_ours_adds_one_switch():
    ours = [name for name in LADDER if isinstance(inner(name), EllipseLocalizer) and name in (*WITHOUT, "focal")]
    assert ours[-1] == "focal"
    for below, above in pairwise(ours):
        a, b = inner(below).parameters, inner(above).parameters
        changed = {f.name: getattr(b, f.name) for f in fields(a) if getattr(a, f.name) != getattr(b, f.name)}
        assert list(changed.values()) == [True], (below, above)


def test_one_extractor_alone_differs_in_nothing_else():
    focal = inner("focal")
    for name in ("focal-region", "focal-group"):
        assert inner(name).parameters == focal.parameters
        assert set(inner(name).extractors) < set(focal.extractors)


def test_the_preset_runs_all_of_it_on_the_same_pictures():
    config = preset("ladder", scenes=1)
    assert is_ladder(config)
    assert not is_ladder(preset("table1"))
    assert set(preset("table1").compared) == {"previous", "paper"}
    assert set(LOCALIZERS) - {"oracle"} <= set(LADDER)


@pytest.mark.parametrize("compared", [("focal",), ("paper", "paper")])
def test_nothing_is_compared_with_itself(compared):
    with pytest.raises(InputError, match="compared"):
        SweepConfig(("hub",), compared=compared)


def record(config, scene, found):
    """A scene of two pieces; ``found`` says how many of them each localizer matched."""
    episode = config.episode("hub", scene)
    pieces = tuple(
        PieceRecord(i, "hub", visibility, True, {name: HIT if i < n else MISS for name, n in found.items()})
        for i, visibility in enumerate((0.9, 0.3))
    )
    times = {"vision": 0.3, **{vision_stage(name): 0.6 for name in config.compared}}
    return EpisodeRecord(
        episode.key,
        episode.parts,
        scene,
        episode.seed,
        episode.config_hash,
        pieces=pieces,
        false_positives={"previous": 1},
        timings_s=times,
    )


def test_rows_are_held_to_the_one_above_and_the_last_two_to_ours():
    config = replace(preset("ladder", scenes=12), parts=("hub",))
    found = dict.fromkeys(LADDER, 1) | {"previous": 0, "focal": 2, "focal-region": 1, "focal-group": 2}
    rows = {row.method: row for row in build_ladder(config, [record(config, i, found) for i in range(12)])}
    assert list(rows) == list(LADDER)
    assert (rows["previous"].above, rows["previous"].margin) == (None, None)
    assert rows["paper"].margin.margin == 0.5
    assert rows["paper-fit"].margin.margin == 0.0
    assert rows["focal"].above == "patterns"
    assert (rows["focal-region"].above, rows["focal-group"].above) == ("focal", "focal")
    assert (rows["focal-region"].margin.margin, rows["focal-group"].margin.margin) == (-0.5, 0.0)
    assert (rows["paper"].half_visible.rate, rows["paper"].visible.rate) == (1.0, 0.5)
    assert (rows["previous"].false_poses.rate, rows["paper"].false_poses.rate) == (1.0, 0.0)
    assert rows["focal"].view_ms == pytest.approx(100)
    assert rows["paper"].view_ms == pytest.approx(200)
    assert rows["paper"].translation_mm.median == 1.0
    assert len(ladder_to_dict(list(rows.values()))) == len(LADDER)
    console = Console(width=140, record=True, quiet=True)
    print_grids([ladder_grid(list(rows.values()))], [], console)


def test_an_empty_ladder_has_its_rows():
    config = preset("ladder", scenes=1)
    rows = build_ladder(config, [])
    assert len(rows) == len(LADDER) * len(config.parts)
    assert all(row.view_ms is None and row.visible.rate is None for row in rows)
    assert ladder_grid(rows).rows[0][2] == "–"
