"""The shipped models carry the strategies of the paper, and the paper's system does as they say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.models import load_model
from vision.files.views import load_views
from vision.paper.localizer import PaperLocalizer

VIEWS = Path(__file__).resolve().parents[2] / "docs" / "images" / "three_views"


def extractors(model):
    return {role: {f.extractor for f in model.features if f.role == role} for role in ("salient", "supporting")}


@pytest.mark.parametrize(
    ("part", "salient", "supporting"),
    [
        ("cover1", {"region"}, {"group"}),
        ("cover2", {"group"}, {"region"}),
        ("hub", {"region", "group"}, {"region"}),
    ],
)
def test_shipped_models_carry_the_papers_strategies(part, salient, supporting):
    model = load_model(part)
    assert extractors(model) == {"salient": salient, "supporting": supporting}
    assert all(f.extractor == "region" for f in model.salient if f.name.startswith("outline") and part == "hub")


def swapped(model):
    other = {"region": "group", "group": "region"}
    return replace(model, features=tuple(replace(f, extractor=other[f.extractor]) for f in model.features))


def test_swapping_the_taught_strategy_changes_what_the_papers_system_finds():
    """On the pictures of docs/vision.md; the poses come from other ellipses, and the predecessor does not care."""
    model, views = load_model("cover2"), load_views(VIEWS)
    taught, other = (PaperLocalizer([m]).localize(views) for m in (model, swapped(model)))
    assert {f.extractor for found in taught.features for f in found} == {"group"}
    assert {f.extractor for found in other.features for f in found} == {"region"}
    poses = [[e.T_world_part.as_matrix() for e in result.estimates] for result in (taught, other)]
    assert all(poses)
    assert len(poses[0]) != len(poses[1]) or not np.allclose(poses[0], poses[1], atol=1e-9)
    previous = [PaperLocalizer([m], "previous").localize(views).estimates for m in (model, swapped(model))]
    assert all(
        np.array_equal(a.T_world_part.as_matrix(), b.T_world_part.as_matrix()) for a, b in zip(*previous, strict=True)
    )
