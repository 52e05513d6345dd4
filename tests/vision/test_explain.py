"""The panels of images about which nothing is known, and of views in which drawn plates were looked for."""

from __future__ import annotations

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from vision.drawing.explain import MODEL_FREE_PANELS, PANELS, explain, explain_view
from vision.drawing.panel import with_legend
from vision.drawing.stage_panels import HALF_RESOLUTION_COLOUR, PRUNED_COLOURS, WHITE, support_colour
from vision.geometry.workspace import Workspace
from vision.grouping.detector import detect_ellipses
from vision.grouping.edge_grouping import group_edges
from vision.localizer import EllipseLocalizer

WORKSPACE = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))


def disc() -> np.ndarray:
    image = np.full((100, 120), 60, np.uint8)
    cv2.circle(image, (60, 50), 30, 200, -1, cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), 0.7)


def pixels(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """x, y of the pixels of about a colour (N, 2): thin lines are blended with what they are drawn on."""
    return np.argwhere((np.abs(image.astype(int) - colour) < 90).all(axis=2))[:, ::-1]


def test_explain_draws_every_stage_of_colour_and_grey_images() -> None:
    image = disc()
    panels = explain(image)
    assert tuple(panel.name for panel in panels) == MODEL_FREE_PANELS
    assert {panel.image.shape for panel in panels} == {(200, 240, 3)}
    assert "1 ellipses" in panels[4].title
    colour = explain(np.repeat(image[..., None], 3, axis=2))
    assert all(np.array_equal(a.image, b.image) for a, b in zip(panels, colour, strict=True))


def test_a_panel_stays_read_only() -> None:
    panel = pickle.loads(pickle.dumps(explain(disc())[0]))
    assert not panel.image.flags.writeable


@pytest.mark.parametrize("shape", [(1, 480), (480, 1), (3, 3000), (1, 1)])
def test_explain_draws_narrow_images(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    panels = explain(rng.integers(0, 256, shape).astype(np.uint8))
    assert all(panel.image.size <= 3 * 4 * max(shape) * 3 for panel in panels)


def test_explain_looks_at_a_huge_image_at_less_resolution() -> None:
    image = np.full((4000, 6000), 60, np.uint8)
    cv2.ellipse(image, (3000, 2000), (1600, 900), 20, 0, 360, 180, -1)
    panels = explain(image)
    assert {panel.image.shape for panel in panels} == {(1000, 1500, 3)}
    assert "1 ellipses" in panels[4].title


def blurred_and_sharp() -> np.ndarray:
    """A sharp disc, and an ellipse so soft and noisy that only half the resolution shows it."""
    image = np.full((300, 400), 100.0)
    soft = cv2.GaussianBlur(cv2.ellipse(np.zeros((300, 400)), (270, 150), (90, 60), 0, 0, 360, 14.0, -1), (0, 0), 3)
    image = cv2.circle(image + soft, (80, 150), 40, 200, -1)
    return np.clip(image + np.random.default_rng(10_000).normal(scale=5, size=image.shape), 0, 255).astype(np.uint8)


def test_groups_are_what_the_detector_returns_half_the_resolution_included() -> None:
    image = blurred_and_sharp()
    detected = detect_ellipses(image)
    panel = explain(image)[4]
    assert len(detected) > len(group_edges(image).features), "the picture has to need the second look"
    assert f"{len(detected)} ellipses, 1 at half" in panel.title
    soft = pixels(panel.image[:540, 340:], HALF_RESOLUTION_COLOUR) / 2 + (170, 0)
    assert len(soft) > 100
    assert np.abs(np.hypot((soft[:, 0] - 270) / 90, (soft[:, 1] - 150) / 60) - 1).max() < 0.1


@pytest.fixture(scope="module")
def looked(plate, photograph, pose):
    """A view of a plate, the localizer that looked for it, and what it found."""
    views = photograph([pose(4, 3, 0, about=(5, 3, 11))])
    localizer = EllipseLocalizer([plate])
    return views, localizer, localizer.localize(views, WORKSPACE)


def panels_of(looked, localizer=None, workspace=WORKSPACE):
    views, focal, found = looked
    extraction = (localizer or focal).extraction(views[0], workspace)
    return {p.name: p for p in explain_view(views[0], extraction, found.estimates, focal.models, zoom=1)}


def test_a_view_has_every_panel_in_its_own_size(looked) -> None:
    panels = panels_of(looked)
    assert tuple(panels) == PANELS
    assert {panel.image.shape for panel in panels.values()} == {(480, 640, 3)}


def test_the_stages_are_those_from_which_the_localizer_made_its_answer(looked) -> None:
    views, localizer, found = looked
    for view, features in zip(views, found.features, strict=True):
        stages = localizer.extraction(view, WORKSPACE)
        assert [f.ellipse.p.tolist() for f in stages.features] == [f.ellipse.p.tolist() for f in features]
    assert f"{len(localizer.extraction(views[0], WORKSPACE).of_extractor('group'))} ellipses" in (
        panels_of(looked)["5_groups"].title
    )


@pytest.mark.parametrize(
    ("extractor", "missing"),
    [("region", {"4_fragments", "5_groups", "6_filter"}), ("group", set(PANELS[1:4]))],
)
def test_an_extractor_that_was_not_asked_has_no_panels(looked, extractor: str, missing: set[str]) -> None:
    one = EllipseLocalizer(looked[1].models, (extractor,))
    assert set(PANELS) - set(panels_of(looked, one)) == missing


def test_holes_are_pruned_by_their_area_and_nothing_is_where_nothing_is_known(looked) -> None:
    panels = panels_of(looked)
    holes = pixels(panels["2b_pruned_regions"].image, PRUNED_COLOURS["area_px"])
    assert len(holes) > 30
    title = panels_of(looked, workspace=None)["2b_pruned_regions"].title
    count = int(panels["2_regions"].title.split()[2])
    assert f"{count} of {count} regions left" in title


def test_supporting_features_are_green_where_edges_confirm_them_and_red_where_not(looked) -> None:
    views, localizer, found = looked
    (estimate,) = found.estimates
    holes = estimate.features[-1]
    torn = replace(holes, copies=(0.0, *holes.copies[1:]))
    broken = replace(estimate, features=(*estimate.features[:-1], torn))
    (panel,) = (
        p
        for p in explain_view(views[0], localizer.extraction(views[0], WORKSPACE), [broken], localizer.models, 1)
        if p.name == "7_supporting_features"
    )
    assert "2 of 3 in sight confirmed" in panel.title
    drawn = panel.image[:380]  # without the legend
    for copy, circle in enumerate(localizer.models[0].features[-1].circles()):
        at = views[0].project(estimate.T_world_part.apply(circle.centre.copy()[None]))[0]
        reddish = drawn[..., 0].astype(int) - drawn[..., 1] > 100
        near = np.argwhere(reddish)[:, ::-1] - at
        found_red = bool((np.hypot(*near.T) < 25).any()) if len(near) else False
        assert found_red == (copy == 0)
    assert len(pixels(drawn, WHITE)) > 300, "the salient circles"


def test_the_model_is_superimposed_on_the_edges_it_was_found_on(looked) -> None:
    image = panels_of(looked)["8_poses"].image.astype(int)
    green = image[..., 1] - image[..., 0] > 40
    (estimate,) = looked[2].estimates
    outline = looked[1].models[0].features[0].circle
    at = looked[0][0].project(estimate.T_world_part.apply(outline.sample(90)))
    x, y = np.rint(at).astype(int).T
    assert green[y, x].mean() > 0.9


def test_colours_of_support_go_from_red_to_green() -> None:
    assert support_colour(0.0)[:2] == (255, 0)
    assert support_colour(0.5)[:2] == (255, 255)
    assert support_colour(1.0)[:2] == (0, 255)


def test_a_legend_covers_the_lower_left_corner_alone() -> None:
    image = np.full((480, 640, 3), 255, np.uint8)
    canvas = with_legend(image, [("few", (250, 0, 0)), ("more", (0, 250, 0))])
    changed = np.argwhere((canvas != 255).any(axis=2))
    assert changed[:, 0].min() > 400
    assert changed[:, 1].max() < 120
    red, green = (np.argwhere(canvas[..., c] > canvas[..., 1 - c])[:, 0].mean() for c in (0, 1))
    assert red < green, "the first entry stands above the second"
    assert np.array_equal(with_legend(image, []), image)
