"""`focalpick model show` prints a model for people, and draws it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.console import Console

from benchmark import cli
from benchmark.models import MODELS, load_model
from benchmark.report.model_figure import draw_model, save_model_figure
from benchmark.report.model_text import print_model
from vision.errors import InputError
from vision.extraction import ExtractionThresholds


def printed(model):
    console = Console(width=160, record=True, file=None, quiet=False)
    with console.capture() as capture:
        print_model(model, console)
    return capture.get()


def test_all_that_a_model_says_is_printed():
    model = load_model("hub")
    text = printed(model)
    for name in [f.name for f in model.features] + [g.name for g in model.grasps]:
        assert name in text
    assert "outline 240.0 mm, 5 rotations look the same" in text
    for feature, extractor in ((model.features[0], "region growing"), (model.features[1], "edge grouping")):
        row = next(line for line in text.splitlines() if f" {feature.name} " in line)
        assert "salient" in row
        assert f"{2e3 * feature.circle.radius_m:.2f}" in row
        assert extractor in row
    bore = next(line for line in text.splitlines() if line.strip().startswith("bore "))
    assert "64.0" in bore
    assert "15.0" in bore


def test_patterns_are_printed_with_face_and_height_and_drawn_to_scale():
    model = load_model("cover1")
    row = next(line for line in printed(model).splitlines() if "pattern_back_1" in line).split()
    assert row[1:3] == ["back", f"{1e3 * model.patterns[1].points[0, 2]:.2f}"]
    assert row[-1] == str(len(model.patterns[1].points))
    drawn = [line.get_xydata() for line in draw_model(model).axes[0].lines]
    for pattern in model.patterns:
        assert any(line.shape == (len(pattern.points), 2) for line in drawn)
        assert any(np.array_equal(line, 1e3 * pattern.points[:, :2]) for line in drawn)
    assert "pattern_" not in printed(load_model("hub"))


def test_adapted_thresholds_stand_beside_the_defaults():
    adapted = replace(load_model("cover1"), thresholds=ExtractionThresholds(homogeneity=4.25))
    row = next(line for line in printed(adapted).splitlines() if "homogeneity" in line)
    assert row.split()[-2:] == ["4.25", f"{ExtractionThresholds().homogeneity:g}"]


def test_a_model_without_bore_grasps_or_symmetry_is_printed_and_drawn(tmp_path):
    bare = replace(load_model("cover1"), bore=None, grasps=(), symmetry_fold=None)
    assert "every rotation looks the same" in printed(bare)
    save_model_figure(bare, tmp_path / "bare.png")
    assert cv2.imread(str(tmp_path / "bare.png")) is not None


def test_the_drawing_shows_every_circle_to_scale():
    model = load_model("cover2")
    figure = draw_model(model)
    front = figure.axes[0]
    circles = sum(f.copies for f in model.features)
    grasps = 2 * len(model.grasps)
    assert len(front.lines) == circles + grasps + len(model.patterns)
    reach = max(np.abs(line.get_xydata()).max() for line in front.lines)
    assert reach == pytest.approx(1e3 * (0.0352 + model.supporting[0].circle.radius_m), abs=0.1)


@pytest.mark.parametrize("argument", ["cover1", str(MODELS / "cover1.json")])
def test_a_model_is_shown_by_name_or_file(argument, tmp_path, capsys):
    out = tmp_path / "cover1.png"
    assert cli.main(["model", "show", argument, "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert "boss_front" in captured.out
    assert str(out) in captured.err
    picture = cv2.imread(str(out))
    assert min(picture.shape[:2]) > 400
    assert picture.std() > 5


def test_what_is_no_model_is_refused_in_one_line(tmp_path, capsys):
    assert cli.main(["model", "show", str(tmp_path / "none.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert cli.main(["model", "show", str(MODELS / "vision_model.schema.json")]) == 2
    assert "format" in capsys.readouterr().err


def test_a_drawing_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(InputError, match="writable"):
        save_model_figure(load_model("cover1"), tmp_path / "nowhere" / "x.png")
