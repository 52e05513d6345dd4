"""Fragments of Section 5.2 (i): edge chains divided into smooth convex arcs.

A chain is first described by a polygon that stays within a tolerance of it. Along a smooth arc the polygon's
angles and sides are tied together: sides of length L that meet at the angle t have a sagitta of about L t / 8,
which the tolerance bounds. Where the angle is larger than the sides allow there is a corner (or a straight line
runs into a curve), and where the sense of turning changes there is an inflection. Both divide the chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import EdgeMap
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.grouping.fragment_measures import FragmentLimits, measure_fragments
from vision.kernels import njit
from vision.settings import NOT_NEGATIVE, POSITIVE, check

Array = NDArray[np.float64]

MIN_SIDE_PX = 4.0  # of the polygon


@dataclass(frozen=True)
class FragmentParameters:
    """How chains are divided.

    Attributes:
        tolerance_px: largest distance of a chain from its polygon.
        corner_factor: the sagitta, over the tolerance, from which an angle of the polygon counts as a corner.
        min_length_px: shorter fragments are dropped.
        min_turn_rad: fragments that turn by less are straight and are dropped.
        min_sagitta_px: fragments that bulge by less from their chord are straight and are dropped.
        grey_offset_px: distance from the edge at which the grey levels inside and outside are measured.
    """

    tolerance_px: float = 0.7
    corner_factor: float = 3.0
    min_length_px: float = 10.0
    min_turn_rad: float = 0.12
    min_sagitta_px: float = 0.6
    grey_offset_px: float = 3.0

    def __post_init__(self) -> None:
        check(self, tolerance_px=POSITIVE, corner_factor=POSITIVE, min_length_px=POSITIVE, grey_offset_px=POSITIVE)
        check(self, min_turn_rad=NOT_NEGATIVE, min_sagitta_px=NOT_NEGATIVE)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Fragment:
    """A smooth convex arc of one chain.

    Attributes:
        points: (N, 2) sub-pixel edge points, pixels; read-only view into the edge map.
        gradients: (N, 2) unit gradients at the points.
        start: number of the first point in the edge map.
        inside_brighter: whether the inner side of the arc is the brighter one.
        centre_of_mass: (2,) mean of the points.
        turn_rad: angle by which the tangent turns from end to end.
        grey_inside: mean grey level along the inner side.
        grey_outside: mean grey level along the outer side.
    """

    points: Array
    gradients: Array
    start: int
    inside_brighter: bool
    centre_of_mass: Array
    turn_rad: float
    grey_inside: float
    grey_outside: float

    @property
    def endpoints(self) -> Array:
        """(2, 2) first and last point."""
        return self.points[[0, -1]]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class FragmentTable:
    """All fragments of an image as columns: what the pairwise constraints read.

    Attributes:
        start: (F,) number of the first edge point.
        stop: (F,) one past the number of the last edge point.
        inside_brighter: (F,) sense of the contrast.
        endpoints: (F, 2, 2) first and last point, along the inner side turned to the right of the walk.
        normals: (F, 3, 2) unit normals towards the inside: of the tangent at either endpoint, and of the chord.
        centre_of_mass: (F, 2) mean of the points.
        turn_rad: (F,) angle by which the tangent turns.
        length_px: (F,) length of the arc.
        grey: (F, 2) mean grey level inside and outside.
    """

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    inside_brighter: NDArray[np.bool_]
    endpoints: Array
    normals: Array
    centre_of_mass: Array
    turn_rad: Array
    length_px: Array
    grey: Array

    def __len__(self) -> int:
        return len(self.start)

    def fragment(self, number: int, edges: EdgeMap) -> Fragment:
        """One fragment with its points."""
        span = slice(int(self.start[number]), int(self.stop[number]))
        return Fragment(
            points=edges.points[span],
            gradients=edges.gradients[span],
            start=span.start,
            inside_brighter=bool(self.inside_brighter[number]),
            centre_of_mass=self.centre_of_mass[number],
            turn_rad=float(self.turn_rad[number]),
            grey_inside=float(self.grey[number, 0]),
            grey_outside=float(self.grey[number, 1]),
        )


def extract_fragments(
    edges: EdgeMap, image: NDArray[np.uint8], parameters: FragmentParameters | None = None
) -> FragmentTable:
    """Divide all chains of an image into smooth convex fragments.

    Args:
        edges: chains of the image.
        image: (H, W) uint8, read for the grey levels beside the edge.
        parameters: thresholds.

    Raises:
        InputError: when the edges are not of this image.
    """
    parameters = parameters or FragmentParameters()
    if edges.index.shape != image.shape:
        raise InputError("edge map", got=f"for {edges.index.shape}", expected=f"one of the image {image.shape}")
    start, stop, sense = _divide(edges.points, edges.offsets, parameters.tolerance_px, parameters.corner_factor)
    limits = FragmentLimits(parameters.min_length_px, parameters.min_turn_rad, parameters.min_sagitta_px)
    kept, *columns = measure_fragments(
        edges.points, edges.gradients, start, stop, sense, image, limits, parameters.grey_offset_px
    )
    return FragmentTable(start[kept], stop[kept], sense[kept] < 0, *columns)


@njit(cache=True)
def _polygon(points, first, last, tolerance, keep, stack):
    """Mark the vertices of a polygon within tolerance of points[first:last + 1] (Ramer, Douglas, Peucker).

    ``stack`` (N, 2) is scratch.
    """
    stack[0] = first, last
    keep[first] = keep[last] = True
    waiting = 1
    while waiting > 0:
        waiting -= 1
        a, b = stack[waiting]
        cx, cy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        chord = np.sqrt(cx * cx + cy * cy)
        # In a loop the line through the two ends says nothing; the distance from one of them does.
        line = chord >= 3.0
        worst, at = tolerance * chord if line else tolerance * tolerance, -1
        for k in range(a + 1, b):
            dx, dy = points[k, 0] - points[a, 0], points[k, 1] - points[a, 1]
            distance = abs(dx * cy - dy * cx) if line else dx * dx + dy * dy
            if distance > worst:
                worst, at = distance, k
        if at >= 0:
            keep[at] = True
            stack[waiting], stack[waiting + 1] = (a, at), (at, b)
            waiting += 2


@njit(cache=True)
def _divide(points, offsets, tolerance, corner_factor):
    """First and one-past-last point, and sense of turning (+1: from x towards y), of the parts of all chains."""
    keep, stack = np.zeros(len(points), np.bool_), np.empty((len(points) + 1, 2), np.int64)
    starts, stops, senses = [0], [0], [0]
    for c in range(len(offsets) - 1):
        first, last = offsets[c], offsets[c + 1] - 1
        _polygon(points, first, last, tolerance, keep, stack)
        begin, sense, previous = first, 0, first
        px, py, p_length = 0.0, 0.0, 0.0
        vertex = first
        for k in range(first + 1, last + 1):
            if not keep[k]:
                continue
            sx, sy = points[k, 0] - points[vertex, 0], points[k, 1] - points[vertex, 1]
            length = np.sqrt(sx * sx + sy * sy)
            if length < MIN_SIDE_PX and k < last:
                continue  # a corner that smoothing has rounded into several vertices is still one corner
            if vertex != begin and vertex != first:
                turn = np.arctan2(px * sy - py * sx, px * sx + py * sy)
                longer = max(length, p_length)
                sagitta = longer * longer * abs(turn) / (4 * (length + p_length))
                if sagitta > corner_factor * tolerance or abs(turn) > 1.4:
                    starts.append(begin)
                    stops.append(vertex + 1)
                    senses.append(sense)
                    begin, sense = vertex, 0
                elif abs(turn) > 0.03:
                    new_sense = 1 if turn > 0 else -1
                    if sense != 0 and new_sense != sense:
                        middle = (previous + vertex) // 2
                        starts.append(begin)
                        stops.append(middle + 1)
                        senses.append(sense)
                        begin = middle
                    sense = new_sense
            px, py, p_length = sx, sy, length
            previous, vertex = vertex, k
        starts.append(begin)
        stops.append(last + 1)
        senses.append(sense)
    return np.array(starts)[1:], np.array(stops)[1:], np.array(senses)[1:]
