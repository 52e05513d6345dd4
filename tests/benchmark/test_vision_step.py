"""What the timing counts; never how fast the machine is."""

from __future__ import annotations

import time
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.report.grid import print_grids
from benchmark.timing.detector_stages import HALF, detector_grid, measure_detector, time_detector
from benchmark.timing.detector_stages import STAGES as DETECTOR_STAGES
from benchmark.timing.detector_stages import TOTAL as DETECTOR_TOTAL
from benchmark.timing.stage_clock import StageClock
from benchmark.timing.vision_step import STAGES, TOTAL, Scene, photograph, time_scene, timing_grid
from vision import localizer
from vision.errors import InputError
from vision.geometry.camera import Camera, View
from vision.geometry.workspace import Workspace
from vision.grouping import detector

CAMERA = Camera(640, 480, 2133, 2133, 319.5, 239.5)
ABOVE = RigidTransform.from_components([0.0, 0.0, 0.4], Rotation.from_euler("x", np.pi))


def times(total_ms):
    return {"hub": {**{stage: [0.001, 0.003] for stage in STAGES}, TOTAL: [total_ms / 1000]}}


def shown(grid):
    with open("/dev/null", "w") as nowhere:
        console = Console(width=120, record=True, file=nowhere)
        print_grids([grid], (), console)
    return console.export_text()


def disc(size=(240, 320)):
    picture = np.full(size, 40, np.uint8)
    return cv2.ellipse(picture, (160, 120), (80, 50), 20, 0, 360, 200, -1, cv2.LINE_AA)


@pytest.mark.parametrize(("total_ms", "verdict"), [(59.0, "met"), (61.0, "missed")])
def test_the_whole_step_stands_beside_the_target(total_ms, verdict):
    text = shown(timing_grid(times(total_ms)))
    (row,) = (line.split() for line in text.splitlines() if "Hub" in line)
    assert row[1:3] == ["2.0", "(2.8)"]  # median and 90th percentile of 1 and 3 ms
    assert row[-4:] == [f"{total_ms:.1f}", f"({total_ms:.1f})", "60,", verdict]
    assert max(map(len, text.splitlines())) <= 120


def test_the_stages_are_timed_within_the_localizer_itself():
    view = View(np.full((480, 640), 90, np.uint8), CAMERA, ABOVE)
    measured = time_scene(Scene("cover1", (view, view), Workspace((-0.05, -0.05, 0.0), (0.05, 0.05, 0.05))))
    assert set(measured) == {*STAGES, TOTAL}
    assert all(seconds > 0 for seconds in measured.values())
    assert sum(measured[stage] for stage in STAGES) <= measured[TOTAL]


def test_the_detector_is_timed_by_stages_of_its_first_look_and_by_its_second():
    measured = time_detector(disc())
    assert set(measured) == {*DETECTOR_STAGES, HALF, DETECTOR_TOTAL}
    assert all(seconds > 0 for seconds in measured.values())
    assert sum(measured.values()) - measured[DETECTOR_TOTAL] <= measured[DETECTOR_TOTAL]


def test_a_picture_too_small_for_a_second_look_has_none():
    assert time_detector(np.zeros((40, 40), np.uint8))[HALF] == 0


def test_photographs_are_read_from_a_directory_and_the_worst_is_named(tmp_path):
    for name in ("a.png", "b.JPG"):
        cv2.imwrite(str(tmp_path / name), disc())
    (tmp_path / "notes.txt").touch()
    measured = measure_detector(tmp_path, repeats=1)
    assert len(measured) == 2
    measured = [dict.fromkeys(measured[0], 0.001) | {DETECTOR_TOTAL: total} for total in (0.012, 0.024)]
    mean, worst = (line.split() for line in shown(detector_grid(measured)).splitlines() if " 20, " in line)
    assert mean == ["mean", "1.0", "1.0", "1.0", "1.0", "1.0", "18.0", "20,", "met"]
    assert worst[-3:] == ["24.0", "20,", "missed"]


@pytest.mark.parametrize("name", ["notes.txt", "broken.png"])
def test_a_directory_without_photographs_is_an_error(tmp_path, name):
    (tmp_path / name).write_text("no picture")
    with pytest.raises(InputError, match=r"photograph|picture"):
        measure_detector(tmp_path)


def test_a_clock_leaves_the_functions_as_they_were_even_after_an_error():
    before = [vars(owner)[name] for places in (*STAGES.values(), *DETECTOR_STAGES.values()) for owner, name in places]
    with pytest.raises(InputError), StageClock({**STAGES, **DETECTOR_STAGES}):
        detector.detect_ellipses("no picture")
    after = [vars(owner)[name] for places in (*STAGES.values(), *DETECTOR_STAGES.values()) for owner, name in places]
    assert all(a is b for a, b in zip(before, after, strict=True))
    assert isinstance(vars(localizer.EdgeField)["from_gray"], classmethod)


def test_a_clock_counts_the_calls_of_a_stage():
    owner = SimpleNamespace(work=lambda seconds: time.sleep(seconds), idle=lambda: None)
    with StageClock({"busy": [(owner, "work")], "idle": [(owner, "idle")]}) as clock:
        owner.work(0.002)
        middle = time.perf_counter()
        owner.work(seconds=0.001)
    assert [call.stage for call in clock.calls] == ["busy", "busy"]
    assert clock.seconds("busy") == sum(call.seconds for call in clock.calls)
    assert clock.seconds("busy", before_s=middle) == clock.calls[0].seconds
    assert clock.seconds("idle") == 0


@pytest.mark.sweep
@pytest.mark.slow
def test_a_scene_is_photographed_as_an_episode_does_it():
    scene, again = photograph("cover1", 0, views=2), photograph("cover1", 0, views=2)
    assert len(scene.views) == 2
    assert np.array_equal(scene.views[1].image, again.views[1].image)
    assert scene.views[0].gray.shape == (480, 640)
