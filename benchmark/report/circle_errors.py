"""How true the circles of a study's taught models are to the parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.config import SweepConfig, Variant
from benchmark.episodes.metrics import Summary, summarise
from benchmark.study.taught_models import taught_models
from benchmark.world.part import Part
from benchmark.world.parts import get_part
from vision.errors import FileFormatError, InputError
from vision.model.vision_model import VisionModel


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


def circle_errors(model: VisionModel, part: Part) -> CircleErrors:
    """Hold a model against the drawing of its part; features that are no rim of the drawing are left out."""
    rims = {rim.name: rim for rim in part.rims}
    pairs = [(feature.circle, rims[feature.name]) for feature in model.features if feature.name in rims]
    centres = [1000 * float(np.linalg.norm(c.centre - np.array([r.offset_m, 0.0, r.z_m]))) for c, r in pairs]
    radii = [1000 * abs(c.radius_m - r.radius_m) for c, r in pairs]
    tilts = [float(np.degrees(np.arctan2(np.hypot(*c.normal[:2]), r.side * c.normal[2]))) for c, r in pairs]
    return CircleErrors(summarise(centres), summarise(radii), summarise(tilts))


def study_circles(config: SweepConfig, out: Path) -> Mapping[tuple[Variant, str], CircleErrors]:
    """The errors of all models that have been taught so far, by variant and part.

    Args:
        config: of the sweep.
        out: its directory.
    """
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
                found[variant, name] = circle_errors(model, get_part(name))
    return found
