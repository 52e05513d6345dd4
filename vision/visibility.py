"""Which samples of a contour a view shows, and where: every comparison of a posed model with edges starts so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
def project_samples(T, intrinsics, samples, image, shown):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Project samples, and find those that face the camera and that no rim before them hides.

    There are no branches, so that several samples are computed at a time.

    Args:
        T: (4, 4) T_camera_part.
        intrinsics: fx, fy, cx, cy.
        samples: of a contour.
        image: (3, S) pixels and depth of every sample, written to.
        shown: (S,) bool, written to.
    """
    fx, fy, cx, cy = intrinsics
    xx, xy, xz, x0 = T[0]
    yx, yy, yz, y0 = T[1]
    zx, zy, zz, z0 = T[2]
    eye = eye_of(T)
    # Row by row: unpacked at one go their layout is unknown to the compiler, which then takes them one by one.
    px, py, pz = samples.points[0], samples.points[1], samples.points[2]
    ux, uy, uz = samples.normals[0], samples.normals[1], samples.normals[2]
    for i in range(len(shown)):
        x = xx * px[i] + xy * py[i] + xz * pz[i] + x0
        y = yx * px[i] + yy * py[i] + yz * pz[i] + y0
        z = zx * px[i] + zy * py[i] + zz * pz[i] + z0
        nx = xx * ux[i] + xy * uy[i] + xz * uz[i]
        ny = yx * ux[i] + yy * uy[i] + yz * uz[i]
        nz = zx * ux[i] + zy * uy[i] + zz * uz[i]
        image[0, i], image[1, i], image[2, i] = fx * x / z + cx, fy * y / z + cy, z
        grazing = -(nx * x + ny * y + nz * z) <= GRAZING_COSINE * np.sqrt(x * x + y * y + z * z)
        shown[i] = (z > 1e-3) & (not grazing)
    for k in range(len(samples.rims)):
        radius, height = samples.rims[k, 0], samples.rims[k, 1]
        for i in range(len(shown)):
            shown[i] &= not hides(radius[i], height[i], px[i], py[i], pz[i], eye)


@njit(cache=True, error_model="numpy", inline="always")
def hides(radius, height, x, y, z, eye):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Whether a rim before a point of the part hides it from the eye, all in the part's frame; no, if it is NaN.

    The surface of one body joins the point and the rim. A line of sight that starts on one side of the rim's radius
    and crosses the rim's plane on the other side has gone through that surface: the floor of a cup hides behind the
    wall, a flange behind the hat.
    """
    square, own = radius * radius, x * x + y * y
    share = (height - z) / (eye[2] - z)
    across, along = x + share * (eye[0] - x), y + share * (eye[1] - y)
    crossing = across * across + along * along
    by_wall = (own < square) & (crossing > (1 + RIM_SLACK) ** 2 * square)
    by_body = (own >= square) & (crossing < (1 - RIM_SLACK) ** 2 * square)
    return by_wall | by_body


@njit(cache=True, error_model="numpy")
def list_inside(image, shown, width, height, listed):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Write the numbers of the samples shown inside an image, and return how many there are.

    Args:
        image: (3, S) pixels and depth.
        shown: (S,) bool; those outside the image are deleted.
        width: of the image in pixels.
        height: of the image in pixels.
        listed: (S,) written to.
    """
    for i in range(len(shown)):
        u, v = np.rint(image[0, i]), np.rint(image[1, i])
        across = (u >= BORDER_PX) & (u <= width - 1 - BORDER_PX)
        shown[i] &= across & (v >= BORDER_PX) & (v <= height - 1 - BORDER_PX)
    count = 0
    for i in range(len(shown)):
        listed[count] = i
        count += shown[i]
    return count


@njit(cache=True, error_model="numpy", inline="always")
def is_covered(cover, image, i, margin_m):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Whether a sample lies behind parts found, by the depth of their surfaces for each block of pixels."""
    u, v = int(np.rint(image[0, i])), int(np.rint(image[1, i]))
    return image[2, i] > cover[v // COVER_BLOCK_PX, u // COVER_BLOCK_PX] + margin_m


@njit(cache=True, error_model="numpy", inline="always")
def normal_of(T, intrinsics, samples, i):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The normal of the projected contour at a sample, x and y, and its length in pixels per metre."""
    x, y, z = moved(T, (samples.points[0, i], samples.points[1, i], samples.points[2, i]))
    tx, ty, tz = rotated(T, (samples.tangents[0, i], samples.tangents[1, i], samples.tangents[2, i]))
    du, dv = intrinsics[0] * (tx - x / z * tz), intrinsics[1] * (ty - y / z * tz)
    return dv, -du, max(np.sqrt(du * du + dv * dv), 1e-12)


@njit(cache=True, fastmath={"contract"})
def chain(A, B, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Write the product of two rigid transforms (4, 4): bit for bit what BLAS gives, whose calls take far longer."""
    for i in range(4):
        for j in range(4):
            total = 0.0
            for k in range(4):
                total += A[i, k] * B[k, j]
            out[i, j] = total


@njit(cache=True, inline="always")
def moved(T, p):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The point T p."""
    x, y, z = rotated(T, p)
    return x + T[0, 3], y + T[1, 3], z + T[2, 3]


@njit(cache=True, inline="always")
def rotated(T, p):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The direction T p."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2],
    )


@njit(cache=True)
def eye_of(T_camera_part):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The camera's centre x, y, z in the part's frame."""
    T = T_camera_part
    return (
        -(T[0, 0] * T[0, 3] + T[1, 0] * T[1, 3] + T[2, 0] * T[2, 3]),
        -(T[0, 1] * T[0, 3] + T[1, 1] * T[1, 3] + T[2, 1] * T[2, 3]),
        -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3]),
    )
