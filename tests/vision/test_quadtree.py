import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from vision.errors import InputError
from vision.regions.edge_gaps import link_edges
from vision.regions.merging import BOUNDARY, merge
from vision.regions.quadtree import SplitAndMergeParameters, split

SETTINGS = SplitAndMergeParameters()


def no_edges(gray):
    return np.zeros(gray.shape, bool)


def neighbouring_labels(labels):
    """Pairs of different labels that share a side."""
    pairs = np.vstack(
        [
            np.column_stack([labels[:, :-1].ravel(), labels[:, 1:].ravel()]),
            np.column_stack([labels[:-1].ravel(), labels[1:].ravel()]),
        ]
    )
    return {tuple(sorted(pair)) for pair in pairs[pairs[:, 0] != pairs[:, 1]].tolist()}


@settings(deadline=None, max_examples=30)
@given(
    hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=90)), st.integers(0, 2**32 - 1)
)
def test_leaves_partition_the_image_exactly(gray, seed):
    edges = np.random.default_rng(seed).random(gray.shape) < 0.02
    tree = split(gray, edges, SETTINGS)
    painted = np.zeros(gray.shape, int)
    for i, (x, y, size) in enumerate(zip(tree.x, tree.y, tree.size, strict=True)):
        painted[y : y + size, x : x + size] += 1
        assert (tree.leaf_of_pixel[y : y + size, x : x + size] == i).all()
        assert y + size <= gray.shape[0]
        assert x + size <= gray.shape[1]
    assert (painted == 1).all()
    assert (tree.is_edge[tree.leaf_of_pixel] == edges).all()
    assert tree.grey_sum.sum() == gray.sum(dtype=int)


@settings(deadline=None, max_examples=30)
@given(hnp.arrays(np.uint8, (70, 50), elements=st.integers(90, 130)))
def test_every_leaf_above_one_pixel_is_homogeneous(gray):
    tree = split(gray, no_edges(gray), SETTINGS)
    for x, y, size in zip(tree.x, tree.y, tree.size, strict=True):
        block = gray[y : y + size, x : x + size]
        if size > 1:
            assert block.std() <= SETTINGS.max_deviation + 1e-9
            assert np.ptp(block) <= SETTINGS.max_range


@pytest.mark.parametrize("shape", [(1, 1), (64, 64), (97, 201), (480, 640)])
def test_a_constant_image_is_one_region_of_the_largest_possible_leaves(shape):
    gray = np.full(shape, 77, np.uint8)
    tree = split(gray, no_edges(gray), SETTINGS)
    labels = merge(tree, SETTINGS)
    assert (labels == 1).all()
    assert np.count_nonzero(tree.size == 64) == (shape[0] // 64) * (shape[1] // 64)


def test_an_edge_separates_two_sides_of_equal_grey():
    gray = np.full((60, 60), 100, np.uint8)
    edges = no_edges(gray)
    edges[np.arange(60), np.arange(60)] = True
    labels = merge(split(gray, edges, SETTINGS), SETTINGS)
    image = labels[split(gray, edges, SETTINGS).leaf_of_pixel]
    assert set(np.unique(image)) == {BOUNDARY, 1, 2}
    assert (1, 2) not in neighbouring_labels(image)
    assert (image[edges] == BOUNDARY).all()


def test_without_edges_two_sides_are_distinguishable_by_grey_alone():
    gray = np.full((64, 64), 60, np.uint8)
    gray[:, 37:] = 160
    tree = split(gray, no_edges(gray), SETTINGS)
    image = merge(tree, SETTINGS)[tree.leaf_of_pixel]
    assert len(np.unique(image)) == 2
    assert (image[:, :37] == image[0, 0]).all()
    assert (image[:, 37:] == image[0, -1]).all()


def test_a_gentle_shade_is_one_region():
    gray = np.tile(np.linspace(80, 110, 200).astype(np.uint8), (100, 1))
    tree = split(gray, no_edges(gray), SETTINGS)
    assert merge(tree, SETTINGS).max() == 1


def test_specks_join_their_neighbour_unless_an_edge_encloses_them():
    gray = np.full((40, 40), 100, np.uint8)
    gray[10, 10] = gray[30, 30] = 250
    edges = no_edges(gray)
    edges[29:32, 29:32] = True
    edges[30, 30] = False
    tree = split(gray, edges, SETTINGS)
    image = merge(tree, SETTINGS)[tree.leaf_of_pixel]
    assert image[10, 10] == image[0, 0] == 1
    assert image[30, 30] == BOUNDARY


def test_a_quarter_turn_turns_the_regions():
    gray = np.full((128, 128), 50, np.uint8)
    cv2.circle(gray, (70, 50), 30, 150, -1)
    images = []
    for turned in (gray, np.rot90(gray).copy()):
        tree = split(turned, no_edges(turned), SETTINGS)
        images.append(merge(tree, SETTINGS)[tree.leaf_of_pixel])
    assert (np.rot90(images[0] == images[0][50, 70]) == (images[1] == images[1][57, 50])).all()


def t_junction(gap_px):
    edges = np.zeros((60, 60), bool)
    edges[20, 5:55] = True
    edges[21 + gap_px : 50, 30] = True
    return edges


@pytest.mark.parametrize("gap", [0, 1, 2, 3])
def test_a_t_junction_with_a_gap_closes(gap):
    linked = link_edges(t_junction(gap), gap_px=3)
    assert linked[20:50, 30].all()
    assert linked.sum() == t_junction(0).sum()


def test_a_longer_gap_stays_open():
    assert (link_edges(t_junction(5), gap_px=3) == t_junction(5)).all()


def test_two_ends_that_face_each_other_are_joined():
    edges = np.zeros((40, 60), bool)
    edges[20, 5:25] = edges[20, 28:50] = True
    assert link_edges(edges, gap_px=4)[20, 5:50].all()


def test_a_slanted_stem_is_led_on_along_its_tangent():
    edges = np.zeros((60, 60), bool)
    edges[40, 5:55] = True
    edges[np.arange(15, 37), np.arange(15, 37)] = True
    linked = link_edges(edges, gap_px=4)
    assert linked[np.arange(15, 41), np.arange(15, 41)].all()


def test_linking_closes_a_disc_whose_outline_has_gaps():
    outline = np.zeros((100, 100), np.uint8)
    cv2.circle(outline, (50, 50), 30, 1, 1)
    edges = outline.astype(bool)
    edges[49:52, 75:85] = False
    gray = np.full(edges.shape, 100, np.uint8)

    def regions(edge_map):
        return merge(split(gray, edge_map, SETTINGS), SETTINGS).max()

    assert regions(edges) == 1
    assert regions(link_edges(edges, gap_px=4)) == 2


@settings(deadline=None, max_examples=30)
@given(hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40)))
def test_linking_only_adds_edges(edges):
    assert (link_edges(edges) >= edges).all()


def test_bad_settings_and_maps_are_refused():
    with pytest.raises(InputError, match="power of two"):
        SplitAndMergeParameters(root_size_px=48)
    with pytest.raises(InputError, match="max_deviation"):
        SplitAndMergeParameters(max_deviation=float("nan"))
    with pytest.raises(InputError, match="edge map"):
        link_edges(np.zeros(5, bool))
    with pytest.raises(InputError, match="gap_px"):
        link_edges(np.zeros((5, 5), bool), gap_px=-1)
