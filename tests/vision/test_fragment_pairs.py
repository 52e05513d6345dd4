"""The three pairwise constraints of edge grouping, each on a picture that violates it alone; the fitting error."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from vision.edges.edge_map import detect_edges
from vision.grouping.edge_grouping import group_ellipses
from vision.grouping.fragments import extract_fragments
from vision.grouping.hypotheses import PairConstraints, pair_fragments
from vision.grouping.kalman_filter import fit_ellipse

Y, X = np.mgrid[:300, :400]


def pairs(image, **constraints):
    """How many pairs of fragments meet the constraints."""
    image = cv2.GaussianBlur(image.round().astype(np.uint8), None, 0.7)
    table = extract_fragments(detect_edges(image), image)
    return len(pair_fragments(table, PairConstraints(**constraints)))


def halves(right=180, ground=40):
    """A disc whose contrast fades in the middle; its right half and the ground there may be of other grey levels."""
    inside = np.hypot(X - 200, Y - 150) < 100
    image = np.where(X < 200, np.where(inside, 180, 40), np.where(inside, right, ground))
    return 110 + (image - 110) * np.clip((np.abs(X - 200) - 20) / 20, 0, 1)


def test_two_halves_of_a_disc_are_a_pair():
    assert pairs(halves()) == 1


def test_fragments_of_unlike_grey_are_no_pair():
    assert pairs(halves(right=120, ground=80)) == 0
    assert pairs(halves(right=120, ground=40)) == 1  # alike outside is enough


def test_fragments_too_far_apart_are_no_pair():
    assert pairs(halves(), max_extent_px=220.0) == 1
    assert pairs(halves(), max_extent_px=120.0) == 0


def test_fragments_that_bulge_apart_are_no_pair():
    discs = (np.hypot(X - 110, Y - 150) < 60) | (np.hypot(X - 290, Y - 150) < 60)
    assert pairs(np.where(discs, 180, 40)) == 0
    assert pairs(np.where(discs, 180, 40), convexity_slack_px=1000.0) == 1


def test_an_ellipse_that_the_filter_does_not_fit_is_discarded(monkeypatch):
    image = cv2.GaussianBlur(np.where(np.hypot(X - 200, Y - 150) < 80, 180, 40).astype(np.uint8), None, 0.7)
    (found,) = group_ellipses(image)
    assert np.allclose(found.ellipse.centre, (200, 150), atol=0.2)
    for error_px, left in ((0.89, 1), (0.91, 0)):

        def fit(*arguments, error_px=error_px):
            return replace(fit_ellipse(*arguments), fitting_error_px=error_px)

        monkeypatch.setattr("vision.grouping.edge_grouping.fit_ellipse", fit)
        assert len(group_ellipses(image)) == left
