"""The body that a part's coaxial circles span: what it hides from the cameras, and that nothing else can be in it."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.geometry.camera import Camera
from vision.model.vision_model import SalientCircles, VisionModel

Array = NDArray[np.float64]

SAMPLES = 48
OUTLINE_SHARE = 0.85  # of the largest radius: circles that large are outlines
BODY_SLACK = 0.1  # of the thickness


def render_depth(depth: NDArray[np.float32], T_camera_part: Array, camera: Camera, model: VisionModel) -> None:
    """Lower a depth map (H, W), in place, to the body that the part's coaxial circles span.

    The body is the hull of the largest circles, less the bore: solid, which a cup is not; but what else lies in the
    bin does not fit into a cup.

    Args:
        depth: metres along the optical axis; infinite where nothing is known to be.
        T_camera_part: 4x4 pose of the part.
        camera: free of distortion; its size is that of the map.
        model: of the part.
    """
    rims = [rim @ T_camera_part[:3, :3].T + T_camera_part[:3, 3] for rim in _outlines(model)]
    if min(rim[:, 2].min() for rim in rims) <= 0:
        return
    outlines = [_pixels(rim, camera) for rim in rims]
    hull = cv2.convexHull(np.vstack(outlines).astype(np.float32))
    x, y, width, height = cv2.boundingRect(hull)
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, depth.shape[1]), min(y + height, depth.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    body = np.full((y1 - y0, x1 - x0), np.inf, np.float32)
    body[_filled(hull, (x0, y0), body.shape)] = np.mean([rim[:, 2].mean() for rim in rims])
    columns, rows = np.arange(x0, x1, dtype=np.float32), np.arange(y0, y1, dtype=np.float32)[:, None]
    rays = ((columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy)
    normal = T_camera_part[:3, 2]
    for rim, outline in zip(rims, outlines, strict=True):
        inside = _filled(outline, (x0, y0), body.shape)
        with np.errstate(divide="ignore"):
            plane = (normal @ rim.mean(axis=0)) / (normal[0] * rays[0] + (normal[1] * rays[1] + normal[2]))
        np.minimum(body, plane, out=body, where=inside & (plane > 0), casting="same_kind")
    body[_seen_through(model, T_camera_part, camera, (x0, y0), body.shape)] = np.inf
    window = depth[y0:y1, x0:x1]
    np.minimum(window, body, out=window)


def share_inside(poses: Array, T_world_found: Array, circles: SalientCircles) -> Array:
    """Share of each pose's outlines (N,) that would run through the body of a part already found.

    The body is the slab between the outlines of front and back, a little less for the errors of both poses.

    Args:
        poses: (N, 4, 4) T_world_part.
        T_world_found: 4x4 pose of the part found, of the same kind.
        circles: the salient circles of that kind.
    """
    outline = circles.radius > OUTLINE_SHARE * circles.radius.max()
    radius, height = circles.radius[outline], circles.height[outline]
    t = np.linspace(0, 2 * np.pi, SAMPLES // 2, endpoint=False)
    ring = np.column_stack([np.cos(t), np.sin(t)])
    points = [
        np.column_stack([r * ring, np.full(len(t), h), np.ones(len(t))]) for r, h in zip(radius, height, strict=True)
    ]
    T_found_part = np.linalg.inv(T_world_found) @ poses
    x, y, z, _ = np.einsum("nij,pj->inp", T_found_part, np.concatenate(points))
    slack = BODY_SLACK * (height.max() - height.min())
    within = (z > height.min() + slack) & (z < height.max() - slack) & (np.hypot(x, y) < 0.95 * radius.max())
    return np.asarray(within.mean(axis=1))


def _seen_through(
    model: VisionModel, T_camera_part: Array, camera: Camera, corner: tuple[int, int], shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """The pixels that look through the bore: inside both of its rims."""
    through = np.full(shape, model.bore is not None)
    for rim in _bore_rims(model):
        points = rim @ T_camera_part[:3, :3].T + T_camera_part[:3, 3]
        through &= _filled(_pixels(points, camera), corner, shape)
    return through


@lru_cache(maxsize=16)
def _bore_rims(model: VisionModel) -> tuple[Array, ...]:
    """Points (N, 3) of the rims of the bore, in the part's frame; nothing without a bore."""
    if model.bore is None:
        return ()
    radius, T = 0.5 * model.bore.diameter_m, model.bore.T_part_bore.as_matrix()
    t = np.linspace(0, 2 * np.pi, SAMPLES, endpoint=False)
    ring = np.column_stack([radius * np.cos(t), radius * np.sin(t)])
    rims = [np.column_stack([ring, np.full(SAMPLES, z)]) for z in (0.0, model.bore.depth_m)]
    return tuple(rim @ T[:3, :3].T + T[:3, 3] for rim in rims)


@lru_cache(maxsize=16)
def _outlines(model: VisionModel) -> tuple[Array, ...]:
    """Points (N, 3) of the salient circles nearly as large as the largest: the outlines of front and back."""
    circles = [f.circle for f in model.salient]
    largest = max(c.radius_m for c in circles)
    return tuple(c.sample(SAMPLES) for c in circles if c.radius_m > OUTLINE_SHARE * largest)


def _pixels(points: Array, camera: Camera) -> Array:
    return np.asarray(points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy))


def _filled(polygon: Array, corner: tuple[int, int], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(np.reshape(polygon, (-1, 2)) - corner).astype(np.int32), 1)
    return mask > 0
