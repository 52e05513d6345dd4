"""The ladder from the predecessor over the paper's system to this project's: one idea a rung."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchmark.config import LADDER
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import EllipseLocalizer, Localization, Localizer
from vision.matching.parameters import MatchingParameters
from vision.model.vision_model import VisionModel
from vision.paper.localizer import PaperLocalizer
from vision.paper.parameters import PaperParameters


@dataclass(frozen=True)
class Rung:
    """A localizer of the ladder.

    Attributes:
        inner: what localizes.
        name: the rung's.
    """

    inner: Localizer
    name: str

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """See :meth:`vision.localizer.Localizer.localize`."""
        return self.inner.localize(views, workspace)


def make_rung(name: str, models: Sequence[VisionModel], parameters: MatchingParameters) -> Rung | None:
    """The rung of that name that is no localizer by itself; None for any other name."""
    if name not in LADDER:
        return None
    if name in PAPER_RUNGS:
        return Rung(PaperLocalizer(models, "paper", PAPER_RUNGS[name]), name)
    without = WITHOUT.get(name)
    if without is None:
        return None
    switches: dict[str, Any] = dict.fromkeys(without, False)
    return Rung(EllipseLocalizer(models, "focal", replace(parameters, **switches)), name)


PAPER_RUNGS = {
    "paper-fit": PaperParameters(edge_fit=True),
    "paper-both": PaperParameters(edge_fit=True, own_extractors=True),
}
WITHOUT = {
    "edges-confirm": ("depth_search", "hiding", "patterns", "arcs"),
    "depth-search": ("hiding", "patterns", "arcs"),
    "hiding": ("patterns", "arcs"),
    "patterns": ("arcs",),
}
"""The ideas that a rung does without; what is left out here is added by the rungs above."""
