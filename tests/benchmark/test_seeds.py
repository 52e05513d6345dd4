"""What is reported was not tuned on."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

from benchmark.config import PRESETS, episode_seed
from benchmark.detector.drawings import SPLITS
from benchmark.report.published import PARTS
from benchmark.seeds import PICTURES, SCENES
from benchmark.timing.vision_step import SEED

ROOT = Path(__file__).resolve().parents[2]
TUNING = ROOT / "benchmark" / "tuning"


@pytest.mark.parametrize("uses", [SCENES, PICTURES], ids=["scenes", "pictures"])
def test_no_seed_has_two_uses(uses):
    assert {"earlier", "tuning", "validation"} <= set(uses)
    assert all(len(seeds) for seeds in uses.values())
    for (one, a), (other, b) in combinations(uses.items(), 2):
        assert max(a.start, b.start) >= min(a.stop, b.stop), f"{one} and {other} overlap"


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_has_seeds_of_its_own(name):
    assert PRESETS[name].seed == SCENES[name].start


def test_no_two_sweeps_share_a_scene():
    plans = [preset.episode(kind, i) for preset in PRESETS.values() for kind in preset.parts for i in range(100)]
    tried = [
        episode_seed(seed, part, 0)
        for part in PARTS
        for use in ("tuning", "validation")
        for seed in SCENES[use][:100]
    ]
    timed = [episode_seed(SEED, part, i) for part in PARTS for i in range(100)]
    seeds = [plan.seed for plan in plans] + tried + timed
    assert len(set(seeds)) == len(seeds)
    assert SEED in SCENES["timing"]


@pytest.mark.parametrize("script", [path.stem for path in TUNING.glob("*.py") if "__main__" in path.read_text()])
def test_what_was_tuned_names_its_script_and_its_seeds(script):
    """The code names the script, the document has its command, and what it prints ends with its seeds."""
    document = (ROOT / "docs" / "tuning.md").read_text(encoding="utf-8")
    assert f"$ python -m benchmark.tuning.{script}\n" in document
    assert "seeds_in_words(" in (TUNING / f"{script}.py").read_text(encoding="utf-8")
    code = (path.read_text(encoding="utf-8") for path in (ROOT / "vision").rglob("*.py"))
    assert sum(f"``benchmark/tuning/{script}.py``" in text for text in code) == 1


def test_only_the_tuning_split_is_tuned_on():
    reported = PICTURES["reported"]
    others = [seeds for seeds in PICTURES.values() if seeds != reported]
    assert SPLITS["test"] == reported.start
    assert all(SPLITS["tune"] <= seeds.start and seeds.stop <= reported.start for seeds in others)
