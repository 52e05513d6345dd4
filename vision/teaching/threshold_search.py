"""Thresholds that make the extractors return what the person drew: the paper's further work, 'adaptive' (Section 8).

A small and honest search: each threshold of an extractor that missed something is tried at a handful of values around
its default, one after another, on the taught views alone. What is counted is what the person can see on the page.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.features import EllipseFeature, Extractor
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse, overlap
from vision.localizer import extract_features
from vision.model.vision_model import CircleFeature
from vision.teaching.guides import faces
from vision.teaching.lesson import SAME_FEATURE_OVERLAP, Lesson, TaughtFeature, locate, propose_extractor

Report = Callable[[float], None]

FACTORS = (0.25, 0.5, 0.7, 1.4, 2.0)
"""Multiples of the default at which a threshold is tried."""

COST_OF_SPURIOUS = 0.1
"""What an ellipse of salient size that the person did not draw costs, in found features; matching can refuse it."""

_SALIENT_SIZE = (0.8, 1.25)  # of the smallest and of the largest salient ellipse in a view
_STEPS: dict[Extractor, tuple[tuple[str, ...], ...]] = {
    "region": (
        ("canny_low", "canny_high", "homogeneity"),
        ("canny_low", "canny_high"),
        ("homogeneity",),
        ("boundary_error_px",),
    ),
    "group": (("noise_factor",), ("shortest_fragment_px",), ("fitting_error_px",)),
}
"""The steps of the search for each extractor: thresholds that are scaled together. Faint steps of grey need the first
three of region growing at once: an edge that is found parts no regions which are then merged as homogeneous."""

_MOST_RUNS = 2 * len(_STEPS) + sum(len(FACTORS) * len(steps) for steps in _STEPS.values())


@dataclass(frozen=True)
class FeatureChange:
    """One taught feature in one view.

    Attributes:
        feature: its name.
        view: number of the view.
        extractor: the one that is to find it.
        before: whether it does with the present thresholds.
        after: whether it does with the proposed ones.
    """

    feature: str
    view: int
    extractor: Extractor
    before: bool
    after: bool


@dataclass(frozen=True)
class Tally:
    """What the extractors return in all views together.

    Attributes:
        found: marked features that their extractor found, counted in every view.
        total: marked features, counted in every view.
        spurious: ellipses of salient size that are no taught feature.
    """

    found: int
    total: int
    spurious: int

    @property
    def score(self) -> float:
        """What the search makes as large as it can."""
        return self.found - COST_OF_SPURIOUS * self.spurious


@dataclass(frozen=True)
class Proposal:
    """Thresholds for a part, and what they change.

    Attributes:
        thresholds: those proposed.
        before: what the extractors return with the lesson's thresholds.
        after: what they return with the proposed ones.
        changes: feature by feature and view by view.
    """

    thresholds: ExtractionThresholds
    before: Tally
    after: Tally
    changes: tuple[FeatureChange, ...]


def propose_thresholds(lesson: Lesson, views: Sequence[View], report: Report | None = None) -> Proposal:
    """Look for thresholds with which the extractors find more of what a lesson marks.

    Only the thresholds of an extractor that misses something are touched, and another value has to be better than
    the default: where nothing helps, the defaults are proposed.

    Args:
        lesson: the marks and the present thresholds.
        views: the views that the marks refer to, with distortion-free lenses.
        report: called with the share of the search that is done; what it raises ends the search.

    Raises:
        InputError: there are no features, or marks that do not make a circle.
    """
    if not lesson.features:
        raise InputError("lesson", got="no features", expected="at least one", do="Mark a feature first.")
    bench = _Bench(lesson, views, report)
    present = bench.outcome(lesson.thresholds)
    best = bench.outcome(ExtractionThresholds())
    for extractor in _STEPS:
        if best.misses(extractor):
            best = bench.improve(best, extractor)
    if present.tally.score > best.tally.score:
        best = present
    changes = tuple(
        FeatureChange(mark.feature, mark.view, mark.extractor, before, after)
        for mark, before, after in zip(bench.marks, present.found, best.found, strict=True)
    )
    return Proposal(best.thresholds, present.tally, best.tally, changes)


@dataclass(frozen=True, eq=False)
class _Mark:
    """A feature in a view where it was marked, and the ellipse that is to be found there."""

    feature: str
    view: int
    ellipse: Ellipse
    extractor: Extractor


@dataclass(frozen=True, eq=False)
class _Outcome:
    thresholds: ExtractionThresholds
    marks: Sequence[_Mark]
    found: tuple[bool, ...]
    spurious: int

    @property
    def tally(self) -> Tally:
        return Tally(sum(self.found), len(self.found), self.spurious)

    def misses(self, extractor: Extractor) -> bool:
        """Whether an extractor misses a feature that is to be found by it."""
        return any(not found and m.extractor == extractor for m, found in zip(self.marks, self.found, strict=True))


class _Bench:
    """Runs the extractors on the taught views and compares what they return with what was marked."""

    def __init__(self, lesson: Lesson, views: Sequence[View], report: Report | None) -> None:
        self._views, self._report = views, report
        self._found: dict[tuple[Extractor, tuple[float, ...]], list[list[EllipseFeature]]] = {}
        edges = [EdgeField.from_gray(view.gray) for view in views]
        circles = [locate(feature, views, edges).circle for feature in lesson.features]
        self._taught = [
            _images([copy for f, c in zip(lesson.features, circles, strict=True) for copy in _copies(f, c)], view)
            for view in views
        ]
        salient = [c for f, c in zip(lesson.features, circles, strict=True) if f.role == "salient"] or circles
        self._salient_px = [[image.semi_axes[0] for image in _images(salient, view)] for view in views]
        self.marks = [
            mark
            for f, c in zip(lesson.features, circles, strict=True)
            for mark in self._marks(f, c, lesson.thresholds)
        ]

    def _marks(self, feature: TaughtFeature, circle: Circle, present: ExtractionThresholds) -> list[_Mark]:
        """A feature in every view where it is marked; who is to find it is the person's choice, or the proposal."""
        images = {v: image for v in feature.clicks if (image := project_circle(circle, self._views[v])) is not None}
        extractor = feature.extractor
        if extractor is None:
            found = [self._run(extractor, present) for extractor in _STEPS]
            seen = [[f for by in found for f in by[v] if _same(f.ellipse, image)] for v, image in images.items()]
            extractor = propose_extractor(seen)
        return [_Mark(feature.name, v, image, extractor) for v, image in images.items()]

    def outcome(self, thresholds: ExtractionThresholds) -> _Outcome:
        found = {extractor: self._run(extractor, thresholds) for extractor in _STEPS}
        hits = tuple(
            any(_same(f.ellipse, mark.ellipse) for f in found[mark.extractor][mark.view]) for mark in self.marks
        )
        spurious = sum(self._spurious(v, found[p][v]) for p in _STEPS for v in range(len(self._views)))
        return _Outcome(thresholds, self.marks, hits, spurious)

    def improve(self, start: _Outcome, extractor: Extractor) -> _Outcome:
        """Scale each threshold of an extractor in turn; of equally good values, take the nearest to the default."""
        best = start
        for names in _STEPS[extractor]:
            for factor in sorted(FACTORS, key=lambda factor: abs(np.log(factor))):
                scaled = {name: float(f"{factor * getattr(start.thresholds, name):.4g}") for name in names}
                tried = self.outcome(replace(best.thresholds, **scaled))
                if tried.tally.score > best.tally.score + 1e-9:
                    best = tried
            if not best.misses(extractor):
                break
        return best

    def _run(self, extractor: Extractor, thresholds: ExtractionThresholds) -> list[list[EllipseFeature]]:
        """What an extractor returns in every view; kept, for the other one's thresholds do not change it."""
        names = dict.fromkeys(name for step in _STEPS[extractor] for name in step)
        key = extractor, tuple(getattr(thresholds, name) for name in names)
        if key not in self._found:
            self._found[key] = [extract_features(view, (extractor,), None, thresholds) for view in self._views]
            if self._report is not None:
                self._report(min(len(self._found) / _MOST_RUNS, 1.0))
        return self._found[key]

    def _spurious(self, view: int, found: Sequence[EllipseFeature]) -> int:
        """Number of ellipses of salient size that are no taught feature of a view."""
        sizes = self._salient_px[view]
        if not sizes:
            return 0
        low, high = _SALIENT_SIZE[0] * min(sizes), _SALIENT_SIZE[1] * max(sizes)
        large = [f.ellipse for f in found if low < f.ellipse.semi_axes[0] < high]
        return sum(not any(_same(ellipse, taught) for taught in self._taught[view]) for ellipse in large)


def _copies(feature: TaughtFeature, circle: Circle) -> list[Circle]:
    return CircleFeature(feature.name, feature.role, circle, "region", feature.copies).circles()


def _images(circles: Sequence[Circle], view: View) -> list[Ellipse]:
    """The images of the circles that face a view."""
    images = [project_circle(circle, view) for circle in circles if faces(circle, view)]
    return [image for image in images if image is not None]


def _same(found: Ellipse, marked: Ellipse) -> bool:
    """Whether an extracted ellipse is a marked one; most are far apart, which is quick to see."""
    size = marked.semi_axes[0]
    near = np.hypot(*(found.centre - marked.centre)) < 0.2 * size + 2
    alike = 0.7 < found.semi_axes[0] / size < 1.4
    return bool(near and alike) and overlap(found, marked) > SAME_FEATURE_OVERLAP
