"""What the timing counts; never how fast the machine is."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.vision_timing import STAGES, TOTAL, Scene, photograph, time_scene, timing_table
from vision.camera import Camera, View
from vision.candidates import Workspace

CAMERA = Camera(640, 480, 2133, 2133, 319.5, 239.5)
ABOVE = RigidTransform.from_components([0.0, 0.0, 0.4], Rotation.from_euler("x", np.pi))


def times(total_ms):
    return {"hub": {**{stage: [0.001, 0.003] for stage in STAGES}, TOTAL: [total_ms / 1000]}}


def shown(table):
    with open("/dev/null", "w") as nowhere:
        console = Console(width=120, record=True, file=nowhere)
        console.print(table)
    return console.export_text()


@pytest.mark.parametrize(("total_ms", "verdict"), [(59.0, "met"), (61.0, "missed")])
def test_the_total_stands_beside_the_target(total_ms, verdict):
    text = shown(timing_table(times(total_ms)))
    (row,) = (line.split() for line in text.splitlines() if "Hub" in line)
    assert row[1:3] == ["2.0", "(2.8)"]  # median and 90th percentile of 1 and 3 ms
    assert row[-4:] == [f"{total_ms:.1f}", f"({total_ms:.1f})", "60,", verdict]


def test_every_stage_is_timed_in_every_view_and_the_total_is_their_sum():
    view = View(np.full((480, 640), 90, np.uint8), CAMERA, ABOVE)
    measured = time_scene(Scene("cover1", (view, view), Workspace((-0.05, -0.05, 0.0), (0.05, 0.05, 0.05))))
    counts = {stage: len(values) for stage, values in measured.items()}
    assert counts == {**dict.fromkeys(STAGES, 2), "matching": 1, TOTAL: 1}
    means = [np.mean(measured[stage]) for stage in STAGES]
    assert measured[TOTAL][0] == pytest.approx(sum(means))


@pytest.mark.sweep
@pytest.mark.slow
def test_a_scene_is_photographed_as_an_episode_does_it():
    scene, again = photograph("cover1", 0, views=2), photograph("cover1", 0, views=2)
    assert len(scene.views) == 2
    assert np.array_equal(scene.views[1].image, again.views[1].image)
    assert scene.views[0].gray.shape == (480, 640)
