import cv2
import mujoco
import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import RigidTransform

from benchmark.detector import evaluate, renders
from benchmark.detector.drawings import RENDERED, draw
from benchmark.detector.evaluate import drawable
from benchmark.detector.renders import compose
from benchmark.detector.solids import random_stack, sphere_outline
from vision import detect_ellipses
from vision.errors import ResourceError
from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse


@pytest.fixture(scope="module")
def scenes():
    return [compose(np.random.default_rng(seed), "tune") for seed in range(1, 6)]


def edge_offsets(picture, ellipse):
    """Where along the normals, from -3 to 3 px, the grey level changes most, where it changes much and once."""
    outline = ellipse.sample(128)
    steps = np.arange(-3, 3.01, 0.1)
    at = outline[:, None] + steps[:, None] * ellipse.normals(outline)[:, None]
    inside = ((at > 1) & (at < np.array(picture.shape[::-1]) - 2)).all(axis=(1, 2))
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.7)
    greys = map_coordinates(smooth, at[inside].transpose(2, 0, 1)[::-1], order=3)
    slopes = np.abs(np.gradient(greys, 0.1, axis=1))
    clear = (slopes.max(axis=1) > 12) & (slopes[:, [0, -1]].max(axis=1) < 0.15 * slopes.max(axis=1))
    weights = slopes[clear] ** 2
    return weights @ steps / weights.sum(axis=1)


def test_true_ellipses_lie_on_the_rendered_edges(scenes):
    offsets = [
        edge_offsets(picture, e)
        for picture, seen in scenes
        for e, plain, _ in seen
        if plain > 0.9 and e.semi_axes[1] > 9
    ]
    together = np.concatenate(offsets)
    assert len(together) > 500
    assert abs(np.median(together)) < 0.03
    assert np.median(np.abs(together)) < 0.1


def test_outline_of_a_sphere_is_the_conic_of_its_tangent_rays():
    camera = Camera(640, 480, 800.0, 800.0, 319.5, 239.5)
    centre, radius = np.array([0.2, -0.1, 0.9]), 0.12
    view = View(np.zeros((480, 640), np.uint8), camera, RigidTransform.identity())
    found = project_circle(sphere_outline(centre, radius, np.zeros(3)), view)
    # A ray x is tangent where (x.c)² = |x|² (|c|² - r²).
    inverse = np.linalg.inv(camera.matrix)
    cone = (centre @ centre - radius**2) * np.eye(3) - np.outer(centre, centre)
    assert found.geometric == pytest.approx(Ellipse.from_conic(inverse.T @ cone @ inverse).geometric, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_stacks_rest_on_the_ground(seed):
    solid = random_stack(np.random.default_rng(seed), "stack", np.zeros(2), 0.05)
    lowest = min(c.sample(720)[:, 2].min() for c in solid.circles)
    assert lowest == pytest.approx(0, abs=1e-5)
    assert (
        max(np.linalg.norm(c.sample(90) - solid.centre, axis=1).max() for c in solid.circles) <= solid.reach_m + 1e-9
    )


def test_far_half_of_the_lower_rim_is_hidden_and_what_stands_behind_a_box_altogether():
    xml = """<mujoco><worldbody><geom type="cylinder" size=".1 .1"/>{}</worldbody></mujoco>"""
    up = np.array([0.0, 0.0, 1.0])
    camera = Camera(640, 480, 800.0, 800.0, 319.5, 239.5)
    half = np.sqrt(0.5)
    T = np.eye(4)  # from (0, 1, 1), looking down at the origin
    T[:3, :3] = np.column_stack([[-1, 0, 0], [0, half, -half], [0, -half, -half]])
    T[:3, 3] = [0, 1, 1]
    view = View(np.zeros((480, 640), np.uint8), camera, T)
    shares = []
    for more in ("", '<geom type="box" size=".2 .01 .2" pos="0 .5 .5"/>'):
        model = mujoco.MjModel.from_xml_string(xml.format(more))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for z in (0.1, -0.1):
            circle = Circle([0, 0, z], up, 0.1)
            shares.append(renders._in_sight(model, data, view, project_circle(circle, view), circle).mean())
    assert shares[0] == 1
    assert 0.4 < shares[1] <= 0.5
    assert shares[2:] == [0, 0]


def test_the_same_arguments_give_the_same_picture_and_splits_differ():
    first, again, other = (draw(split, RENDERED, 0) for split in ("tune", "tune", "test"))
    assert np.array_equal(first.image, again.image)
    assert [e.p.tolist() for e in first.ellipses] == [e.p.tolist() for e in again.ellipses]
    assert not np.array_equal(first.image, other.image)


def test_what_is_asked_for_can_be_found():
    drawings = [draw("tune", RENDERED, k) for k in range(4)]
    tally = sum((evaluate.judge(d, detect_ellipses(d.image), 0.0) for d in drawings), evaluate.Tally())
    assert tally.truths > 15
    assert tally.recall > 0.4


def test_without_opengl_rendered_pictures_are_left_out_with_a_word(monkeypatch, capsys):
    def refuse():
        raise ResourceError("OpenGL: got none")

    monkeypatch.setattr(evaluate.gl, "require_backend", refuse)
    assert drawable(("tiny", RENDERED)) == ("tiny",)
    assert capsys.readouterr().out == "rendered: left out. OpenGL: got none\n"
