import numpy as np
import pytest

from vision.geometry.ellipse import Ellipse
from vision.grouping.score import DEFAULT_WEIGHTS, concentric_support, in_context

RIM = (100.0, 80.0, 50.0, 30.0, 0.4)


@pytest.mark.parametrize(
    ("neighbour", "supports"),
    [
        ((101.0, 81.0, 40.0, 24.0, 0.4), True),
        ((100.0, 80.0, 50.5, 30.2, 0.4), False),  # the same outline once more
        ((110.0, 80.0, 40.0, 24.0, 0.4), False),
        ((100.0, 80.0, 40.0, 24.0, 1.2), False),
        ((100.0, 80.0, 40.0, 36.0, 0.4), False),
    ],
)
def test_ellipses_of_one_centre_and_shape_support_each_other(neighbour, supports):
    ps = np.array([Ellipse.from_geometric(*geometric).p for geometric in (RIM, neighbour)])
    assert np.allclose(concentric_support(ps, np.array([0.2, 0.9])), [0.9, 0.2] if supports else [0.0, 0.0])


def test_the_turn_of_a_circle_means_nothing():
    circles = [(50.0, 60.0, 20.0, 20.0, 0.0), (50.0, 60.0, 30.0, 29.9, 1.5)]
    ps = np.array([Ellipse.from_geometric(*geometric).p for geometric in circles])
    assert np.allclose(concentric_support(ps, np.array([0.3, 0.6])), [0.6, 0.3])


def test_a_concentric_neighbour_raises_the_score_by_its_own():
    alone, doubtful, sure = (in_context(0.3, neighbour, DEFAULT_WEIGHTS) for neighbour in (0.0, 0.4, 1.0))
    assert alone == pytest.approx(0.3)
    assert alone < doubtful < sure < 1.0
