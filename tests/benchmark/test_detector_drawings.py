import numpy as np
import pytest

from benchmark.detector.drawings import Drawing, draw
from benchmark.detector.evaluate import Tally, judge
from benchmark.detector.objects import Picture
from benchmark.detector.surfaces import clouds
from vision.geometry.ellipse import Ellipse


@pytest.fixture
def outline():
    return Ellipse.from_geometric(60, 50, 30, 20, 0.2)


@pytest.mark.parametrize(("contrast", "shares"), [(40.0, (1.0, 1.0)), (5.0, (0.0, 1.0)), (1.0, (0.0, 0.0))])
def test_outlines_are_plain_faint_or_invisible_by_their_contrast(outline, contrast, shares):
    picture = Picture.on(np.full((100, 120), 90.0), clouds)
    ys, xs = np.mgrid[0:100, 0:120].astype(float)
    inside = outline.distance(np.column_stack([xs.ravel(), ys.ravel()])).reshape(100, 120) < 0
    number = picture.new_thing()
    picture.paint(inside.astype(float), 90.0 + contrast, number)
    assert picture.visible_shares(outline, number) == pytest.approx(shares, abs=0.02)


def test_what_lies_behind_another_thing_cannot_be_seen(outline):
    picture = Picture.on(np.full((100, 120), 90.0), clouds)
    hidden = picture.new_thing()
    picture.paint(np.ones((100, 120)), 200.0, picture.new_thing())
    assert picture.visible_shares(outline, hidden) == (0, 0)


def test_a_detector_is_neither_paid_nor_fined_for_what_is_tolerated(outline):
    asked = Ellipse.from_geometric(200, 50, 30, 20, 0.2)
    drawing = Drawing(np.zeros((100, 300), np.uint8), (asked,), (outline,), "faint")
    assert judge(drawing, outline.geometric[None], 0.0) == Tally(0, 0, 1, 0.0, 1)
    assert judge(drawing, np.array([outline.geometric, asked.geometric]), 0.0) == Tally(1, 1, 1, 0.0, 1)


def test_faint_outlines_are_tolerated_in_pictures_of_little_contrast():
    drawings = [draw("tune", "faint", k) for k in range(3)]
    assert any(d.tolerated for d in drawings)
    for d in drawings:
        assert not {e.p.tobytes() for e in d.tolerated} & {e.p.tobytes() for e in d.ellipses}
