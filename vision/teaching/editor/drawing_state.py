"""What the page draws, as a flat table of small JSON values: only those that changed travel to the browser.

Keys are ``features`` (names and colours), ``marks/VIEW/FEATURE``, ``circles/VIEW/FEATURE`` and
``patterns/VIEW/PATTERN``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vision.geometry.camera import View
from vision.geometry.ellipse import Ellipse
from vision.model.vision_model import Pattern
from vision.teaching.document import MarkedFeature
from vision.teaching.editor.findings import Finding, Inspector, Mark
from vision.teaching.guides import epipolar_curve, predict_ellipse

State = dict[str, Any]

PALETTE = (
    "#4cc9f0",
    "#ffb86b",
    "#7ee787",
    "#f783ac",
    "#ffe066",
    "#b197fc",
    "#38d9a9",
    "#ff8a65",
    "#c0eb75",
    "#91a7ff",
    "#f0a6ff",
    "#66d9e8",
)
"""Colours of the features, told apart on grey pictures."""

GUIDE_CURVES = 8
REACH_OF_RADIUS = 1.3  # how far from the origin a guide looks for the point, over the part's radius


def drawing_state(
    findings: Sequence[Finding], colours: Mapping[str, str], inspector: Inspector, patterns: Sequence[Pattern] = ()
) -> State:
    """Everything that is drawn into the pictures, apart from guides.

    Args:
        findings: of all features.
        colours: by identifier of the feature.
        inspector: of the lesson.
        patterns: that were learnt without marks.
    """
    features = [f.feature for f in findings]
    state: State = {"features": {f.feature_id: {"name": f.name, "colour": colours[f.feature_id]} for f in features}}
    for finding in findings:
        name = finding.feature.feature_id
        for v, mark in finding.marks.items():
            state[f"marks/{v}/{name}"] = _mark(mark)
        for v, image in inspector.shown_in(finding).items():
            state[f"circles/{v}/{name}"] = _circle(finding, v, image)
    for pattern in patterns:
        for v, view in enumerate(inspector.views):
            if (view.T_world_camera.translation - pattern.points[0]) @ pattern.normal > 0:
                state[f"patterns/{v}/{pattern.name}"] = view.project(pattern.points).round(1).tolist()
    return state


def difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> State:
    """What changed; None for what is gone."""
    changed = {key: value for key, value in after.items() if key not in before or before[key] != value}
    return {**changed, **{key: None for key in before if key not in after}}


def guide(
    finding: Finding, view: int, findings: Sequence[Finding], views: Sequence[View], diameter_m: float
) -> State | None:
    """Where to look for a feature in a view in which it is not marked yet, from one in which it is."""
    others = {v: m for v, m in finding.marks.items() if v != view}
    marked_here = view in finding.marks and finding.marks[view].ellipse is not None
    if marked_here or not others or finding.circle is not None:
        return None
    number, mark = next(iter(others.items()))
    pixels = mark.ellipse.sample(GUIDE_CURVES) if mark.ellipse else mark.points[:GUIDE_CURVES]
    within = 0.5 * REACH_OF_RADIUS * diameter_m if diameter_m > 0 else None
    curves = [epipolar_curve(pixel, views[number], views[view], within_m=within) for pixel in pixels]
    return {
        "view": view,
        "feature": finding.feature.feature_id,
        "curves": [curve.round(1).tolist() for curve in curves if len(curve) > 1],
        "predicted": _predicted(finding.feature, others, view, findings, views),
    }


def _predicted(
    feature: MarkedFeature, others: Mapping[int, Mark], view: int, findings: Sequence[Finding], views: Sequence[View]
) -> list[float] | None:
    usable = {v: m.edge_points for v, m in others.items() if m.edge_points is not None}
    if not usable:
        return None
    height = _likely_height(findings, views[next(iter(usable))])
    found = predict_ellipse(views, usable, view, coaxial=feature.role == "salient", height_m=height)
    return ellipse_numbers(found) if found is not None else None


def _likely_height(findings: Sequence[Finding], view: View) -> float:
    """The height of the known circle nearest to the camera: holes are mostly in such a face."""
    heights = [f.circle.centre[2] for f in findings if f.circle is not None]
    return float(max(heights, key=lambda z: np.sign(view.T_world_camera.translation[2]) * z, default=0.0))


def ellipse_numbers(ellipse: Ellipse) -> list[float]:
    """Centre, semi-axes and angle, as the page draws it."""
    return ellipse.geometric.round(3).tolist()


def _mark(mark: Mark) -> State:
    return {
        "points": mark.points.round(3).tolist(),
        "ellipse": ellipse_numbers(mark.ellipse) if mark.ellipse is not None else None,
        "suspects": list(mark.suspects),
    }


def _circle(finding: Finding, view: int, image: Ellipse) -> State:
    error = finding.errors.get(view)
    return {
        "ellipse": ellipse_numbers(image),
        "bad": view in finding.inconsistent,
        "label": f"{error.rms_px:.2f} px  {error.rms_mm:.3f} mm" if error is not None else "",
    }
