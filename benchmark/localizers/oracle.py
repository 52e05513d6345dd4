"""The oracle: a localizer that is told where everything lies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import Localization
from vision.pose.estimate import PoseEstimate

Truth = Callable[[], Sequence[tuple[str, RigidTransform]]]


@dataclass(frozen=True)
class Oracle:
    """Knows where everything lies: the upper bound for vision, and the way to test picking alone."""

    truth: Truth
    name: str = "oracle"

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:  # noqa: ARG002
        """The true poses, whatever the views show."""
        return Localization(
            tuple(
                PoseEstimate(part, pose, 1e-12 * np.eye(6), 1.0, "oracle", 0.0, len(views), inplane_known=True)
                for part, pose in self.truth()
            )
        )
