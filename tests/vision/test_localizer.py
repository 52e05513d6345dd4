"""The whole system on drawn plates: images in, poses out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.geometry.workspace import Workspace
from vision.grouping.edge_grouping import GroupingParameters
from vision.localizer import EllipseLocalizer, Localization, Localizer, attribute_constraints, extract_features
from vision.matching.matcher import Matcher
from vision.matching.parameters import MatchingParameters
from vision.model.vision_model import Pattern
from vision.regions.region_ellipses import segment

WORKSPACE = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))


def nearest(estimates, truth, fold=3):
    """The estimate next to a pose, its distance in mm and its rotation in degrees up to the plate's symmetry."""
    best = min(estimates, key=lambda e: np.linalg.norm(e.T_world_part.translation - truth.translation))
    turns = Rotation.from_rotvec(np.outer(np.arange(fold) * 2 * np.pi / fold, [0, 0, 1]))
    angles = ((truth.rotation * turns).inv() * best.T_world_part.rotation).magnitude()
    distance = np.linalg.norm(best.T_world_part.translation - truth.translation)
    return best, 1e3 * distance, np.degrees(angles.min())


@pytest.fixture
def scene(pose):
    return [pose(-33, 0, 0, about=(5, 3, 11)), pose(33, 4, 1, about=(-4, 6, 70))]


@pytest.fixture(scope="module")
def focal(plate):
    return EllipseLocalizer([plate])


@pytest.mark.parametrize("views", [2, 3])
def test_plates_are_localised_within_a_twentieth_of_a_millimetre(views, focal, scene, photograph):
    result = focal.localize(photograph(scene, views), WORKSPACE)
    assert len(result.estimates) == 2
    for truth in scene:
        best, distance, angle = nearest(result.estimates, truth)
        assert distance < 0.05
        assert angle < 0.1
        assert best.inplane_known
        assert best.views == views


@pytest.mark.parametrize("seed", [10_010, 10_011, 10_012])
def test_plates_at_any_pose_are_localised(seed, focal, pose, photograph):
    rng = np.random.default_rng(seed)
    truth = pose(*rng.uniform(-12, 12, 2), rng.uniform(-8, 8), about=(*rng.uniform(-15, 15, 2), rng.uniform(0, 360)))
    (found,) = focal.localize(photograph([truth], seed=seed), WORKSPACE).estimates
    _, distance, angle = nearest([found], truth)
    assert distance < 0.05
    assert angle < 0.1


@pytest.mark.parametrize("extractor", ["region", "group"])
def test_either_extractor_works_alone_and_uses_its_own_ellipses(extractor, plate, scene, photograph):
    localizer = EllipseLocalizer([plate], (extractor,))
    assert localizer.name == f"focal-{extractor}"
    result = localizer.localize(photograph(scene), WORKSPACE)
    assert {f.extractor for view in result.features for f in view} == {extractor}
    assert localizer.alone([], result) == {localizer.name: result.estimates}
    assert len(result.estimates) == 2
    for truth in scene:
        best, distance, _ = nearest(result.estimates, truth)
        assert distance < 0.1
        assert best.extractor == extractor


def test_focal_reports_what_each_extractor_would_have_said_alone(plate, focal, scene, photograph):
    views = photograph(scene)
    result = focal.localize(views, WORKSPACE)
    assert focal.name == "focal"
    answers = focal.alone(views, result, WORKSPACE)
    assert set(answers) == {"focal-region", "focal-group"}
    for name, estimates in answers.items():
        alone = EllipseLocalizer([plate], name).localize(views, WORKSPACE).estimates
        for a, b in zip(alone, estimates, strict=True):
            assert np.array_equal(a.T_world_part.as_matrix(), b.T_world_part.as_matrix())


def test_one_view_gives_a_coarser_pose_that_knows_it(focal, scene, photograph):
    one, three = (focal.localize(photograph(scene, n), WORKSPACE).estimates for n in (1, 3))
    assert len(one) == 2
    for truth in scene:
        single, distance, angle = nearest(one, truth)
        joint, _, _ = nearest(three, truth)
        assert distance < 1.0
        assert angle < 2.0
        assert np.trace(single.covariance[:3, :3]) > 3 * np.trace(joint.covariance[:3, :3])


def test_a_plate_hidden_from_one_view_is_found_by_the_others(focal, scene, photograph):
    views = [*photograph(scene, [0, 1]), *photograph([], [2])]
    estimates = focal.localize(views, WORKSPACE).estimates
    for truth in scene:
        best, distance, _ = nearest(estimates, truth)
        assert distance < 0.1
        assert best.views == 2


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_nothing_in_empty_images_is_an_answer(noise, focal, photograph):
    views = photograph([], noise=noise)
    result = focal.localize(views, WORKSPACE)
    assert result.estimates == ()
    assert focal.alone(views, result, WORKSPACE) == {"focal-region": (), "focal-group": ()}
    assert len(result.features) == 3


def test_no_views_no_estimates(focal):
    assert focal.localize([]).estimates == ()


def test_without_a_workspace_the_plates_are_still_found(focal, scene, photograph):
    estimates = focal.localize(photograph(scene)).estimates
    for truth in scene:
        assert nearest(estimates, truth)[1] < 0.05


@pytest.mark.parametrize("workspace", [WORKSPACE, None])
def test_nothing_is_found_but_the_plates(workspace, focal, scene, photograph):
    estimates = focal.localize(photograph(scene), workspace).estimates
    assert len(estimates) == len(scene)
    assert all(e.score >= MatchingParameters().minimum_scores[-1] for e in estimates)


def test_regions_too_small_for_the_part_are_pruned_and_the_rest_is_not(focal, scene, photograph, plate):
    view = photograph(scene, noise=0)[0]
    littered = view.image.copy()
    for corner in range(8, 120, 16):
        littered[8:18, corner : corner + 10] = 200
    view = replace(view, image=littered)
    constraints = attribute_constraints([plate], view, WORKSPACE)
    litter = [r for r in segment(view.gray).regions if r.contour[:, 1].max() < 20]
    assert len(litter) >= 7
    assert constraints.prune(litter) == []
    assert ellipses_of(view, constraints) == ellipses_of(view, None)


def test_ellipses_have_the_size_of_a_salient_circle_in_the_workspace(focal, scene, photograph):
    view = photograph(scene, noise=0)[0]
    y, x = np.mgrid[: view.camera.height_px, : view.camera.width_px]
    littered = np.where(np.hypot(x - 40, y - 40) < 15, 200, view.image).astype(np.uint8)
    view = replace(view, image=littered)
    for workspace, most in ((WORKSPACE, 0), (None, 2)):
        found = focal.extraction(view, workspace).features
        small = [f for f in found if np.hypot(*(f.ellipse.centre - 40)) < 2]
        assert len(small) == most
        assert len(found) - len(small) >= 4


def ellipses_of(view, constraints):
    """Those of region growing, at least as large as the plate's bores, its smallest salient circles, can be."""
    found = extract_features(view, ["region"], constraints)
    return {tuple(f.ellipse.p) for f in found if f.ellipse.semi_axes[0] > 25}


def test_input_is_left_as_it_was(focal, scene, photograph):
    views = photograph(scene)
    before = [v.image.copy() for v in views]
    focal.localize(views, WORKSPACE)
    for view, image in zip(views, before, strict=True):
        assert np.array_equal(view.image, image)


def test_order_of_the_views_does_not_matter(focal, scene, photograph):
    views = photograph(scene)
    forwards, backwards = (focal.localize(v, WORKSPACE).estimates for v in (views, views[::-1]))
    assert len(forwards) == len(backwards) == 2
    for estimate in forwards:
        # The same optimum, summed up in another order and approached from another start.
        assert nearest(backwards, estimate.T_world_part)[1] < 0.01


@pytest.mark.parametrize(
    ("choice", "extractors"),
    [
        ("focal", ("region", "group")),
        ("focal-region", ("region",)),
        ("focal-group", ("group",)),
        (("group",), ("group",)),
        (["group", "region"], ("region", "group")),
    ],
)
def test_extractors_are_chosen_by_a_preset_or_one_by_one(choice, extractors, plate):
    localizer = EllipseLocalizer([plate], choice)
    assert localizer.extractors == extractors
    assert localizer.name == ("focal" if len(extractors) == 2 else f"focal-{extractors[0]}")


def test_ideas_can_be_switched_off_one_by_one(plate, photograph, scene):
    """Arcs, patterns, the search in depth; what hides is tested with the edges of a scene (test_confirmation.py)."""
    views = photograph(scene, 2)
    for arcs in (True, False):
        localizer = EllipseLocalizer([plate], parameters=MatchingParameters(arcs=arcs))
        assert bool(localizer.features_and_arcs(views[0], WORKSPACE)[1]) == arcs
    fields = [EdgeField.from_gray(view.gray) for view in views]
    model = replace(
        plate, patterns=(Pattern("slot", np.array([0.0, 0.0, 1.0]), np.zeros((4, 3)), np.tile([1.0, 0, 0], (4, 1))),)
    )
    for patterns in (True, False):
        matcher = Matcher(views, fields, model, WORKSPACE, MatchingParameters(patterns=patterns))
        assert len(matcher.model.patterns) == patterns


@pytest.mark.parametrize("extractor", ["region", "group"])
def test_one_extractor_falls_back_on_the_same_arcs(extractor, plate, focal, photograph, scene):
    view = photograph(scene, 1)[0]
    both, one = (m.features_and_arcs(view, WORKSPACE)[1] for m in (focal, EllipseLocalizer([plate], (extractor,))))
    assert [a.points.tolist() for a in both] == [a.points.tolist() for a in one]


@pytest.mark.parametrize(("old", "new"), [("dual", "focal"), ("region", "focal-region"), ("group", "focal-group")])
def test_names_of_older_versions_are_answered_with_the_new_ones(old, new, plate):
    with pytest.raises(InputError, match=f"got {old}; expected {new}. It is called {new} now"):
        EllipseLocalizer([plate], old)


@pytest.mark.parametrize("choice", ["regions", "", "r", (), ("regions",), ("region", "oracle"), [None]], ids=str)
def test_unknown_extractors_are_refused(choice, plate, photograph, pose):
    with pytest.raises(
        InputError, match=r"extractors: got .*; expected focal, focal-region, focal-group, or a tuple"
    ):
        EllipseLocalizer([plate], choice)
    with pytest.raises(InputError, match="extractors"):
        extract_features(photograph([pose()], 1)[0], choice)


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ([], "got none"),
        ("plate", "got a single VisionModel.* Put it into a list"),
        ([None], r"got NoneType object.* vision\.load_model"),
        (["cover2.json"], "got str object"),
        (None, "got NoneType object"),
    ],
    ids=str,
)
def test_a_localizer_needs_a_sequence_of_models(models, message, plate):
    with pytest.raises(InputError, match=f"models: {message}"):
        EllipseLocalizer(plate if models == "plate" else models)


def test_parameters_of_something_else_are_refused(plate):
    with pytest.raises(InputError, match="got GroupingParameters object"):
        EllipseLocalizer([plate], parameters=GroupingParameters())


def test_what_is_no_sequence_of_views_or_no_workspace_is_refused(focal, photograph, pose):
    (view,) = photograph([pose()], 1)
    with pytest.raises(InputError, match=r"views: got a single View; .* Put it into a list"):
        focal.localize(view, WORKSPACE)
    with pytest.raises(InputError, match="views: got ndarray object"):
        focal.localize([view, view.image], WORKSPACE)
    with pytest.raises(InputError, match="views: got NoneType object"):
        focal.localize(None)
    with pytest.raises(InputError, match="workspace: got tuple object"):
        focal.localize([view], ((-1, -1, -1), (1, 1, 1)))


def test_views_may_come_from_an_iterator(focal, photograph, pose):
    views = photograph([pose()], 2)
    assert len(focal.localize(iter(views), WORKSPACE).estimates) == 1


def test_anything_with_a_name_that_localises_views_is_a_localizer(focal):
    class Blind:
        name = "blind"

        def localize(self, views, workspace=None):
            return Localization(())

    assert isinstance(focal, Localizer)
    assert isinstance(Blind(), Localizer)
    assert not isinstance(object(), Localizer)
