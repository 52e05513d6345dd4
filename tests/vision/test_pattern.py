"""Patterns are learnt from drawn plates whose slots are known: every true edge, and nothing else."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle
from vision.model.vision_model import CircleFeature, Pattern
from vision.teaching.pattern import SPACING, TANGENTIAL_RAD, learn_patterns

Mask = Callable[[np.ndarray, np.ndarray], np.ndarray]
Layer = tuple[float, Mask, float]

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
DIAMETER_M, TOP_M, FLOOR_M = 0.060, 0.004, -0.003
SLOT_AT_M, SLOT_LENGTH_M, SLOT_WIDTH_M = 0.020, 0.010, 0.005
SUBPIXELS = 2


def look(tilt_deg: float, azimuth_deg: float) -> RigidTransform:
    """T_world_camera that looks at the origin; the plate fills three quarters of the picture."""
    turn = Rotation.from_euler("ZYX", [azimuth_deg, tilt_deg, 180.0], degrees=True)
    distance = DIAMETER_M * CAMERA.fy / (0.75 * CAMERA.height_px)
    return RigidTransform.from_components(-distance * turn.as_matrix()[:, 2], turn)


POSES = tuple(look(*angles) for angles in ((8, 20), (27, 45), (27, 135), (27, 225), (27, 315)))


def disc(x: float, y: float, radius: float) -> Mask:
    return lambda px, py: np.hypot(px - x, py - y) < radius


def slots(azimuths_deg: list[float]) -> Mask:
    """Rectangles that run outwards."""

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        result = np.zeros(x.shape, bool)
        for a in np.radians(azimuths_deg):
            outwards, across = np.cos(a) * x + np.sin(a) * y, np.cos(a) * y - np.sin(a) * x
            result |= (np.abs(outwards - SLOT_AT_M) < SLOT_LENGTH_M / 2) & (np.abs(across) < SLOT_WIDTH_M / 2)
        return result

    return inside


def photograph(layers: list[Layer], poses: tuple[RigidTransform, ...] = POSES, noise: float = 1.0) -> list[View]:
    """Pictures of flat shapes at some heights, painted one over the other."""
    rng = np.random.default_rng(10_700)
    height, width = CAMERA.height_px, CAMERA.width_px
    fine = [(np.arange(n * SUBPIXELS) + 0.5) / SUBPIXELS - 0.5 for n in (width, height)]
    pixels = np.stack(np.meshgrid(*fine), axis=-1).reshape(-1, 2)
    views = []
    for number, pose in enumerate(poses):
        eye, rays = pose.translation, CAMERA.rays(pixels) @ pose.rotation.as_matrix().T
        image = np.full(len(pixels), 40.0)
        for z, mask, grey in layers:
            x, y = (eye[:2] + (z - eye[2]) * rays[:, :2] / rays[:, 2:]).T
            image[mask(x, y)] = grey
        image = image.reshape(height, SUBPIXELS, width, SUBPIXELS).mean(axis=(1, 3))
        noisy = np.clip(np.round(image + rng.normal(scale=noise, size=image.shape)), 0, 255)
        views.append(View(noisy.astype(np.uint8), CAMERA, pose, f"view {number}"))
    return views


def circle(name: str, role: str, z: float, radius: float, x: float = 0.0, copies: int = 1) -> CircleFeature:
    return CircleFeature(name, role, Circle(np.array([x, 0, z]), np.array([0, 0, 1.0]), radius), "region", copies)


FEATURES = (
    circle("outline", "salient", TOP_M, DIAMETER_M / 2),
    circle("bore", "salient", TOP_M, 0.008),
    circle("foot", "salient", FLOOR_M, 0.010),
)
RING: list[Layer] = [
    (TOP_M, disc(0, 0, DIAMETER_M / 2), 170.0),
    (FLOOR_M, disc(0, 0, 0.010), 170.0),  # seen behind the bore
    (TOP_M, disc(0, 0, 0.008), 60.0),
]


def learn(layers: list[Layer], fold: int | None = 3, features: tuple[CircleFeature, ...] = FEATURES, **how):
    return learn_patterns(photograph([*RING, *layers], **how), features, DIAMETER_M, fold)


def in_slot(points: np.ndarray, azimuth_deg: float) -> np.ndarray:
    """(N, 2) outwards and across, from the middle of a slot."""
    a = np.radians(azimuth_deg)
    return points[:, :2] @ np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) - [SLOT_AT_M, 0]


def off_the_slots_m(points: np.ndarray, azimuths_deg: list[float]) -> np.ndarray:
    """Distance (N,) of points to the nearest side of a slot."""
    distances = []
    for azimuth in azimuths_deg:
        beyond = np.abs(in_slot(points, azimuth)) - [SLOT_LENGTH_M / 2, SLOT_WIDTH_M / 2]
        inside = -beyond.max(axis=1)
        distances.append(np.where(inside > 0, inside, np.hypot(*np.maximum(beyond, 0).T)))
    return np.min(distances, axis=0)


def assert_on_slots(points: np.ndarray, azimuths_deg: list[float]) -> None:
    """Blur rounds the corners of a slot by half a pixel."""
    off_mm = 1e3 * off_the_slots_m(points, azimuths_deg)
    assert np.median(off_mm) < 0.01
    assert off_mm.max() < 0.15


def turned(points: np.ndarray, angle_deg: float) -> np.ndarray:
    return points @ Rotation.from_euler("z", angle_deg, degrees=True).as_matrix().T


def farthest_m(points: np.ndarray, others: np.ndarray) -> float:
    """Largest distance of a point to the nearest other one."""
    return float(np.linalg.norm(points[:, None] - others, axis=2).min(axis=1).max())


THREE = [10.0, 130.0, 250.0]
SLOTS: Layer = (TOP_M, slots(THREE), 60.0)


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    """What is learnt of a ring with three slots."""
    (found,) = learn([SLOTS])
    return found


def test_points_lie_on_the_edges_of_the_slots(pattern):
    assert pattern.name == "pattern_front_1"
    assert pattern.normal.tolist() == [0, 0, 1]
    assert np.abs(pattern.points[:, 2] - TOP_M).max() < 5e-5
    assert_on_slots(pattern.points, THREE)


def test_directions_are_those_of_the_edges(pattern):
    for azimuth in THREE:
        at = in_slot(pattern.points, azimuth)
        side = (np.abs(at[:, 0]) < 0.4 * SLOT_LENGTH_M) & (np.abs(at[:, 1]) < SLOT_WIDTH_M)
        outwards = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0])
        assert np.count_nonzero(side) > 16
        assert np.degrees(np.arccos(np.minimum(np.abs(pattern.directions[side] @ outwards), 1))).max() < 2


def test_both_long_sides_are_covered_evenly(pattern):
    spacing = SPACING * DIAMETER_M
    for azimuth in THREE:
        at = in_slot(pattern.points, azimuth)
        for sign in (1, -1):
            along = np.sort(at[np.abs(at[:, 1] - sign * SLOT_WIDTH_M / 2) < 2e-4, 0])
            along = along[np.abs(along) < 0.4 * SLOT_LENGTH_M]  # at the corners two edges meet
            assert np.diff(along).max() < 2 * spacing
            assert np.diff(along).min() > 0.9 * spacing
            assert np.ptp(along) > 0.7 * SLOT_LENGTH_M


def test_edges_around_the_axis_are_left_out(pattern):
    radial = np.einsum("ij,ij->i", pattern.directions, pattern.points - [0, 0, TOP_M])
    assert (np.abs(radial) / np.hypot(*pattern.points[:, :2].T) > np.sin(TANGENTIAL_RAD) - 0.05).all()


def test_all_copies_are_alike(pattern):
    assert farthest_m(turned(pattern.points, 120.0), pattern.points) < 3e-6


def test_a_ring_without_slots_has_no_pattern():
    assert learn([]) == ()
    assert learn([], fold=1) == ()


def test_a_turned_part_has_the_turned_pattern(pattern):
    (other,) = learn([(TOP_M, slots([a + 37.0 for a in THREE]), 60.0)])
    assert abs(len(other.points) - len(pattern.points)) < 0.1 * len(pattern.points)
    spacing = SPACING * DIAMETER_M
    assert farthest_m(turned(pattern.points, 37.0), other.points) < 1.5 * spacing
    assert farthest_m(other.points, turned(pattern.points, 37.0)) < 1.5 * spacing
    assert_on_slots(turned(other.points, -37.0), THREE)


def test_edges_below_the_face_are_found_at_their_own_height():
    floor = [(TOP_M, disc(0, 0, 0.028), 60.0), (0.0, disc(0, 0, 0.030), 150.0), (0.0, slots(THREE), 60.0)]
    (found,) = learn([*floor, (TOP_M, disc(0, 0, 0.008), 60.0)])
    assert np.abs(found.points[:, 2]).max() < 5e-5
    assert_on_slots(found.points, THREE)


def test_a_scratch_on_one_copy_is_no_pattern_where_there_are_others(pattern):
    scratched = [SLOTS, (TOP_M, slots([70.0]), 110.0)]
    (symmetric,) = learn(scratched)
    assert_on_slots(symmetric.points, THREE)
    (alone,) = learn(scratched, fold=1)
    assert_on_slots(alone.points, [*THREE, 70.0])
    assert np.count_nonzero(off_the_slots_m(alone.points, [70.0]) < 1e-4) > 16


def test_a_highlight_that_moves_with_the_camera_is_no_pattern():
    views = [photograph([*RING, (TOP_M, slots([40.0 * k]), 220.0)], (pose,))[0] for k, pose in enumerate(POSES)]
    assert learn_patterns(views, FEATURES, DIAMETER_M, 1) == ()


def test_taught_holes_are_left_out():
    hole = circle("hole", "supporting", TOP_M, 0.003, x=0.020, copies=3)
    drawn = [(TOP_M, disc(c.centre[0], c.centre[1], c.radius_m), 60.0) for c in hole.circles()]
    assert learn(drawn, features=(*FEATURES, hole)) == ()
    (untaught,) = learn(drawn)
    centres = np.array([c.centre for c in hole.circles()])
    distances = np.linalg.norm(untaught.points[:, None] - centres, axis=2).min(axis=1)
    assert np.abs(distances - 0.003).max() < 1e-4


def test_no_pattern_tells_the_turns_of_a_part_that_looks_always_the_same():
    assert learn([SLOTS], fold=None) == ()


def test_two_views_are_too_few():
    assert learn([SLOTS], poses=POSES[:2]) == ()


def test_views_that_graze_the_face_do_not_count():
    assert learn([SLOTS], poses=(*POSES[:2], look(75, 100), look(75, 200))) == ()


def test_nothing_comes_of_blank_pictures_or_of_no_features():
    blank = [View(np.full((480, 640), 90, np.uint8), CAMERA, pose) for pose in POSES]
    assert learn_patterns(blank, FEATURES, DIAMETER_M, 3) == ()
    assert learn_patterns(blank, (), DIAMETER_M, 3) == ()
    one_that_shows = [*blank[:4], *photograph([*RING, SLOTS], POSES[4:])]
    assert learn_patterns(one_that_shows, FEATURES, DIAMETER_M, 3) == ()


def test_a_circle_far_from_the_part_does_no_harm(pattern):
    astray = circle("astray", "supporting", 3.0, 0.002, x=0.02)
    (found,) = learn([SLOTS], features=(*FEATURES, astray))
    assert_on_slots(found.points, THREE)


def test_the_back_of_a_part_shows_its_own_pattern():
    over = RigidTransform.from_rotation(Rotation.from_euler("x", np.pi))
    views = [View(v.image, v.camera, over * v.T_world_camera, v.name) for v in photograph([*RING, SLOTS])]
    flip = over.as_matrix()[:3, :3]
    features = tuple(
        CircleFeature(
            f.name, f.role, Circle(flip @ f.circle.centre, flip @ f.circle.normal, f.circle.radius_m), "region"
        )
        for f in FEATURES
    )
    (found,) = learn_patterns(views, features, DIAMETER_M, 3)
    assert found.name == "pattern_back_1"
    assert found.normal.tolist() == [0, 0, -1]
    assert_on_slots(found.points @ flip.T, THREE)


def test_learning_again_gives_the_same_points(pattern):
    (again,) = learn([SLOTS])
    assert np.array_equal(again.points, pattern.points)
    assert np.array_equal(again.directions, pattern.directions)


def test_a_pattern_stays_read_only_through_pickling(pattern):
    for it in (pattern, pickle.loads(pickle.dumps(pattern))):
        for array in (it.normal, it.points, it.directions):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
    assert np.array_equal(it.points, pattern.points)


@pytest.mark.parametrize(
    "wrong",
    [
        {"points": np.zeros((0, 3)), "directions": np.zeros((0, 3))},
        {"points": np.zeros((2, 2))},
        {"points": np.full((2, 3), np.nan)},
        {"directions": np.ones((2, 3))},
        {"directions": np.tile([1.0, 0, 0], (3, 1))},
        {"normal": np.array([0, 0, 2.0])},
    ],
    ids=lambda wrong: ",".join(wrong),
)
def test_a_pattern_that_cannot_be_is_refused(wrong):
    good = {"normal": np.array([0, 0, 1.0]), "points": np.zeros((2, 3)), "directions": np.tile([1.0, 0, 0], (2, 1))}
    with pytest.raises(InputError, match="pattern 'vents'"):
        Pattern("vents", **(good | wrong))
