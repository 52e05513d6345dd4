"""The teaching page behind the scenes: what follows from marks, autosave, workers, grasps; no browser."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse
from vision.model.vision_model import Pattern
from vision.teaching import events as ev
from vision.teaching.editor.autosave import Autosave
from vision.teaching.editor.background_extraction import BackgroundExtraction, pose_complaint
from vision.teaching.editor.browser_events import event_of_act
from vision.teaching.editor.drawing_state import difference, drawing_state, guide
from vision.teaching.editor.extractor_choice import how_often_found
from vision.teaching.editor.findings import Inspector
from vision.teaching.editor.grasp_pose import GraspPose, bore_at, grasp_on
from vision.teaching.editor.overlays import make_overlay, no_overlay, overlay_tag
from vision.teaching.editor.server import _is_worth_telling
from vision.teaching.editor.workers import StoppedError, Worker
from vision.teaching.lesson import locate
from vision.teaching.session import Session
from vision.teaching.session_file import load_session

UPRIGHT = RigidTransform.identity()


@pytest.fixture(scope="module")
def views(photograph):
    return photograph([UPRIGHT], views=5)


@pytest.fixture(scope="module")
def inspector(views):
    return Inspector(views)


@pytest.fixture(scope="module")
def outline(plate):
    return next(f.circle for f in plate.features if f.name == "outline_front")


def marked(views, circle, numbers, n=8, shift=(), sigma_px=0.5):
    """A session in which a circle has been clicked in some views; `shift` moves the clicks of one of them."""
    rng = np.random.default_rng(11_000)
    session = Session.start(views).do(ev.AddFeature("f1", "rim", "salient"))
    for v in numbers:
        pixels = project_circle(circle, views[v]).sample(n) + rng.normal(scale=sigma_px, size=(n, 2))
        if shift and v == shift[0]:
            pixels += shift[1]
        session = session.do(*(ev.AddPoint("f1", v, float(x), float(y)) for x, y in pixels))
    return session


def find(inspector, session):
    return inspector.find(session.document.feature("f1"))


def test_settled_circle_is_the_one_that_the_model_gets(views, inspector, outline):
    session = marked(views, outline, range(4))
    feature = session.document.feature("f1")
    assert not find(inspector, session).refined
    assert inspector.refine([feature])
    found = find(inspector, session)
    circle = locate(feature.taught(), views, inspector.edges).circle
    assert np.allclose(found.circle.centre, circle.centre, atol=1e-12)
    assert found.circle.radius_m == circle.radius_m
    assert found.refined
    assert not inspector.refine([feature])
    assert found.message == ""
    assert max(e.rms_px for e in found.errors.values()) < 0.5


def test_what_was_found_once_is_not_worked_out_again(views, inspector, outline):
    session = marked(views, outline, (0, 1))
    renamed = session.do(ev.RenameFeature("f1", "outline"))
    before, after = find(inspector, session), find(inspector, renamed)
    assert after.feature.name == "outline"
    assert after.solution is before.solution


def test_the_inconsistent_view_and_click_are_named(views, inspector, outline):
    finding = find(inspector, marked(views, outline, range(5), shift=(3, [12.0, 8.0])))
    assert finding.inconsistent == (3,)
    assert f"{views[3].name} disagrees with the other views: its click" in finding.message


def test_of_two_views_that_disagree_neither_is_blamed(views, inspector, outline):
    image = project_circle(outline, views[2])
    x, y, semi_major, _, angle = image.geometric
    across = Ellipse.from_geometric(x, y, semi_major, 0.5 * semi_major, angle + np.pi / 2)  # narrow the wrong way
    shift = across.sample(8) - image.sample(8)
    finding = find(inspector, marked(views, outline, (1, 2), shift=(2, shift)))
    assert finding.message.endswith("disagree. Mark a third view to see which of them is wrong.")


def test_a_salient_circle_off_the_axis_is_told(views, inspector, plate):
    hole = next(f.circle for f in plate.features if f.name == "hole_front")
    finding = find(inspector, marked(views, hole, (0, 1, 2), sigma_px=0.2))
    assert "mm off the axis" in finding.message
    assert finding.message.endswith("Make it supporting, or look at its marks again.")


def test_a_stray_click_is_named(views, inspector, outline):
    session = marked(views, outline, (0,))
    x, y = session.document.feature("f1").marks[0][5]
    session = session.do(ev.MovePoint("f1", 0, 5, x, y + 30.0))
    finding = find(inspector, session)
    assert finding.marks[0].suspects == (5,)
    assert finding.message.startswith(f"Click 6 in {views[0].name}")


def test_points_on_a_line_are_no_ellipse(views, inspector):
    session = Session.start(views).do(ev.AddFeature("f1", "rim", "salient"))
    session = session.do(*(ev.AddPoint("f1", 0, 100.0 + 20 * i, 150.0) for i in range(6)))
    assert "make no ellipse: points on a line" in find(inspector, session).message


def test_drawing_state_has_the_circle_in_every_view_that_faces_it(views, inspector, outline):
    finding = find(inspector, marked(views, outline, (0, 1)))
    state = drawing_state([finding], {"f1": "#fff"}, inspector)
    assert {key for key in state if key.startswith("circles/")} == {f"circles/{v}/f1" for v in range(5)}
    assert "px" in state["circles/0/f1"]["label"]
    assert state["circles/4/f1"]["label"] == ""


def test_drawing_state_has_a_pattern_in_every_view_of_its_face(views, inspector):
    points, along = np.array([[0.01, 0.0, 0.004], [0.011, 0.0, 0.004]]), np.tile([1.0, 0, 0], (2, 1))
    front, back = (Pattern(name, np.array([0, 0, side]), points, along) for name, side in (("a", 1.0), ("b", -1.0)))
    state = drawing_state([], {}, inspector, [front, back])
    assert {key for key in state if key.startswith("patterns/")} == {f"patterns/{v}/a" for v in range(5)}
    assert np.allclose(state["patterns/2/a"], views[2].project(points), atol=0.051)


def test_only_differences_travel():
    assert difference({"a": 1, "b": 2, "c": 3}, {"a": 1, "b": 5, "d": 4}) == {"b": 5, "d": 4, "c": None}


def test_guide_predicts_the_ellipse_in_the_next_view(views, inspector, outline):
    finding = find(inspector, marked(views, outline, (1,)))
    found = guide(finding, 2, [finding], views, 0.06)
    truth = project_circle(outline, views[2]).geometric
    assert np.allclose(found["predicted"][:4], truth[:4], atol=4.0)
    assert all(len(curve) > 1 for curve in found["curves"])
    assert guide(finding, 1, [finding], views, 0.06) is None


def test_overlay_shows_what_both_extractors_found(views, inspector, outline):
    overlay = make_overlay(views[0].gray, ExtractionThresholds())
    assert {c["extractor"] for c in overlay["candidates"]} == {"region", "group"}
    assert len(overlay["endpoints"]) == 2 * len(overlay["fragments"])
    assert max(number for group in overlay["groups"] for number in group) < len(overlay["fragments"])
    finding = find(inspector, marked(views, outline, (0, 1)))
    assert how_often_found(finding, inspector, {0: overlay, 1: None}) == {"region": 1, "group": 1, "views": 1}
    assert how_often_found(finding, inspector, {0: no_overlay()}) == {"region": 0, "group": 0, "views": 1}
    assert how_often_found(finding, inspector, {}) is None


def test_other_thresholds_have_another_tag():
    assert overlay_tag(ExtractionThresholds()) == overlay_tag(ExtractionThresholds())
    assert overlay_tag(ExtractionThresholds()) != overlay_tag(ExtractionThresholds(homogeneity=7.0))


@pytest.mark.parametrize(
    ("act", "event"),
    [
        ({"kind": "point", "view": 2, "x": 1.004, "y": 3}, ev.AddPoint("f1", 2, 1.0, 3.0)),
        ({"kind": "move", "view": 2, "index": 1, "x": 1, "y": 3}, ev.MovePoint("f1", 2, 1, 1.0, 3.0)),
        ({"kind": "remove", "view": 0, "index": 4}, ev.RemovePoint("f1", 0, 4)),
        (
            {"kind": "choose", "view": 0, "extractor": "group", "ellipse": [1, 2, 5, 4, 0]},
            ev.ChooseCandidate("f1", 0, "group", (1.0, 2.0, 5.0, 4.0, 0.0)),
        ),
    ],
)
def test_acts_become_events(act, event):
    assert event_of_act(act, "f1") == event


@pytest.mark.parametrize("act", [{"kind": "dance", "view": 0}, {"kind": "point", "view": 0, "x": "left", "y": 0}, {}])
def test_senseless_acts_are_refused(act):
    with pytest.raises(InputError, match="act of the page"):
        event_of_act(act, "f1")


def test_everything_is_on_the_disk_when_autosave_has_ended(views, tmp_path):
    stored: list[str] = []
    path = tmp_path / "session.json"
    autosave = Autosave(path, lambda tokens, problem: stored.extend([*tokens, *([problem] if problem else [])]))
    session = Session.start(views)
    for i in range(20):
        session = session.do(ev.AddFeature(f"f{i}", "rim", "salient"))
        autosave.store(session, [f"act {i}"])
    autosave.close()
    assert load_session(path) == session
    assert stored == [f"act {i}" for i in range(20)]


def test_acts_are_not_acknowledged_where_the_disk_refuses(views, tmp_path):
    heard: list[tuple[list[str], str]] = []
    autosave = Autosave(
        tmp_path / "gone" / "session.json", lambda tokens, problem: heard.append((list(tokens), problem))
    )
    autosave.store(Session.start(views), ["act"])
    autosave.close()
    ((tokens, problem),) = heard
    assert tokens == []
    assert "expected a writable file" in problem


@pytest.mark.parametrize("tilt", [0.0, 35.0, 90.0, 180.0])
@pytest.mark.parametrize("azimuth", [0.0, -120.0])
@pytest.mark.parametrize("turn", [0.0, 75.0])
def test_grasp_pose_comes_back_from_its_transform(tilt, azimuth, turn):
    pose = GraspPose(1.5, -2.0, 30.0, tilt, azimuth, turn)
    again = GraspPose.of(pose.transform())
    assert np.allclose(again.transform().as_matrix(), pose.transform().as_matrix(), atol=1e-9)
    if 0 < tilt < 180:
        assert np.allclose([again.azimuth_deg, again.turn_deg], [azimuth, turn], atol=1e-4)


def test_a_grasp_from_the_front_approaches_against_z():
    assert np.allclose(GraspPose(0, 0, 0).transform().rotation.as_matrix()[:, 2], [0, 0, -1])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_grasps_on_a_circle_reach_beyond_its_rim(side):
    circle = Circle(np.array([0.0, 0.0, 0.01 * side]), np.array([0.0, 0.0, side]), 0.02)
    for kind in ("outside", "inside"):
        pose, width_m = grasp_on(circle, kind)
        T = pose.transform()
        assert width_m == pytest.approx(0.04)
        assert np.allclose(T.rotation.as_matrix()[:, 2], -circle.normal)
        assert (T.translation - circle.centre) @ circle.normal < 0
    pose, width_m = grasp_on(circle, "rim")
    assert pose.x_mm == pytest.approx(20.0)
    assert width_m < 0.01


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_z_of_a_bore_points_into_it(side):
    circle = Circle(np.array([0.0, 0.0, 0.01 * side]), np.array([0.0, 0.0, side]), 0.02)
    assert np.allclose(bore_at(circle).apply([[0.0, 0.0, 1.0]])[0], circle.centre - circle.normal)
    assert isinstance(bore_at(circle).rotation, Rotation)


def count_to(n, report):
    for i in range(n):
        report(i)
    return n


def fail():
    raise InputError("sum", got=1, expected=2)


@pytest.mark.slow
def test_a_worker_reports_fails_and_stops():
    async def use() -> None:
        worker = Worker()
        try:
            heard: list[int] = []
            assert await worker.run(count_to, 5, on_report=heard.append) == 5
            await asyncio.sleep(0.3)
            assert heard == list(range(5))
            with pytest.raises(InputError, match="sum: got 1"):
                await worker.run(fail)
            running = asyncio.create_task(worker.run(count_to, 10**8, on_report=heard.append))
            await asyncio.sleep(0.5)
            worker.stop()
            with pytest.raises(StoppedError):
                await running
            assert await worker.run(count_to, 2, on_report=heard.append) == 2
        finally:
            worker.close()

    asyncio.run(use())


def work_without_a_report():
    threading.Event().wait(600)


@pytest.mark.slow
def test_closing_a_worker_ends_it_whatever_it_is_doing():
    async def use() -> None:
        others = multiprocessing.active_children()
        worker = Worker()
        assert await worker.run(count_to, 1, on_report=print) == 1
        children = [child for child in multiprocessing.active_children() if child not in others]
        running = asyncio.create_task(worker.run(work_without_a_report))
        await asyncio.sleep(0.2)
        worker.close()
        with pytest.raises(StoppedError):
            await asyncio.wait_for(running, 60)
        assert children
        for child in children:
            child.join(60)
            assert not child.is_alive()

    asyncio.run(use())


def test_autosave_ends_without_work(tmp_path: Path):
    Autosave(tmp_path / "session.json", lambda *_: None).close()
    assert not (tmp_path / "session.json").exists()
    assert all(thread.name != "autosave" for thread in threading.enumerate())


def test_a_request_that_ended_with_the_program_is_not_told_of_and_faults_are():
    def recorded(error):
        return logging.LogRecord("uvicorn.error", logging.ERROR, "", 0, "fault", (), (type(error), error, None))

    assert not _is_worth_telling(recorded(RuntimeError("No response returned.")))
    assert _is_worth_telling(recorded(RuntimeError("the page has a fault")))
    assert _is_worth_telling(logging.LogRecord("uvicorn.error", logging.INFO, "", 0, "started", (), None))


def test_poses_of_a_lesson_are_doubted_where_the_pictures_contradict_them(views):
    inverted = [replace(view, T_world_camera=view.T_world_camera.inv()) for view in views]
    for diameter_m in (0.0, 0.060):
        assert "read as T_camera_world" in pose_complaint(inverted, diameter_m)
        assert pose_complaint(views, diameter_m) == ""


def test_the_doubt_follows_the_overlays(views):
    far = [
        RigidTransform.from_components(1e3 * v.T_world_camera.translation, v.T_world_camera.rotation) for v in views
    ]
    extraction = BackgroundExtraction(
        [replace(view, T_world_camera=T) for view, T in zip(views[:2], far[:2], strict=True)]
    )
    told = []

    async def open_page():
        working = asyncio.ensure_future(
            extraction.keep_up(ExtractionThresholds, lambda: told.append(extraction.pose_complaint), lambda: 0.060)
        )
        while len(told) < 3:
            await asyncio.sleep(0.01)
        working.cancel()

    try:
        asyncio.run(asyncio.wait_for(open_page(), 60))
    finally:
        extraction.close()
    assert told[:2] == ["", ""]
    assert "in millimetres" in told[2]
