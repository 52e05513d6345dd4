"""The Localizer protocol, views in and poses out, and the localizer of this project. None is ever given the truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar, get_args, runtime_checkable

import numpy as np

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.extraction import Arc, Extraction, ExtractionThresholds, Grouping, arcs_in, arcs_of, run_extractors
from vision.features import EllipseFeature, Extractor
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace, depth_range
from vision.matching.matcher import Matcher
from vision.matching.parameters import MatchingParameters
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate
from vision.regions.attributes import AttributeConstraints

T = TypeVar("T")

PRESETS: dict[str, tuple[Extractor, ...]] = {
    "focal": ("region", "group"),
    "focal-region": ("region",),
    "focal-group": ("group",),
}
"""This project's localizer with both extractors, and with each alone."""
RENAMED = {"dual": "focal", "region": "focal-region", "group": "focal-group"}
"""What localizers were called once, and are called now."""


def refuse_old_name(name: str) -> None:
    """Say what a localizer is called now.

    Raises:
        InputError: for a name of older versions.
    """
    if name in RENAMED:
        raise InputError("localizer", got=name, expected=RENAMED[name], do=f"It is called {RENAMED[name]} now.")


def extractors_of(choice: str | Sequence[str]) -> tuple[Extractor, ...]:
    """The extractors that a preset's name stands for, or that are named one by one; region growing comes first.

    Raises:
        InputError: when there is no such preset or extractor, or none is named.
    """
    if isinstance(choice, str):
        refuse_old_name(choice)
    named = PRESETS.get(choice, ()) if isinstance(choice, str) else tuple(choice)
    known: tuple[Extractor, ...] = get_args(Extractor)
    if not named or not all(name in known for name in named):
        expected = f"{', '.join(PRESETS)}, or a tuple with one or more of {', '.join(known)}"
        raise InputError("extractors", got=repr(choice), expected=expected)
    return tuple(extractor for extractor in known if extractor in named)


def checked_models(models: Sequence[VisionModel]) -> tuple[VisionModel, ...]:
    """The taught parts to look for.

    Raises:
        InputError: when there are none, or they are something else.
    """
    found = _sequence(models, VisionModel, "models", "Read one with vision.load_model(file).")
    if not found:
        raise InputError("models", got="none", expected="at least one taught model")
    return found


def checked_parameters(parameters: MatchingParameters | None) -> MatchingParameters:
    """Settings of the matching, the default ones for None.

    Raises:
        InputError: when they are those of something else.
    """
    if not isinstance(parameters, MatchingParameters | None):
        got = f"{type(parameters).__name__} object"
        raise InputError("parameters of the localizer", got=got, expected="vision.MatchingParameters or None")
    return parameters or MatchingParameters()


def checked_scene(views: Sequence[View], workspace: Workspace | None) -> tuple[View, ...]:
    """The views that a localizer is to look at.

    Raises:
        InputError: when they are not a sequence of views, or the workspace is none.
    """
    if not isinstance(workspace, Workspace | None):
        raise InputError("workspace", got=f"{type(workspace).__name__} object", expected="a vision.Workspace or None")
    return _sequence(views, View, "views", "Make one of image, camera and pose.")


def _sequence(values: Iterable[T], kind: type[T], what: str, do: str) -> tuple[T, ...]:
    expected = f"a sequence of vision.{kind.__name__} objects"
    if isinstance(values, kind):
        raise InputError(what, got=f"a single {kind.__name__}", expected=expected, do="Put it into a list.")
    if not isinstance(values, Iterable):
        raise InputError(what, got=f"{type(values).__name__} object", expected=expected, do=do)
    found = tuple(values)
    for value in found:
        if not isinstance(value, kind):
            raise InputError(what, got=f"{type(value).__name__} object", expected=expected, do=do)
    return found


GREY_SLACK = (0.1, 2.5)
SMALLEST_AREA_SHARE = 0.05
SMALLEST_PERIMETER_SHARE = 0.5  # of a circle: the least arc that passes for an ellipse and its chord are 0.56
SHORTEST_ARC = 0.35  # of the outline's radius


@dataclass(frozen=True, eq=False)
class Localization:
    """What a localizer says about a scene.

    Attributes:
        estimates: the poses it stands by, best first.
        features: extracted ellipses, one tuple per view; empty for methods that extract none.
        by_extractor: for methods with several extractors, what each would have said alone.
    """

    estimates: tuple[PoseEstimate, ...]
    features: tuple[tuple[EllipseFeature, ...], ...] = ()
    by_extractor: dict[str, tuple[PoseEstimate, ...]] = field(default_factory=dict)


@runtime_checkable
class Localizer(Protocol):
    """Finds taught parts in views of a scene."""

    @property
    def name(self) -> str:
        """The name under which results are recorded."""
        ...

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """Find the parts.

        Args:
            views: one or more images with intrinsics and camera poses, as far as the robot knows them.
            workspace: the box in which parts can be.
        """
        ...


class EllipseLocalizer:
    """This project's localizer: two extractors, two-phase matching on the edges of all views, pose from all views.

    ``extractors`` chooses the extractors: both ("focal"), region growing alone ("focal-region") or edge grouping
    alone ("focal-group").

    Attributes:
        models: the taught parts.
        extractors: the extractors at work.
        parameters: of the matching.
    """

    def __init__(
        self,
        models: Sequence[VisionModel],
        extractors: str | Sequence[Extractor] = "focal",
        parameters: MatchingParameters | None = None,
    ) -> None:
        """Prepare.

        Args:
            models: the taught parts to look for.
            extractors: "focal", "focal-region" or "focal-group", or a tuple with the extractors to use: of "region"
                and "group", at least one.
            parameters: settings of the matching.

        Raises:
            InputError: when there is no model, or no such extractor.
        """
        self.models = checked_models(models)
        self.extractors = extractors_of(extractors)
        self.parameters = checked_parameters(parameters)

    @property
    def name(self) -> str:
        """Focal, focal-region or focal-group."""
        return next(name for name, extractors in PRESETS.items() if extractors == self.extractors)

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """See :meth:`Localizer.localize`.

        Raises:
            InputError: when the views are not a sequence of views, or the workspace is none.
        """
        flat = [v.undistorted() for v in checked_scene(views, workspace)]
        if not flat:
            return Localization(())
        seen = [self.features_and_arcs(v, workspace) for v in flat]
        features, arcs = [s[0] for s in seen], [s[1] for s in seen]
        estimates = self._match(flat, features, arcs, workspace)
        return Localization(estimates, tuple(tuple(f) for f in features))

    def alone(
        self, views: Sequence[View], localization: Localization, workspace: Workspace | None = None
    ) -> dict[str, tuple[PoseEstimate, ...]]:
        """What the localizer with one extractor would have said, by its name, from the ellipses of a localization.

        Everything but the ellipses is the same, the arcs and the edges that poses are fitted to included.

        Args:
            views: those of the localization.
            localization: this localizer's answer.
            workspace: that of the localization.
        """
        if len(self.extractors) == 1 or not views:
            return dict.fromkeys([f"focal-{extractor}" for extractor in self.extractors], localization.estimates)
        flat = [v.undistorted() for v in views]
        arcs = [self._arcs(v, workspace, None) for v in flat]
        answers: dict[str, tuple[PoseEstimate, ...]] = {}
        for extractor in self.extractors:
            mine = [[f for f in found if f.extractor == extractor] for found in localization.features]
            answers[f"focal-{extractor}"] = self._match(flat, mine, arcs, workspace)
        return answers

    def features_and_arcs(self, view: View, workspace: Workspace | None) -> tuple[list[EllipseFeature], list[Arc]]:
        """The ellipses of a view, and the arcs to fall back on."""
        found = self.extraction(view, workspace)
        return list(found.features), self._arcs(view, workspace, found.grouping)

    def _arcs(self, view: View, workspace: Workspace | None, grouping: Grouping | None) -> list[Arc]:
        """The arcs of a view, from its fragments, where these are known already."""
        if workspace is None or not self.parameters.arcs:
            return []
        shortest_px = SHORTEST_ARC * self._outline_px(view, workspace)
        if grouping is None:
            return arcs_in(view.gray, shortest_px, common_thresholds(self.models))
        return arcs_of(grouping, shortest_px)

    def extraction(self, view: View, workspace: Workspace | None = None) -> Extraction:
        """What every stage of the extractors finds in one view with a distortion-free lens."""
        constraints = attribute_constraints(self.models, view, workspace)
        found = run_extractors(view.gray, self.extractors, constraints, common_thresholds(self.models))
        smallest, largest = self._sizes_px(view, workspace)
        return replace(
            found, features=tuple(f for f in found.features if smallest < f.ellipse.semi_axes[0] < largest)
        )

    def _outline_px(self, view: View, workspace: Workspace) -> float:
        """Radius of the smallest part's outline at the far side of the workspace."""
        outlines = [max(f.circle.radius_m for f in m.salient) for m in self.models]
        return view.camera.fx * min(outlines) / depth_range(view, workspace)[1]

    def _sizes_px(self, view: View, workspace: Workspace | None) -> tuple[float, float]:
        """The size constraint: how large the semi-major axis of any salient circle of any model can be from here."""
        if workspace is None:
            return 0.0, float("inf")
        nearest, farthest = depth_range(view, workspace)
        radii = [f.circle.radius_m for m in self.models for f in m.salient]
        fx = view.camera.fx
        return 0.85 * fx * min(radii) / farthest, 1.15 * fx * max(radii) / nearest

    def _match(
        self,
        views: Sequence[View],
        features: Sequence[Sequence[EllipseFeature]],
        arcs: Sequence[Sequence[Arc]],
        workspace: Workspace | None,
    ) -> tuple[PoseEstimate, ...]:
        fields = [EdgeField.from_gray(v.gray) for v in views]
        found = [
            estimate
            for model in self.models
            for estimate in Matcher(views, fields, model, workspace, self.parameters).match(features, arcs)
        ]
        return tuple(sorted(found, key=lambda e: -e.score))


def extract_features(
    view: View,
    extractors: str | Sequence[Extractor],
    constraints: AttributeConstraints | None = None,
    thresholds: ExtractionThresholds | None = None,
) -> list[EllipseFeature]:
    """Run extractors on a view with a distortion-free lens.

    Args:
        view: the image.
        extractors: which extractors, as of :class:`EllipseLocalizer`.
        constraints: prune the regions that no taught part can have; None prunes nothing.
        thresholds: of the extractors; None for their own.
    """
    return list(run_extractors(view.gray, extractors_of(extractors), constraints, thresholds).features)


def common_thresholds(models: Sequence[VisionModel]) -> ExtractionThresholds:
    """The thresholds that all models agree on; those of the extractors where they do not."""
    first = models[0].thresholds
    return first if all(m.thresholds == first for m in models) else ExtractionThresholds()


def attribute_constraints(
    models: Sequence[VisionModel], view: View, workspace: Workspace | None
) -> AttributeConstraints | None:
    """What the attributes of a region can be that shows a salient feature of a model (Section 5.1).

    Area and perimeter follow from the radius and the distance; a tilted or half hidden circle shows less of them. The
    taught grey levels are widened for another exposure and another light. In a heap the other attributes of regions
    that show a salient feature spread as far as those of regions that show none: of them nothing is asked.
    """
    if workspace is None:
        return None
    near, far = depth_range(view, workspace)
    radii = [f.circle.radius_m for m in models for f in m.salient]
    smallest, largest = (np.pi * (view.camera.fx * r / z) ** 2 for r, z in ((min(radii), far), (max(radii), near)))
    taught = [dict(f.attributes).get("grey_mean") for m in models for f in m.salient]
    greys = [(r.low, r.high) for r in taught if r is not None]
    grey = (
        (GREY_SLACK[0] * min(low for low, _ in greys), GREY_SLACK[1] * max(high for _, high in greys))
        if greys
        else None
    )
    return AttributeConstraints(
        area_px=(SMALLEST_AREA_SHARE * smallest, 1.3 * largest),
        perimeter_px=(SMALLEST_PERIMETER_SHARE * 2 * np.sqrt(np.pi * smallest), np.inf),
        grey_mean=grey,
    )
