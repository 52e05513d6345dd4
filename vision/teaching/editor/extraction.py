"""Runs the extractors on the views in the background and keeps what they found, by thresholds."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

from vision.errors import FocalpickError
from vision.extraction import ExtractionThresholds
from vision.geometry.camera import View
from vision.teaching.editor.overlays import make_overlay, no_overlay, overlay_tag
from vision.teaching.editor.workers import Worker

IDLE_S = 0.2


class Extraction:
    """The overlays of all views."""

    def __init__(self, views: Sequence[View]) -> None:
        """Nothing runs yet.

        Args:
            views: distortion-free ones.
        """
        self._views = views
        self._worker = Worker()
        self._overlays: dict[tuple[str, int], dict[str, Any]] = {}

    async def keep_up(self, thresholds: Callable[[], ExtractionThresholds], tell: Callable[[], None]) -> None:
        """Run the extractors on every view, and again whenever the thresholds change; never ends.

        Args:
            thresholds: the present ones.
            tell: called when another view is done.
        """
        while True:
            present = thresholds()
            missing = [n for n in range(len(self._views)) if n not in self.ready(present)]
            if not missing:
                await asyncio.sleep(IDLE_S)
                continue
            self._overlays[overlay_tag(present), missing[0]] = await self._extract(missing[0], present)
            tell()

    async def _extract(self, number: int, thresholds: ExtractionThresholds) -> dict[str, Any]:
        try:
            return await self._worker.run(make_overlay, self._views[number].gray, thresholds)
        except FocalpickError:
            return no_overlay()

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
