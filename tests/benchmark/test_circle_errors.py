"""How true taught circles are, from models with known errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.config import SweepConfig, Variant
from benchmark.models import load_model
from benchmark.report.circle_errors import circle_deviations, keep_taught, read_taught
from benchmark.study.taught_models import model_path
from benchmark.world.parts import get_part
from vision.geometry.circle import Circle
from vision.model.model_file import save_model

TAUGHT = Variant(click_sigma_px=1, taught_views=5)
CONFIG = SweepConfig(("cover1", "cover2"), variants=(TAUGHT, Variant(click_sigma_px=2, taught_views=5)))


def drawn(name, shift_m=0.0, swell_m=0.0, tilt_rad=0.0):
    """The shipped model with the circles of the drawing, all wrong by the same amounts."""
    part, model = get_part(name), load_model(name)
    rims = {rim.name: rim for rim in part.rims}
    features = []
    for feature in model.features:
        rim = rims[feature.name]
        axis = rim.side * np.array([np.sin(tilt_rad), 0.0, np.cos(tilt_rad)])
        centre = np.array([rim.offset_m, 0.0, rim.z_m + shift_m])
        features.append(replace(feature, circle=Circle(centre, axis, rim.radius_m + swell_m)))
    return replace(model, features=tuple(features))


def test_circles_of_the_drawing_have_no_error():
    model = drawn("cover1")
    for errors in vars(circle_deviations(model, get_part("cover1"))).values():
        assert errors == pytest.approx([0] * len(model.features), abs=1e-6)


def test_known_errors_are_found():
    errors = circle_deviations(drawn("cover1", 1e-4, -2e-4, 0.004), get_part("cover1"))
    assert errors.centre_mm == pytest.approx([0.1] * len(errors.centre_mm))
    assert errors.radius_mm == pytest.approx([0.2] * len(errors.radius_mm))
    assert errors.tilt_deg == pytest.approx([np.degrees(0.004)] * len(errors.tilt_deg))


def test_models_that_are_there_are_measured(tmp_path):
    assert read_taught(CONFIG, tmp_path).errors(CONFIG) == {}
    path = model_path(tmp_path, TAUGHT, "cover2")
    path.parent.mkdir(parents=True)
    save_model(drawn("cover2", shift_m=5e-5), path)
    taught = read_taught(CONFIG, tmp_path)
    ((key, errors),) = taught.errors(CONFIG).items()
    assert key == (TAUGHT, "cover2")
    assert errors.centre_mm.mean == pytest.approx(0.05, abs=1e-4)
    (tmp_path / "kept").mkdir()
    keep_taught(taught, tmp_path / "kept")
    assert read_taught(CONFIG, tmp_path / "kept") == taught
