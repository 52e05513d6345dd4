"""Thresholds that follow from what a person drew, on a drawn plate that is photographed well and badly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.geometry.camera import View
from vision.geometry.circle import project_circle
from vision.geometry.ellipse import overlap
from vision.localizer import extract_features
from vision.teaching.lesson import Lesson, TaughtFeature
from vision.teaching.threshold_search import propose_thresholds

FRONT = ("outline_front", "ring_front", "bore_front")
DEFAULTS = ExtractionThresholds()


def photographed(photograph, contrast, noise=1.0, seed=20_100):
    """Three views of the plate, whose grey levels are drawn together before the camera adds its noise."""
    rng = np.random.default_rng(seed)
    views = []
    for view in photograph([RigidTransform.identity()], views=3, noise=0.0):
        faint = 90 + contrast * (view.gray.astype(float) - 90)
        image = np.clip(np.round(faint + rng.normal(scale=noise, size=faint.shape)), 0, 255)
        views.append(View(image.astype(np.uint8), view.camera, view.T_world_camera, view.name))
    return views


def lesson_on(plate, views, extractor=None, names=FRONT):
    marked = []
    for feature in plate.features:
        if feature.name in names:
            clicks = {v: view.project(feature.circle.sample(12)) for v, view in enumerate(views)}
            marked.append(TaughtFeature(feature.name, feature.role, clicks, feature.copies, extractor))
    return Lesson("plate", 0.060, tuple(marked), symmetry_fold=3)


@pytest.fixture(scope="module")
def good(photograph):
    return photographed(photograph, 1.0)


@pytest.fixture(scope="module")
def bad(photograph):
    """Steps of 4 to 10 grey levels for region growing; noise for edge grouping, which stands much of it."""
    return {
        "region": photographed(photograph, 0.08, noise=0.7),
        "group": photographed(photograph, 0.25, noise=8.0),
    }


@pytest.fixture(scope="module", params=["region", "group"])
def adapted(request, plate, bad):
    views = bad[request.param]
    return propose_thresholds(lesson_on(plate, views, request.param), views), request.param


def test_where_nothing_is_missed_the_defaults_stay(plate, good):
    proposal = propose_thresholds(lesson_on(plate, good), good)
    assert proposal.thresholds == DEFAULTS
    assert proposal.before == proposal.after
    assert proposal.before.found == proposal.before.total == 9
    assert all(change.before and change.after for change in proposal.changes)


def test_more_is_found_with_the_proposed_thresholds(adapted):
    proposal, _ = adapted
    assert proposal.before.found < proposal.before.total
    assert proposal.after.found > proposal.before.found
    assert proposal.after.score > proposal.before.score


def test_only_the_thresholds_of_the_chosen_extractor_change(adapted):
    proposal, extractor = adapted
    group = ("noise_factor", "shortest_fragment_px", "fitting_error_px")
    region = ("canny_low", "canny_high", "homogeneity", "boundary_error_px")
    kept, free = (group, region) if extractor == "region" else (region, group)
    assert all(getattr(proposal.thresholds, name) == getattr(DEFAULTS, name) for name in kept)
    assert any(getattr(proposal.thresholds, name) != getattr(DEFAULTS, name) for name in free)
    assert proposal.thresholds.canny_low < proposal.thresholds.canny_high


def test_the_proposal_keeps_its_promise(adapted, plate, bad):
    """What it says of every feature and view is what the extractor then does."""
    proposal, extractor = adapted
    circles = {f.name: f.circle for f in plate.features}
    for thresholds, said in ((DEFAULTS, "before"), (proposal.thresholds, "after")):
        found = [extract_features(view, (extractor,), None, thresholds) for view in bad[extractor]]
        for change in proposal.changes:
            truth = project_circle(circles[change.feature], bad[extractor][change.view])
            best = max((overlap(f.ellipse, truth) for f in found[change.view]), default=0.0)
            assert (best > 0.8) == getattr(change, said)
            assert change.extractor == extractor


def test_tallies_count_the_changes(adapted):
    proposal, _ = adapted
    assert len(proposal.changes) == proposal.before.total == 9
    assert sum(f.before for f in proposal.changes) == proposal.before.found
    assert sum(f.after for f in proposal.changes) == proposal.after.found


def test_before_is_what_the_lesson_has_now(plate, good):
    """Thresholds that find nothing are left behind for the defaults."""
    deaf = replace(DEFAULTS, canny_low=200.0, canny_high=400.0, noise_factor=300.0, fitting_error_px=0.01)
    lesson = replace(lesson_on(plate, good), thresholds=deaf)
    proposal = propose_thresholds(lesson, good)
    assert proposal.before.found < 9
    assert proposal.thresholds == DEFAULTS
    assert proposal.after.found == 9


def test_an_ellipse_that_nobody_drew_is_counted_as_spurious(plate, good):
    all_taught = propose_thresholds(lesson_on(plate, good), good).before
    ring_untaught = propose_thresholds(lesson_on(plate, good, names=("outline_front", "bore_front")), good).before
    assert all_taught.spurious == 0
    assert ring_untaught.spurious >= 3
    # The holes are taught by one of them; its copies are no surprise.
    with_holes = propose_thresholds(lesson_on(plate, good, names=(*FRONT, "hole_front")), good).before
    assert with_holes.spurious == 0


def test_nothing_to_be_seen_changes_nothing(plate, photograph):
    blank = photographed(photograph, 0.0, noise=0.5)
    proposal = propose_thresholds(lesson_on(plate, blank), blank)
    assert proposal.after.found == 0
    assert proposal.thresholds == DEFAULTS


def test_progress_is_told_and_can_end_the_search(plate, bad):
    views = bad["region"]
    shares = []
    propose_thresholds(lesson_on(plate, views, "region"), views, shares.append)
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] <= 1

    class EnoughError(Exception):
        pass

    def stop(_):
        raise EnoughError

    with pytest.raises(EnoughError):
        propose_thresholds(lesson_on(plate, views, "region"), views, stop)


def test_an_empty_lesson_is_refused(plate, good):
    with pytest.raises(InputError, match="Mark a feature first"):
        propose_thresholds(Lesson("plate", 0.06, ()), good)
