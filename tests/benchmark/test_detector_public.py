import subprocess
import sys

import cv2
import numpy as np
import pytest

from benchmark.detector.evaluate import evaluate
from benchmark.detector.public import PUBLIC, from_edge_drawing, from_find_ellipses, public_detector
from vision.errors import InputError, ResourceError
from vision.geometry.ellipse import Ellipse, overlap

without_contrib = pytest.mark.skipif(hasattr(cv2, "ximgproc"), reason="OpenCV has its extra modules here")
with_contrib = pytest.mark.skipif(not hasattr(cv2, "ximgproc"), reason="needs opencv-contrib-python-headless")


def test_rows_of_edge_drawing_are_circles_and_ellipses_of_either_order_of_the_axes():
    rows = np.array([[[100.0, 50, 30, 0, 0, 0]], [[10.0, 20, 0, 5, 9, 30]], [[10.0, 20, 0, 9, 5, 30]]])
    circle, upright, lying = from_edge_drawing(rows)
    assert circle == pytest.approx([100, 50, 30, 30, 0])
    assert upright == pytest.approx([10, 20, 9, 5, np.radians(120)])
    assert lying == pytest.approx([10, 20, 9, 5, np.radians(30)])


def test_rows_of_find_ellipses_end_with_score_and_angle():
    (row,) = from_find_ellipses(np.array([[[10.0, 20, 5, 9, 0.8, 0.25]]], np.float32))
    assert row == pytest.approx([10, 20, 9, 5, 0.25 + np.pi / 2])


@pytest.mark.parametrize("convert", [from_edge_drawing, from_find_ellipses])
def test_nothing_found_is_no_rows(convert):
    assert convert(None).shape == (0, 5)


def test_rows_without_an_area_are_dropped():
    assert len(from_edge_drawing(np.array([[10.0, 20, 0, 9, 0, 30]]))) == 0


def test_unknown_detectors_are_refused_with_the_names_of_the_known_ones():
    with pytest.raises(InputError, match="edge_drawing, find_ellipses"):
        public_detector("hough")


@without_contrib
def test_missing_modules_name_what_to_install():
    with pytest.raises(ResourceError, match="opencv-contrib-python-headless"):
        public_detector("edge_drawing")
    command = [sys.executable, "-m", "benchmark.detector.evaluate", "--number", "1", "--against", "find_ellipses"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert "opencv-contrib-python-headless" in run.stderr


@with_contrib
@pytest.mark.parametrize("name", PUBLIC)
def test_public_detectors_find_a_plain_ellipse(name):
    image = np.full((240, 320), 60, np.uint8)
    cv2.ellipse(image, (150, 120), (80, 50), 30, 0, 360, 200, -1, cv2.LINE_AA)
    truth = Ellipse.from_geometric(150, 120, 80, 50, np.radians(30))
    found = [Ellipse.from_geometric(*row) for row in public_detector(name)(image)]
    assert max(overlap(e, truth) for e in found) > 0.95


def test_every_detector_is_asked_about_the_same_drawings():
    seen = {"one": [], "other": []}

    def finder(name):
        def detect(image):
            seen[name].append(image)
            return np.array([[5.0, 5.0, 3.0, 3.0, 0.0]])

        return detect

    tallies = evaluate("tune", 1, {name: finder(name) for name in seen})
    assert all(np.array_equal(a, b) for a, b in zip(*seen.values(), strict=True))
    assert tallies["one"]["clutter"].precision == 0
    assert tallies["one"]["complete"].truths == tallies["other"]["complete"].truths > 0
