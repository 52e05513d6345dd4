"""What is reported was not tuned on."""

from __future__ import annotations

from itertools import combinations

import pytest

from benchmark.config import PRESETS
from benchmark.detector.drawings import SPLITS
from benchmark.seeds import PICTURES, SCENES
from benchmark.timing.vision_step import SEED


@pytest.mark.parametrize("uses", [SCENES, PICTURES], ids=["scenes", "pictures"])
def test_no_seed_has_two_uses(uses):
    assert {"tuning", "validation", "reported"} <= set(uses)
    assert all(len(seeds) for seeds in uses.values())
    for (one, a), (other, b) in combinations(uses.items(), 2):
        assert max(a.start, b.start) >= min(a.stop, b.stop), f"{one} and {other} overlap"


def test_the_scenes_of_reported_figures_are_registered():
    assert all(preset.seed in SCENES["reported"] for preset in PRESETS.values())
    assert SEED in SCENES["timing"]


def test_only_the_tuning_split_is_tuned_on():
    reported = PICTURES["reported"]
    others = [seeds for seeds in PICTURES.values() if seeds != reported]
    assert SPLITS["test"] == reported.start
    assert all(SPLITS["tune"] <= seeds.start and seeds.stop <= reported.start for seeds in others)
