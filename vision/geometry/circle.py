"""The 3D circle: its image, and the two candidate circles behind one ellipse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.camera import Camera, View
from vision.geometry.ellipse import Ellipse
from vision.geometry.focal_form import conics_to_geometric

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Circle:
    """A circle in space.

    Attributes:
        centre: (3,) metres.
        normal: (3,) unit vector, towards the side from which the circle is seen.
        radius_m: radius.
    """

    centre: Array
    normal: Array
    radius_m: float

    def __post_init__(self) -> None:
        centre, normal = np.array(self.centre, dtype=float), np.array(self.normal, dtype=float)
        length = np.linalg.norm(normal)
        if not (np.isfinite(centre).all() and length > 0 and self.radius_m > 0):
            raise InputError(
                "circle", got=(centre, normal, self.radius_m), expected="finite centre, a normal, radius > 0"
            )
        normal /= length
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "normal", normal)

    def moved(self, T_to_from: RigidTransform) -> Circle:
        """The circle in another frame."""
        T = T_to_from.as_matrix()
        return Circle(T[:3, :3] @ self.centre + T[:3, 3], T[:3, :3] @ self.normal, self.radius_m)

    def sample(self, n: int) -> Array:
        """(n, 3) points equally spaced along the circle."""
        u, v = plane_axes(self.normal)
        t = np.linspace(0, 2 * np.pi, n, endpoint=False)[:, None]
        return self.centre + self.radius_m * (np.cos(t) * u + np.sin(t) * v)


def plane_axes(normal: ArrayLike) -> tuple[Array, Array]:
    """Unit vectors u, v (..., 3) that span the planes of normals (..., 3), with u x v = normal."""
    n = np.asarray(normal, dtype=float)
    helper = np.where(np.abs(n[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    u = cross(helper, n)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    return u, cross(n, u)


def circle_conics(centres: Array, normals: Array, radii: Array, K: Array) -> Array:
    """Image conics (..., 3, 3) of circles given in the camera frame, negative inside.

    The unit circle of the plane is carried into the image by the homography H = K [r u, r v, c]; its conic
    becomes C = H^-T diag(1, 1, -1) H^-1.

    Args:
        centres: (..., 3) metres.
        normals: (..., 3) unit vectors.
        radii: (...) metres.
        K: 3x3 calibration matrix.
    """
    u, v = plane_axes(normals)
    r = np.asarray(radii)[..., None]
    H = K @ np.stack([u * r, v * r, centres], axis=-1)
    H_inverse = np.linalg.inv(H)
    conics = np.swapaxes(H_inverse, -1, -2) @ (np.array([1.0, 1.0, -1.0])[:, None] * H_inverse)
    # An ellipse has a positive definite quadratic part after this; the sign is the homography's alone.
    return conics * np.sign(conics[..., 0, 0])[..., None, None]


def conic_ellipses(conics: Array) -> Array:
    """Geometric parameters (..., 5) of conics (..., 3, 3): centre x, y, semi-axes, angle; NaN where no ellipse."""
    flat = np.ascontiguousarray(conics).reshape(-1, 3, 3)
    return np.asarray(conics_to_geometric(flat)).reshape(*conics.shape[:-2], 5)


def project_circle(circle: Circle, view: View) -> Ellipse | None:
    """The image of a circle given in the world frame; None when it is not wholly in front of the camera.

    The view's lens must be free of distortion (see :meth:`vision.geometry.camera.View.undistorted`).
    """
    in_camera = circle.moved(view.T_world_camera.inv())
    if in_camera.sample(16)[:, 2].min() <= 0:
        return None
    conic = circle_conics(in_camera.centre, in_camera.normal, np.array(in_camera.radius_m), view.camera.matrix)
    geometric = conic_ellipses(conic)
    return Ellipse.from_geometric(*geometric) if np.isfinite(geometric).all() else None


def circle_candidates(conics: Array, K: Array) -> tuple[Array, Array]:
    """The two circles of radius 1 m behind each ellipse (a circle of radius r: multiply the centres by r).

    The viewing cone Q = Kᵀ C K has two families of circular sections; its eigenvectors give their planes
    (the classical result, for example Forsyth et al., PAMI 13(10), 1991).

    Args:
        conics: (N, 3, 3) image conics of ellipses.
        K: 3x3 calibration matrix.

    Returns:
        Centres (N, 2, 3) for radius 1 and unit normals (N, 2, 3) that face the camera, both in the camera frame.
    """
    cones = K.T @ conics @ K
    values, vectors = np.linalg.eigh(cones)
    # A cone has two eigenvalues of one sign; make them the positive ones: l1 >= l2 > 0 > l3.
    flip = values[:, 1] < 0
    values = np.where(flip[:, None], -values, values[:, ::-1])
    vectors = np.where(flip[:, None, None], vectors, vectors[:, :, ::-1])
    l1, l2, l3 = values.T
    g = np.sqrt(np.maximum(l1 - l2, 0) / (l1 - l3))
    h = np.sqrt((l2 - l3) / (l1 - l3))
    sign = np.array([1.0, -1.0])
    zero = np.zeros((len(values), 2))
    normals = np.stack([sign * g[:, None], zero, zero - h[:, None]], axis=-1)
    scale = l2 / np.sqrt(-l1 * l3)
    centres = np.stack([sign * (scale * l3 / l2 * g)[:, None], zero, zero - (scale * l1 / l2 * h)[:, None]], axis=-1)
    normals, centres = (np.einsum("nij,nsj->nsi", vectors, a) for a in (normals, centres))
    centres *= np.sign(centres[..., 2:])
    normals *= -np.sign(np.einsum("nsi,nsi->ns", normals, centres))[..., None]
    return centres, normals


def circle_poses(ellipse: Ellipse, camera: Camera, radius_m: float) -> tuple[Circle, Circle]:
    """The two circles of a known radius, in the camera frame, whose image is the ellipse."""
    centres, normals = circle_candidates(ellipse.conic[None], camera.matrix)
    first, second = (
        Circle(centre * radius_m, normal, radius_m) for centre, normal in zip(centres[0], normals[0], strict=True)
    )
    return first, second


def cross(a: Array, b: Array) -> Array:
    """The cross product (..., 3) of vectors (..., 3).

    What `numpy.cross` gives, without its general axes: those cost several times the product itself.
    """
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out
