"""Which extractor finds a feature: what the page proposes from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vision.geometry.ellipse import Ellipse, overlap
from vision.teaching.editor.findings import Finding, Inspector
from vision.teaching.lesson import SAME_FEATURE_OVERLAP


def how_often_found(
    finding: Finding, inspector: Inspector, overlays: Mapping[int, Mapping[str, Any] | None]
) -> dict[str, int] | None:
    """In how many of the marked views each extractor found the feature.

    Args:
        finding: the feature.
        inspector: of the lesson.
        overlays: what the extractors found, by number of the view; None where they are not done.

    Returns:
        Counts by extractor, and "views"; None where the circle is not known or nothing was extracted yet.
    """
    images = {v: image for v, image in inspector.shown_in(finding).items() if v in finding.marks}
    ready = {v: overlays[v] for v in images if overlays.get(v) is not None}
    if not ready:
        return None
    counts = {"region": 0, "group": 0, "views": len(ready)}
    for v, overlay in ready.items():
        candidates = overlay["candidates"] if overlay is not None else []
        found = {c["extractor"] for c in candidates if _is_same(images[v], c["ellipse"])}
        for extractor in found:
            counts[extractor] += 1
    return counts


def _is_same(image: Ellipse, numbers: list[float]) -> bool:
    if np.hypot(*(image.centre - numbers[:2])) > 0.2 * image.semi_axes[0] + 2:
        return False
    return overlap(Ellipse.from_geometric(*numbers), image, resolution=96) > SAME_FEATURE_OVERLAP
