"""What each event does to the document of a teaching session."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vision.errors import InputError
from vision.geometry.ellipse import Ellipse
from vision.teaching import events as ev
from vision.teaching.document import Document, MarkedFeature, Point

CANDIDATE_POINTS = 24


def apply(document: Document, event: ev.Event) -> Document:
    """The document after an event that is neither undo nor redo.

    Raises:
        InputError: when the event refers to something that is not there, or says what cannot be.
    """
    return _EDITS[type(event)](document, event)


def _describe(document: Document, event: ev.DescribePart) -> Document:
    if not event.name or event.diameter_m <= 0:
        raise InputError("part", got=(event.name, event.diameter_m), expected="a name, and a diameter > 0")
    return replace(document, part=event.name, diameter_m=event.diameter_m, symmetry_fold=event.symmetry_fold)


def _add_feature(document: Document, event: ev.AddFeature) -> Document:
    if any(f.feature_id == event.feature_id for f in document.features):
        raise InputError("feature", got=event.feature_id, expected="an identifier that is not taken")
    added = MarkedFeature(event.feature_id, event.name, event.role)
    return replace(document, features=(*document.features, added))


def _remove_feature(document: Document, event: ev.RemoveFeature) -> Document:
    document.feature(event.feature_id)
    return replace(document, features=tuple(f for f in document.features if f.feature_id != event.feature_id))


def _changed(document: Document, feature_id: str, **changes: Any) -> Document:
    changed = replace(document.feature(feature_id), **changes)
    return replace(document, features=tuple(changed if f.feature_id == feature_id else f for f in document.features))


def _set_copies(document: Document, event: ev.SetCopies) -> Document:
    if event.copies < 1:
        raise InputError("copies", got=event.copies, expected="a whole number >= 1")
    return _changed(document, event.feature_id, copies=event.copies)


def _marked(document: Document, feature_id: str, view: int, points: tuple[Point, ...]) -> Document:
    if not np.isfinite(points).all():
        raise InputError("point", got=points, expected="finite pixel coordinates")
    marks = {**document.feature(feature_id).marks, view: points}
    return _changed(document, feature_id, marks={v: p for v, p in sorted(marks.items()) if p})


def _points(document: Document, event: ev.AddPoint | ev.MovePoint | ev.RemovePoint) -> tuple[Point, ...]:
    return document.feature(event.feature_id).marks.get(event.view, ())


def _add_point(document: Document, event: ev.AddPoint) -> Document:
    points = (*_points(document, event), (float(event.x), float(event.y)))
    return _marked(document, event.feature_id, event.view, points)


def _move_point(document: Document, event: ev.MovePoint) -> Document:
    points = list(_points(document, event))
    _check_index(points, event.index)
    points[event.index] = (float(event.x), float(event.y))
    return _marked(document, event.feature_id, event.view, tuple(points))


def _remove_point(document: Document, event: ev.RemovePoint) -> Document:
    points = list(_points(document, event))
    _check_index(points, event.index)
    del points[event.index]
    return _marked(document, event.feature_id, event.view, tuple(points))


def _check_index(points: Sequence[Point], index: int) -> None:
    if not 0 <= index < len(points):
        raise InputError("point", got=f"number {index}", expected=f"one of the {len(points)} points, from 0")


def _choose_candidate(document: Document, event: ev.ChooseCandidate) -> Document:
    if len(event.ellipse) != 5:
        raise InputError("ellipse", got=event.ellipse, expected="centre x, centre y, semi-axes, angle")
    sampled = Ellipse.from_geometric(*event.ellipse).sample(CANDIDATE_POINTS)
    # A thousandth of a pixel: the cosine's last bit, which differs between machines, is not part of a choice.
    points = tuple((float(x), float(y)) for x, y in np.round(sampled, 3))
    return _marked(document, event.feature_id, event.view, points)


def _place_grasp(document: Document, event: ev.PlaceGrasp) -> Document:
    ev.pose_of(event.T_part_tcp)
    if event.width_m <= 0 or event.copies < 1:
        raise InputError("grasp", got=(event.width_m, event.copies), expected="width_m > 0 and copies >= 1")
    placed = replace(event, time_s=0.0)
    if any(g.grasp_id == event.grasp_id for g in document.grasps):
        grasps = tuple(placed if g.grasp_id == event.grasp_id else g for g in document.grasps)
    else:
        grasps = (*document.grasps, placed)
    return replace(document, grasps=grasps)


def _remove_grasp(document: Document, event: ev.RemoveGrasp) -> Document:
    if all(g.grasp_id != event.grasp_id for g in document.grasps):
        raise InputError("grasp", got=event.grasp_id, expected="one of those in the document")
    return replace(document, grasps=tuple(g for g in document.grasps if g.grasp_id != event.grasp_id))


def _set_bore(document: Document, event: ev.SetBore) -> Document:
    ev.pose_of(event.T_part_bore)
    if event.diameter_m <= 0 or event.depth_m <= 0:
        raise InputError("bore", got=(event.diameter_m, event.depth_m), expected="diameter and depth > 0")
    return replace(document, bore=replace(event, time_s=0.0))


_EDITS: dict[type[ev.Event], Callable[[Document, Any], Document]] = {
    ev.DescribePart: _describe,
    ev.AddFeature: _add_feature,
    ev.RemoveFeature: _remove_feature,
    ev.RenameFeature: lambda d, e: _changed(d, e.feature_id, name=e.name),
    ev.SetRole: lambda d, e: _changed(d, e.feature_id, role=e.role),
    ev.SetExtractor: lambda d, e: _changed(d, e.feature_id, extractor=e.extractor),
    ev.SetCopies: _set_copies,
    ev.AddPoint: _add_point,
    ev.MovePoint: _move_point,
    ev.RemovePoint: _remove_point,
    ev.ClearMarks: lambda d, e: _marked(d, e.feature_id, e.view, ()),
    ev.ChooseCandidate: _choose_candidate,
    ev.PlaceGrasp: _place_grasp,
    ev.RemoveGrasp: _remove_grasp,
    ev.SetBore: _set_bore,
    ev.RemoveBore: lambda d, _: replace(d, bore=None),
    ev.SetThresholds: lambda d, e: replace(d, thresholds=e.thresholds),
}
