"""A session is its events: what they do to the document, that undo restores exactly, and what is refused."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.geometry.camera import Camera, View
from vision.geometry.circle import project_circle
from vision.geometry.ellipse import Ellipse
from vision.teaching import events as ev
from vision.teaching.session import Document, Session, build_model

POSE = ev.matrix_of(RigidTransform.from_components([0.01, 0.0, -0.02], Rotation.from_euler("xyz", [0.1, 0.2, 0.3])))
DESCRIBE = ev.DescribePart("plate", 0.06, 3)


def blank_view(name, grey=90):
    camera = Camera(64, 48, 200.0, 200.0, 31.5, 23.5)
    return View(np.full((48, 64), grey, np.uint8), camera, RigidTransform.identity(), name)


VIEWS = [blank_view("a"), blank_view("b")]


def begun(*events):
    return Session.start(VIEWS).do(DESCRIBE, ev.AddFeature("f1", "rim", "salient"), *events)


def points(session, view=0):
    return session.document.feature("f1").marks.get(view)


def test_points_are_added_moved_and_removed():
    session = begun(ev.AddPoint("f1", 0, 1.0, 2.0), ev.AddPoint("f1", 0, 3.0, 4.0), ev.AddPoint("f1", 1, 5.0, 6.0))
    assert points(session) == ((1.0, 2.0), (3.0, 4.0))
    assert points(session.do(ev.MovePoint("f1", 0, 1, 7.5, 8.0))) == ((1.0, 2.0), (7.5, 8.0))
    assert points(session.do(ev.RemovePoint("f1", 0, 0))) == ((3.0, 4.0),)
    assert points(session.do(ev.ClearMarks("f1", 0))) is None
    assert points(session.do(ev.ClearMarks("f1", 0)), view=1) == ((5.0, 6.0),)


def test_a_feature_can_be_described_anew_and_given_up():
    session = begun(
        ev.RenameFeature("f1", "bore"),
        ev.SetRole("f1", "supporting"),
        ev.SetCopies("f1", 5),
        ev.SetExtractor("f1", "group"),
    )
    feature = session.document.feature("f1")
    assert (feature.name, feature.role, feature.copies, feature.extractor) == ("bore", "supporting", 5, "group")
    assert session.do(ev.SetExtractor("f1", None)).document.feature("f1").extractor is None
    assert session.do(ev.RemoveFeature("f1")).document.features == ()


def test_a_chosen_candidate_replaces_the_marks_in_its_view():
    session = begun(ev.AddPoint("f1", 0, 1.0, 2.0), ev.AddPoint("f1", 1, 5.0, 6.0))
    session = session.do(ev.ChooseCandidate("f1", 0, "region", (30.0, 20.0, 12.0, 9.0, 0.4)))
    assert len(points(session)) >= 12
    ellipse = Ellipse.from_geometric(30.0, 20.0, 12.0, 9.0, 0.4)
    assert np.abs(ellipse.distance(points(session))).max() < 2e-3
    assert points(session, view=1) == ((5.0, 6.0),)


def test_grasps_and_bore_are_placed_moved_and_taken_away():
    grasp = ev.PlaceGrasp("g1", "rim", POSE, 0.06, "outside", 12, time_s=3.0)
    session = begun(grasp, ev.SetBore(POSE, 0.02, 0.01, time_s=4.0))
    (placed,) = session.document.grasp_coordinates()
    assert (placed.name, placed.width_m, placed.kind, placed.copies) == ("rim", 0.06, "outside", 12)
    assert np.allclose(placed.T_part_tcp.as_matrix(), POSE, atol=1e-12)
    assert session.document.bore_coordinates().depth_m == 0.01
    moved = session.do(
        ev.PlaceGrasp("g1", "rim", POSE, 0.05, "inside"), ev.PlaceGrasp("g2", "b", POSE, 0.01, "inside")
    )
    assert [g.width_m for g in moved.document.grasp_coordinates()] == [0.05, 0.01]
    emptied = moved.do(ev.RemoveGrasp("g1"), ev.RemoveGrasp("g2"), ev.RemoveBore())
    assert emptied.document.grasps == ()
    assert emptied.document.bore_coordinates() is None


def test_time_has_no_effect():
    early, late = (begun(ev.SetBore(POSE, 0.02, 0.01, time_s=t)) for t in (1.0, 2.0))
    assert early.document == late.document
    assert early.events != late.events


WRONG = [
    ev.AddFeature("f1", "again", "salient"),
    ev.RemoveFeature("f2"),
    ev.RenameFeature("f2", "x"),
    ev.SetCopies("f1", 0),
    ev.AddPoint("f2", 0, 1.0, 1.0),
    ev.AddPoint("f1", 2, 1.0, 1.0),
    ev.AddPoint("f1", -1, 1.0, 1.0),
    ev.AddPoint("f1", 0, float("nan"), 1.0),
    ev.MovePoint("f1", 0, 1, 1.0, 1.0),
    ev.MovePoint("f1", 0, -1, 1.0, 1.0),
    ev.RemovePoint("f1", 1, 0),
    ev.ChooseCandidate("f1", 0, "region", (1.0, 2.0, 3.0)),
    ev.RemoveGrasp("g1"),
    ev.PlaceGrasp("g1", "rim", POSE, 0.0, "outside"),
    ev.PlaceGrasp("g1", "rim", ((1.0,) * 4,) * 4, 0.01, "outside"),
    ev.SetBore(((2.0, 0, 0, 0), (0, 2.0, 0, 0), (0, 0, 2.0, 0), (0, 0, 0, 1.0)), 0.02, 0.01),
    ev.SetBore(POSE, 0.02, 0.0),
    ev.DescribePart("", 0.06),
    ev.DescribePart("plate", 0.0),
    ev.Redo(),
]


@pytest.mark.parametrize("event", WRONG, ids=lambda e: type(e).__name__)
def test_what_cannot_be_done_is_refused_and_leaves_the_session_as_it_was(event):
    session = begun(ev.AddPoint("f1", 0, 1.0, 2.0))
    before = (session.document, session.events)
    with pytest.raises(InputError):
        session.do(event)
    assert (session.document, session.events) == before


def test_nothing_can_be_undone_at_the_beginning():
    session = Session.start(VIEWS)
    assert not session.can_undo
    assert not session.can_redo
    with pytest.raises(InputError, match="undo"):
        session.do(ev.Undo())


def test_undo_and_redo_restore_exactly():
    session = begun(ev.AddPoint("f1", 0, 1.0, 2.0))
    moved = session.do(ev.MovePoint("f1", 0, 0, 9.0, 9.0))
    undone = moved.do(ev.Undo())
    assert undone.document == session.document
    assert undone.can_redo
    assert undone.do(ev.Redo()).document == moved.document
    assert not undone.do(ev.AddPoint("f1", 0, 4.0, 4.0)).can_redo


def test_an_event_that_changes_nothing_is_kept_but_is_no_step_for_undo():
    session = begun(ev.AddPoint("f1", 0, 1.0, 2.0))
    same = session.do(ev.RenameFeature("f1", "rim"))
    assert len(same.events) == len(session.events) + 1
    assert same.do(ev.Undo()).document == session.do(ev.Undo()).document


changes = st.lists(
    st.one_of(
        st.builds(ev.AddPoint, st.just("f1"), st.integers(0, 1), st.floats(0, 63), st.floats(0, 47)),
        st.builds(ev.RenameFeature, st.just("f1"), st.sampled_from(["rim", "bore"])),
        st.builds(ev.SetRole, st.just("f1"), st.sampled_from(["salient", "supporting"])),
        st.builds(ev.ClearMarks, st.just("f1"), st.integers(0, 1)),
        st.builds(ev.SetThresholds, st.builds(ExtractionThresholds, homogeneity=st.floats(1, 9))),
        st.just(ev.RemoveBore()),
        st.builds(ev.SetBore, st.just(POSE), st.floats(0.01, 0.02), st.just(0.01)),
    ),
    max_size=12,
)


@settings(max_examples=60, deadline=None)
@given(changes=changes)
def test_undoing_everything_goes_back_through_every_document_and_redoing_forward(changes):
    session = begun()
    documents = [session.document]
    for change in changes:
        session = session.do(change)
        if session.document != documents[-1]:
            documents.append(session.document)
    for document in reversed(documents[:-1]):
        session = session.do(ev.Undo())
        assert session.document == document
    for document in documents[1:]:
        session = session.do(ev.Redo())
        assert session.document == document


def test_a_lesson_needs_a_described_part_and_two_marked_views():
    with pytest.raises(InputError, match="Describe the part"):
        Document().lesson()
    session = begun(*[ev.AddPoint("f1", 0, float(i), float(i * i)) for i in range(6)])
    with pytest.raises(InputError, match=r"feature .rim.: .*two views"):
        session.document.lesson()
    four = session.do(*[ev.AddPoint("f1", 1, float(i), float(i * i)) for i in range(4)])
    with pytest.raises(InputError, match=r"feature .rim.: .*two views"):
        four.document.lesson()
    lesson = four.do(ev.AddPoint("f1", 1, 9.0, 9.0)).document.lesson()
    assert (lesson.part, lesson.diameter_m, lesson.symmetry_fold) == ("plate", 0.06, 3)
    assert {v: len(clicks) for v, clicks in lesson.features[0].clicks.items()} == {0: 6, 1: 5}


def test_the_views_of_another_session_are_refused():
    session = Session.start(VIEWS)
    session.check([blank_view("a"), blank_view("b")])
    for others in ([VIEWS[0]], [VIEWS[0], blank_view("b", grey=91)], VIEWS[::-1]):
        with pytest.raises(InputError):
            session.check(others)


@pytest.fixture(scope="module")
def taught(plate, photograph, pose):
    """Session and views of the plate's bore, clicked in three views."""
    views = photograph([pose()], views=3)
    circle = next(f.circle for f in plate.features if f.name == "bore_front")
    rng = np.random.default_rng(10_050)
    session = Session.start(views).do(DESCRIBE, ev.AddFeature("f1", "bore", "salient"))
    for number, view in enumerate(views):
        clicks = project_circle(circle, view).sample(8) + rng.normal(scale=0.5, size=(8, 2))
        session = session.do(*[ev.AddPoint("f1", number, float(x), float(y)) for x, y in clicks])
    return session, views, circle


def test_a_session_makes_the_model_with_its_thresholds(taught):
    session, views, circle = taught
    adapted = ExtractionThresholds(homogeneity=5.0)
    model = build_model(session.do(ev.SetThresholds(adapted)), views)
    assert model.thresholds == adapted
    (feature,) = model.features
    assert 1e3 * abs(feature.circle.radius_m - circle.radius_m) < 0.1
    assert 1e3 * np.linalg.norm(feature.circle.centre - circle.centre) < 0.1


def test_a_session_makes_no_model_of_other_views(taught):
    session, views, _ = taught
    with pytest.raises(InputError, match="recorded on"):
        build_model(session, [views[1], views[0], views[2]])
