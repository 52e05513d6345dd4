"""Which samples of a contour a view shows, and where: every comparison of a posed model with edges starts so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.kernels import njit

Array = NDArray[np.float64]

RIM_SLACK = 0.03  # taught radii are not exact, rims are rounded
GRAZING_COSINE = 0.12  # a circle seen at more than 83 degrees from its normal is not expected to show an edge
BORDER_PX = 2  # of the image, where no edges are looked for
COVER_BLOCK_PX = 4  # what parts hide is known by blocks of pixels


class ContourSamples(NamedTuple):
    """The samples of a contour as the compiled loops read them: coordinate by coordinate, many samples at a time.

    Attributes:
        points: (3, S) in the part's frame, metres.
        tangents: (3, S) unit tangents.
        normals: (3, S) unit vectors to the side from which the circles are seen.
        circle: (S,) number of the circle a sample belongs to, ascending.
        rims: (B, 2, S) radius and height of the salient circles through or past which a sample is seen; NaN fills up.
        margin_m: how far behind the surface of another part a sample is before it counts as hidden.
    """

    points: Array
    tangents: Array
    normals: Array
    circle: NDArray[np.intp]
    rims: Array
    margin_m: float


@njit(cache=True, error_model="numpy")
def project_samples(T, intrinsics, samples, image, shown):
    """Project samples, and find those that face the camera and that no rim before them hides.

    There are no branches, so that several samples are computed at a time.

    Args:
        T: (4, 4) T_camera_part.
        intrinsics: fx, fy, cx, cy.
        samples: of a contour.
        image: (5, S) of every sample the pixel u, v, the depth, and the unit normal of the contour; written to.
        shown: (S,) bool, written to.
    """
    fx, fy, cx, cy = intrinsics
    xx, xy, xz, x0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    yx, yy, yz, y0 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    zx, zy, zz, z0 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    eye = eye_of(T)
    points, tangents, normals, rims = samples.points, samples.tangents, samples.normals, samples.rims
    for i in range(len(shown)):
        px, py, pz = points[0, i], points[1, i], points[2, i]
        ux, uy, uz = normals[0, i], normals[1, i], normals[2, i]
        vx, vy, vz = tangents[0, i], tangents[1, i], tangents[2, i]
        x = xx * px + xy * py + xz * pz + x0
        y = yx * px + yy * py + yz * pz + y0
        z = zx * px + zy * py + zz * pz + z0
        nx = xx * ux + xy * uy + xz * uz
        ny = yx * ux + yy * uy + yz * uz
        nz = zx * ux + zy * uy + zz * uz
        facing = -(nx * x + ny * y + nz * z)
        shown[i] = (z > 1e-3) & (facing > 0) & (facing * facing > GRAZING_COSINE**2 * (x * x + y * y + z * z))
        x, y = x / z, y / z
        tx = xx * vx + xy * vy + xz * vz
        ty = yx * vx + yy * vy + yz * vz
        tz = zx * vx + zy * vy + zz * vz
        du, dv = fx * (tx - x * tz), fy * (ty - y * tz)
        length = max(np.sqrt(du * du + dv * dv), 1e-12)
        image[0, i], image[1, i], image[2, i] = fx * x + cx, fy * y + cy, z
        image[3, i], image[4, i] = dv / length, -du / length
    for k in range(len(rims)):
        for i in range(len(shown)):
            shown[i] &= not hides(rims[k, 0, i], rims[k, 1, i], points[0, i], points[1, i], points[2, i], eye)


@njit(cache=True, error_model="numpy", inline="always")
def hides(radius, height, x, y, z, eye):
    """Whether a rim before a point of the part hides it from the eye, all in the part's frame; no, if it is NaN.

    The surface of one body joins the point and the rim. A line of sight that starts on one side of the rim's radius
    and crosses the rim's plane on the other side has gone through that surface: the floor of a cup hides behind the
    wall, a flange behind the hat.
    """
    square, own = radius * radius, x * x + y * y
    # Where the line crosses the rim's plane, all lengths times its whole rise: so there is no division.
    rise, part = eye[2] - z, height - z
    across, along = x * rise + part * (eye[0] - x), y * rise + part * (eye[1] - y)
    crossing, edge = across * across + along * along, square * rise * rise
    by_wall = (own < square) & (crossing > (1 + RIM_SLACK) ** 2 * edge)
    by_body = (own >= square) & (crossing < (1 - RIM_SLACK) ** 2 * edge)
    return by_wall | by_body


@njit(cache=True, error_model="numpy")
def list_inside(image, shown, width, height, pixel, listed):
    """Write the numbers of the samples shown inside an image, and return how many there are.

    Args:
        image: (5, S) see :func:`project_samples`.
        shown: (S,) bool; those outside the image are deleted.
        width: of the image in pixels.
        height: of the image in pixels.
        pixel: (2, S) int32, column and line of the samples shown; written to.
        listed: (S,) written to.
    """
    for i in range(len(shown)):
        column, line = np.rint(image[0, i]), np.rint(image[1, i])
        across = (column >= BORDER_PX) & (column <= width - 1 - BORDER_PX)
        shown[i] &= across & (line >= BORDER_PX) & (line <= height - 1 - BORDER_PX)
        pixel[0, i], pixel[1, i] = np.int32(column), np.int32(line)
    count = 0
    for i in range(len(shown)):
        listed[count] = i
        count += shown[i]
    return count


@njit(cache=True, error_model="numpy", inline="always")
def is_covered(cover, column, line, depth):
    """Whether something lies behind parts found, by the depth of their surfaces for each block of pixels."""
    return depth > cover[line // COVER_BLOCK_PX, column // COVER_BLOCK_PX]


@njit(cache=True, fastmath={"contract"})
def chain(A, B, out):
    """Write the product of two rigid transforms (4, 4): bit for bit what BLAS gives, whose calls take far longer."""
    for i in range(4):
        for j in range(4):
            total = 0.0
            for k in range(4):
                total += A[i, k] * B[k, j]
            out[i, j] = total


@njit(cache=True, inline="always")
def moved(T, p):
    """The point T p."""
    x, y, z = rotated(T, p)
    return x + T[0, 3], y + T[1, 3], z + T[2, 3]


@njit(cache=True, inline="always")
def rotated(T, p):
    """The direction T p."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2],
    )


@njit(cache=True)
def eye_of(T_camera_part):
    """The camera's centre x, y, z in the part's frame."""
    T = T_camera_part
    return (
        -(T[0, 0] * T[0, 3] + T[1, 0] * T[1, 3] + T[2, 0] * T[2, 3]),
        -(T[0, 1] * T[0, 3] + T[1, 1] * T[1, 3] + T[2, 1] * T[2, 3]),
        -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3]),
    )
