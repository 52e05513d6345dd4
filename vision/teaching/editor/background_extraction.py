"""Runs the extractors on the views in the background: keeps what they found, by thresholds, and doubts the poses."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

from vision.errors import FocalpickError
from vision.extraction import ExtractionThresholds
from vision.geometry.camera import View
from vision.matching.pose_check import USUAL_RADII_M, check_poses
from vision.teaching.editor.overlays import make_overlay, no_overlay, overlay_tag
from vision.teaching.editor.workers import Worker

IDLE_S = 0.2
SMALLEST_SHARE = 0.02  # of a part's diameter: the radius of a circle worth teaching


class BackgroundExtraction:
    """The overlays of all views.

    Attributes:
        pose_complaint: how the pictures contradict the poses of the views; "" where they do not, as far as is known.
    """

    def __init__(self, views: Sequence[View]) -> None:
        """Nothing runs yet.

        Args:
            views: distortion-free ones.
        """
        self._views = views
        self._worker = Worker()
        self._overlays: dict[tuple[str, int], dict[str, Any]] = {}
        self.pose_complaint = ""
        self._checked_for_m: float | None = None

    async def keep_up(
        self,
        thresholds: Callable[[], ExtractionThresholds],
        tell: Callable[[], None],
        diameter_m: Callable[[], float],
    ) -> None:
        """Run the extractors on every view, and again whenever the thresholds change; never ends.

        Args:
            thresholds: the present ones.
            tell: called when another view is done, or the poses are doubtful.
            diameter_m: of the part; 0 until it is described.
        """
        while True:
            present = thresholds()
            missing = [n for n in range(len(self._views)) if n not in self.ready(present)]
            if missing:
                self._overlays[overlay_tag(present), missing[0]] = await self._extract(missing[0], present)
                tell()
            elif self._checked_for_m != diameter_m():
                self._checked_for_m = diameter_m()
                self.pose_complaint = await self._doubt_poses(self._checked_for_m)
                tell()
            else:
                await asyncio.sleep(IDLE_S)

    async def _extract(self, number: int, thresholds: ExtractionThresholds) -> dict[str, Any]:
        try:
            return await self._worker.run(make_overlay, self._views[number].gray, thresholds)
        except FocalpickError:
            return no_overlay()

    async def _doubt_poses(self, diameter_m: float) -> str:
        try:
            return await self._worker.run(pose_complaint, self._views, diameter_m)
        except FocalpickError:
            return ""

    def ready(self, thresholds: ExtractionThresholds) -> dict[int, str]:
        """The tags of the overlays that are there for some thresholds, by number of the view."""
        tag = overlay_tag(thresholds)
        return {number: tag for number in range(len(self._views)) if (tag, number) in self._overlays}

    def overlay(self, tag: str, number: int) -> dict[str, Any] | None:
        """What the extractors found in a view, see :func:`make_overlay`; None where they are not done."""
        return self._overlays.get((tag, number))

    def close(self) -> None:
        """End the process."""
        self._worker.close()


def pose_complaint(views: Sequence[View], diameter_m: float) -> str:
    """How the pictures contradict the poses from which they were taken; "" where they do not.

    Args:
        views: of the lesson.
        diameter_m: of the part, which tells the unit of the poses; 0 where it is not known.
    """
    radii = (SMALLEST_SHARE * diameter_m, diameter_m / 2) if diameter_m > 0 else USUAL_RADII_M
    complaint = check_poses(views, radii_m=radii).complaint
    return f"{complaint} (of a lesson the world is the part; docs/vision.md, 'Conventions')" if complaint else ""
