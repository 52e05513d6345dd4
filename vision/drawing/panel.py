"""One picture of a stage of vision, and the canvas that it is drawn on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.drawing.strokes import Colour, Image, Strokes, enlarge, paint
from vision.frozen import frozen_arrays

_FADE = 0.45
_LEGEND_PX = 1280  # longer side of a picture whose legend is written in the font's own size
_LEGEND_LINE_PX = 34


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Panel:
    """One picture of a stage.

    Attributes:
        name: for a file, for example ``4_fragments``.
        title: for people.
        image: RGB; read-only.
    """

    name: str
    title: str
    image: Image


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Canvas:
    """The picture that the stages are drawn over.

    Attributes:
        gray: (H, W) uint8.
        zoom: whole number by which it is enlarged, so that sub-pixel lines show.
    """

    gray: NDArray[np.uint8]
    zoom: int

    @property
    def plain(self) -> Image:
        """The picture, enlarged."""
        return enlarge(self.gray, self.zoom)

    @property
    def faded(self) -> Image:
        """The picture at its own size, darker: lines show better on it."""
        return np.asarray(self.gray * _FADE, np.uint8)

    def drawn(self, *layers: tuple[Strokes, int], on: Image | None = None) -> Image:
        """Lines over the faded picture, or over a picture that is enlarged already.

        Args:
            layers: strokes in pixels of the picture, and how thick they are.
            on: what to draw on; None for the faded picture.
        """
        picture = enlarge(self.faded, self.zoom) if on is None else on
        for strokes, thickness in layers:
            moved = tuple((line + 0.5) * self.zoom - 0.5 for line in strokes.lines)
            picture = paint(picture, Strokes(moved, strokes.colours), thickness_px=thickness * self.zoom)
        return picture


def with_legend(image: Image, entries: Sequence[tuple[str, Colour]]) -> Image:
    """An RGB image with a line of text for each entry, in its colour on black, at the bottom on the left."""
    scale = max(image.shape) / _LEGEND_PX
    thickness, margin, line = max(1, round(2 * scale)), round(14 * scale), _LEGEND_LINE_PX * scale
    widths = [cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thickness)[0][0] for text, _ in entries]
    picture, bottom = image.copy(), image.shape[0]
    if entries:
        picture[max(0, bottom - round(len(entries) * line) - margin) :, : max(widths) + 2 * margin] = 0
    for number, (text, colour) in enumerate(reversed(entries)):
        at = (margin, bottom - margin - round(number * line))
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thickness, cv2.LINE_AA)
    return picture
