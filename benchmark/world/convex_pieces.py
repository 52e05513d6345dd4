"""Cuts a round solid into few convex pieces that keep its bore and its hollows open.

The simulator takes every collision mesh for its convex hull. A round part is therefore cut like a cake, into equal
sectors, and these into rings and layers, where that brings the hulls nearest to the solid.

The hulls are Qhull's: those of manifold3d 3.5 are wrong now and then, by a few per cent of the volume.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from benchmark.world.shapes import BEYOND

Floats = NDArray[np.float64]

SECTORS = 12
MOST_SECTORS = 15
MOST_PIECES = 63
GOOD_EXCESS = 0.02  # of the solid's volume, that hulls may add before a further cut is worth its pieces
MOST_CUTS_TRIED = 10  # in either direction
SLIVER_MM3 = 1e-6
NEGLIGIBLE = 1e-6  # of the solid's volume: what a hole leaves of a sector, or what a cut gains


@dataclass(frozen=True)
class Cell:
    """The points between two radii and two heights."""

    inner: float
    outer: float
    bottom: float
    top: float

    def parts(self, axis: str, at: float) -> tuple[Cell, Cell]:
        """The cell below and above a cut, at a radius (``r``) or a height (``z``)."""
        if axis == "r":
            return replace(self, outer=at), replace(self, inner=at)
        return replace(self, top=at), replace(self, bottom=at)


@dataclass(frozen=True)
class _Cut:
    halves: tuple[Cell, Cell]
    gain: float


@dataclass(frozen=True, eq=False)
class ConvexPieces:
    """A solid as convex pieces.

    Attributes:
        pieces: the pieces in millimetres; neighbours touch.
        excess: volume that the pieces have more than the solid, over the solid's.
    """

    pieces: list[trimesh.Trimesh]
    excess: float


def convex_pieces(solid: Manifold, fold: int | None) -> ConvexPieces:
    """Cut a solid into convex pieces, at most `MOST_PIECES`.

    Args:
        solid: round about z, in millimetres.
        fold: of its symmetry; the cuts of the cake follow it, and only one sector in each repetition is weighed.
    """
    sectors = _sectors(fold)
    wedges = [_wedge(solid, number, sectors) for number in range(sectors)]
    distinct = wedges[: 1 if fold is None else sectors // math.gcd(sectors, fold)]
    cells = _cells(distinct, _whole(solid), sectors)
    smallest = NEGLIGIBLE * solid.volume()
    filled = [piece for cell in cells for piece in _fill(wedges, cell, sectors) if piece.volume() > smallest]
    pieces = [trimesh.convex.convex_hull(_vertices(piece)) for piece in filled]
    return ConvexPieces(pieces, float(sum(piece.volume for piece in pieces)) / solid.volume() - 1)


def _sectors(fold: int | None) -> int:
    """A number of sectors near `SECTORS` that the symmetry repeats, so that spokes and windows fall alike."""
    if fold is None or fold > MOST_SECTORS:
        return SECTORS
    return max(1, round(SECTORS / fold)) * fold


def _wedge(solid: Manifold, number: int, sectors: int) -> Manifold:
    """One of the equal sectors; the first is centred on +x."""
    start, stop = (2 * np.pi * (number + side) / sectors for side in (-0.5, 0.5))
    half = solid.trim_by_plane((-np.sin(start), np.cos(start), 0.0), 0.0)
    return half.trim_by_plane((np.sin(stop), -np.cos(stop), 0.0), 0.0)


def _whole(solid: Manifold) -> Cell:
    x0, y0, bottom, x1, y1, top = solid.bounding_box()
    return Cell(0.0, 2 * float(max(-x0, x1, -y0, y1)), bottom - BEYOND, top + BEYOND)


def _cells(wedges: list[Manifold], whole: Cell, sectors: int) -> list[Cell]:
    """Rings and layers, made by the cuts that bring the hulls nearest to the solid, one after another."""
    volume = sum(wedge.volume() for wedge in wedges)
    enough, least = GOOD_EXCESS * volume, NEGLIGIBLE * volume  # a gain of rounding errors is none
    cells, cuts = [whole], [_best_cut(wedges, whole, sectors)]
    while len(cells) < MOST_PIECES // sectors:
        gains = [0.0 if cut is None else cut.gain for cut in cuts]
        worst = int(np.argmax(gains))
        cut = cuts[worst]
        if cut is None or cut.gain <= least or sum(_excess(wedges, cell, sectors) for cell in cells) < enough:
            break
        cells[worst : worst + 1] = cut.halves
        cuts[worst : worst + 1] = [_best_cut(wedges, half, sectors) for half in cut.halves]
    return cells


def _best_cut(wedges: list[Manifold], cell: Cell, sectors: int) -> _Cut | None:
    """The cut of a cell that takes most off its hulls; None where there is nothing to cut at."""
    pieces = _fill(wedges, cell, sectors)
    whole = _excess(pieces, cell, sectors)
    cuts = [
        _Cut(halves, whole - sum(_excess(pieces, half, sectors) for half in halves))
        for axis, places in _corners(pieces).items()
        for halves in (cell.parts(axis, at) for at in places)
    ]
    return max(cuts, key=lambda cut: cut.gain, default=None)


def _corners(pieces: list[Manifold]) -> dict[str, list[float]]:
    """Radii and heights of the corners of the profile within a cell, a limited number of either."""
    if not pieces:
        return {}
    vertices = np.vstack([_vertices(piece) for piece in pieces])
    return {"r": _spread(np.hypot(vertices[:, 0], vertices[:, 1])), "z": _spread(vertices[:, 2])}


def _spread(values: Floats) -> list[float]:
    """At most `MOST_CUTS_TRIED` of the values between the smallest and the largest, to a hundredth of their span."""
    low, span = float(values.min()), float(np.ptp(values))
    steps = np.unique(np.round((values - low) / max(span, 1e-9), 2))[1:-1]
    if len(steps) > MOST_CUTS_TRIED:
        steps = steps[np.linspace(0, len(steps) - 1, MOST_CUTS_TRIED).astype(int)]
    return [low + span * float(step) for step in steps]


def _excess(wedges: list[Manifold], cell: Cell, sectors: int) -> float:
    """Volume that the hulls of a cell's pieces have more than these, in mm³."""
    pieces = [piece for piece in _fill(wedges, cell, sectors) if piece.volume() > SLIVER_MM3]
    return float(sum(ConvexHull(_vertices(piece)).volume - piece.volume() for piece in pieces))


def _fill(wedges: list[Manifold], cell: Cell, sectors: int) -> list[Manifold]:
    """What of each wedge is in a cell. Its round sides are chords, one for each sector, so that neighbours fit."""
    height = cell.top - cell.bottom
    block = _prism(cell.outer, sectors, height)
    if cell.inner > 0:
        block -= _prism(cell.inner, sectors, height + 2 * BEYOND).translate((0.0, 0.0, -BEYOND))
    block = block.translate((0.0, 0.0, cell.bottom))
    return [piece for wedge in wedges if not (piece := wedge ^ block).is_empty()]


def _vertices(solid: Manifold) -> Floats:
    return np.asarray(solid.to_mesh64().vert_properties)[:, :3]


def _prism(radius: float, sectors: int, height: float) -> Manifold:
    """A prism on a regular polygon whose corners are at the sides of the sectors."""
    return Manifold.cylinder(height, radius, radius, sectors).rotate((0.0, 0.0, 180.0 / sectors))
