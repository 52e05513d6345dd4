"""How true the circles of a study's taught models are to the parts, and which parts could not be taught.

It follows from the models in the sweep's directory. Beside records that a document quotes there is ``taught.json``
instead, a hundredth of their size.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmark.config import SweepConfig, Variant
from benchmark.episodes.metrics import Summary, summarise
from benchmark.records.episode_record import SCHEMA, parse_object
from benchmark.strict_json import decode
from benchmark.study.taught_models import MODELS, refusals, taught_models
from benchmark.world.part import Part
from benchmark.world.parts import get_part
from vision.errors import FileFormatError, InputError
from vision.model.vision_model import VisionModel

TAUGHT_FILE = "taught.json"


@dataclass(frozen=True)
class CircleErrors:
    """Errors of a model's circles against the rims that they were taught from, all features taken together.

    Attributes:
        centre_mm: distance of the centres.
        radius_mm: difference of the radii.
        tilt_deg: angle between the axes.
    """

    centre_mm: Summary
    radius_mm: Summary
    tilt_deg: Summary


@dataclass(frozen=True)
class CircleDeviations:
    """Errors of each circle of a model, as in :class:`CircleErrors`."""

    centre_mm: tuple[float, ...]
    radius_mm: tuple[float, ...]
    tilt_deg: tuple[float, ...]


@dataclass(frozen=True)
class Taught:
    """What became of the lessons of a study.

    Attributes:
        refused: why a part could not be taught, by ``VARIANT/PART``.
        circles: the errors of every model, by ``VARIANT/PART``.
    """

    refused: dict[str, str]
    circles: dict[str, CircleDeviations]

    def errors(self, config: SweepConfig) -> Mapping[tuple[Variant, str], CircleErrors]:
        """The errors of all models that have been taught so far, by variant and part."""
        lessons = [(v, name) for v in config.variants if v.is_taught for name in config.part_names]
        return {
            lesson: CircleErrors(*(summarise(values) for values in vars(self.circles[key]).values()))
            for lesson in lessons
            if (key := _key(*lesson)) in self.circles
        }


def circle_deviations(model: VisionModel, part: Part) -> CircleDeviations:
    """Hold a model against the drawing of its part; features that are no rim of the drawing are left out."""
    rims = {rim.name: rim for rim in part.rims}
    pairs = [(feature.circle, rims[feature.name]) for feature in model.features if feature.name in rims]
    centres = [1000 * float(np.linalg.norm(c.centre - np.array([r.offset_m, 0.0, r.z_m]))) for c, r in pairs]
    radii = [1000 * abs(c.radius_m - r.radius_m) for c, r in pairs]
    tilts = [float(np.degrees(np.arctan2(np.hypot(*c.normal[:2]), r.side * c.normal[2]))) for c, r in pairs]
    return CircleDeviations(tuple(centres), tuple(radii), tuple(tilts))


def read_taught(config: SweepConfig, out: Path) -> Taught:
    """What the directory of a sweep tells of its lessons.

    Args:
        config: of the sweep.
        out: its directory.

    Raises:
        FileFormatError: a file is corrupt.
    """
    kept = out / TAUGHT_FILE
    if kept.is_file() and not (out / MODELS).exists():
        return decode(Taught, parse_object(kept.read_text(encoding="utf-8"), str(kept)), str(kept))
    found = {}
    for variant in (v for v in config.variants if v.is_taught):
        for name in config.part_names:
            try:
                models = taught_models(out, variant, (name,))
            except FileFormatError:
                raise
            except InputError:  # not taught yet
                continue
            for model in models:
                found[_key(variant, name)] = circle_deviations(model, get_part(name))
    return Taught(refusals(out), found)


def keep_taught(taught: Taught, out: Path) -> None:
    """Write ``taught.json`` into a directory that has no models."""
    fields = {"schema": SCHEMA, **asdict(taught)}
    (out / TAUGHT_FILE).write_text(f"{json.dumps(fields, indent=1)}\n", encoding="utf-8")


def _key(variant: Variant, part: str) -> str:
    return f"{variant.name}/{Path(part).stem}"
