"""Compiled pose corrections for many poses at once: on matched ellipses, and on the nearest edges of all views.

The same robust Gauss-Newton as :func:`vision.pose.refinement.refine_pose`, without its covariance: fast enough
for every candidate and hypothesis, where that one gives the final word.
"""

from __future__ import annotations

import numpy as np

from vision.edges.edge_field import LOOSEST_ALIGNMENT
from vision.geometry.small_systems import factorise, solve
from vision.kernels import njit
from vision.model.projection import eye_of, is_covered, list_inside, project_samples, rotated
from vision.model.vision_model import CoaxialCircle

ROBUST_SCALE = 3.0
NOISE_FLOOR_PX = 0.1
AXIS_SPRING = 1e6  # relative: holds the rotation about the part's axis, which coaxial circles cannot tell
FEWEST_POINTS = 12


@njit(cache=True)
def align_on_ellipses(poses, matches, cameras, circles, table, iterations):
    """Move poses to where their salient circles pass through the edge points of the matched ellipses.

    The viewing ray of an edge point meets the plane of the circle; the direction from the centre to there gives the
    circle's nearest point, and the projected tangent in that point the normal along which the distance counts.

    Args:
        poses: (N, 4, 4) T_world_part; corrected in place.
        matches: (N, V, K) number of the ellipse within its view, -1 for none.
        cameras: of the views, see :class:`vision.geometry.camera.CameraArrays`.
        circles: see :class:`vision.model.vision_model.SalientCircles`.
        table: the ellipses, see :class:`vision.matching.votes.EllipseTable`.
        iterations: Gauss-Newton steps.

    Returns:
        (N,) False where too few points were left; such a pose is not to be used.
    """
    T_camera_world, intrinsics = cameras.T_camera_world, cameras.intrinsics
    good = np.ones(len(poses), np.bool_)
    rows, residuals = np.empty((1024, 6)), np.empty(1024)
    for i in range(len(poses)):
        for _ in range(iterations):
            count = 0
            for v in range(len(T_camera_world)):
                T = T_camera_world[v] @ poses[i]
                for k in range(len(circles.radius)):
                    if matches[i, v, k] >= 0:
                        m = table.first[v] + matches[i, v, k]
                        seen = table.points[table.first_point[m] : table.first_point[m + 1]]
                        circle = CoaxialCircle(circles.height[k], circles.side[k], circles.radius[k])
                        count = rows_of_circle(
                            T, T_camera_world[v], intrinsics[v], seen, circle, rows, residuals, count
                        )
            if count < FEWEST_POINTS:
                good[i] = False
                break
            _step(poses[i], rows[:count], residuals[:count], False)
    return good


@njit(cache=True)
def align_on_edges(poses, cameras, samples, edges, reaches, inplane):
    """Move poses to where a sampled contour lies on the nearest edges of all views.

    Args:
        poses: (N, 4, 4) T_world_part; corrected in place.
        cameras: of the views, see :class:`vision.geometry.camera.CameraArrays`.
        samples: of a contour, see :class:`vision.model.projection.ContourSamples`.
        edges: of the views, see :class:`vision.edges.edge_field.StackedEdges`.
        reaches: tolerance in pixels, iteration by iteration.
        inplane: whether the rotation about the part's axis is corrected too.

    Returns:
        (N,) False where too few edges were in reach.
    """
    good = np.ones(len(poses), np.bool_)
    views = len(cameras.intrinsics)
    most = views * len(samples.circle)
    rows, residuals = np.empty((most, 6)), np.empty(most)
    for i in range(len(poses)):
        for reach in reaches:
            count = 0
            for v in range(views):
                count = _rows_of_edges(poses[i], cameras, samples, edges, v, reach, rows, residuals, count)
            if count < FEWEST_POINTS:
                good[i] = False
                break
            _step(poses[i], rows[:count], residuals[:count], inplane)
    return good


@njit(cache=True, error_model="numpy")
def _rows_of_edges(pose, cameras, samples, edges, view, reach, rows, residuals, count):
    """Write the rows of the edges nearest to the samples in one view, from row ``count`` on; the next free row."""
    T_camera_world, intrinsics = cameras.T_camera_world[view], cameras.intrinsics[view]
    direction, nearest = edges.direction[view], edges.nearest[view]
    claimed, cover = edges.claimed[view], edges.cover[view]
    height, width = claimed.shape
    size = len(samples.circle)
    image, shown = np.empty((5, size)), np.empty(size, np.bool_)
    pixel, listed = np.empty((2, size), np.int32), np.empty(size, np.intp)
    T = T_camera_world @ pose
    project_samples(T, intrinsics, samples, image, shown)
    for s in listed[: list_inside(image, shown, width, height, pixel, listed)]:
        column, line, u, w = pixel[0, s], pixel[1, s], image[0, s], image[1, s]
        if is_covered(cover, column, line, image[2, s] - samples.margin_m):
            continue
        ex, ey = nearest[line, column, 0], nearest[line, column, 1]
        if ex < 0 or (ex - u) ** 2 + (ey - w) ** 2 > (reach + 1.0) ** 2:
            continue
        if claimed[int(np.rint(ey)), int(np.rint(ex))]:
            continue
        nx, ny = image[3, s], image[4, s]
        if abs(direction[line, column, 0] * nx + direction[line, column, 1] * ny) < LOOSEST_ALIGNMENT:
            continue
        if abs((ex - u) * nx + (ey - w) * ny) > reach:
            continue
        point = (samples.points[0, s], samples.points[1, s], samples.points[2, s])
        tangent = (samples.tangents[0, s], samples.tangents[1, s], samples.tangents[2, s])
        count += projection_row(T, T_camera_world, intrinsics, point, tangent, (ex, ey), rows, residuals, count)
    return count


@njit(cache=True)
def rows_of_circle(T, T_camera_world, intrinsics, points, circle, rows, residuals, count):
    """Write the rows of edge points of a circle about the part's axis, from row ``count`` on; the next free row.

    The viewing ray of a point meets the plane of the circle; the direction from the centre to there gives the nearest
    point of the circle.

    Args:
        T: (4, 4) T_camera_part.
        T_camera_world: (4, 4).
        intrinsics: fx, fy, cx, cy.
        points: (N, 2) edge points in pixels.
        circle: see :class:`vision.model.vision_model.CoaxialCircle`.
        rows: (M, 6) written to; points beyond the last row are left out.
        residuals: (M,) written to.
        count: the first free row.
    """
    fx, fy, cx, cy = intrinsics
    height, radius = circle.height, circle.radius
    eye = eye_of(T)
    for j in range(len(points)):
        if count == len(residuals):
            break
        u, w = (points[j, 0] - cx) / fx, (points[j, 1] - cy) / fy
        rx = T[0, 0] * u + T[1, 0] * w + T[2, 0]
        ry = T[0, 1] * u + T[1, 1] * w + T[2, 1]
        rz = T[0, 2] * u + T[1, 2] * w + T[2, 2]
        if rz == 0.0:
            continue
        reach = (height - eye[2]) / rz
        x, y = eye[0] + reach * rx, eye[1] + reach * ry
        length = max(np.sqrt(x * x + y * y), 1e-12)
        x, y = radius * x / length, radius * y / length
        model, along = (x, y, height), (-y, x, 0.0)
        count += projection_row(T, T_camera_world, intrinsics, model, along, points[j], rows, residuals, count)
    return count


@njit(cache=True)
def projection_row(T, T_camera_world, intrinsics, point, tangent, seen, rows, residuals, count):
    """Write row ``count``: d(distance along the normal)/d(translation, rotation about the origin), and the distance.

    Returns False, and leaves the row to the next point, where the point is behind the camera.
    """
    fx, fy, cx, cy = intrinsics
    ax, ay, az = rotated(T, point)
    x, y, z = ax + T[0, 3], ay + T[1, 3], az + T[2, 3]
    if z < 1e-3:
        return False
    tx, ty, tz = rotated(T, tangent)
    du, dw = fx * (tx - x / z * tz), fy * (ty - y / z * tz)
    length = np.sqrt(du * du + dw * dw)
    if length < 1e-12:
        return False
    mx, my = dw / length, -du / length
    # The gradient of the distance in the camera frame, then turned into the world frame.
    gx, gy = mx * fx / z, my * fy / z
    gz = -(gx * x + gy * y) / z
    tox, toy, toz = ay * gz - az * gy, az * gx - ax * gz, ax * gy - ay * gx
    M = T_camera_world
    for j in range(3):
        rows[count, j] = M[0, j] * gx + M[1, j] * gy + M[2, j] * gz
        rows[count, 3 + j] = M[0, j] * tox + M[1, j] * toy + M[2, j] * toz
    residuals[count] = mx * (seen[0] - (fx * x / z + cx)) + my * (seen[1] - (fy * y / z + cy))
    return True


@njit(cache=True)
def _step(T, rows, residuals, inplane):
    """One Gauss-Newton step with Tukey's weights, applied to the pose."""
    scale = ROBUST_SCALE * max(1.4826 * np.median(np.abs(residuals)), NOISE_FLOOR_PX)
    N, g = np.zeros((6, 6)), np.zeros(6)
    for i in range(len(residuals)):
        u = residuals[i] / scale
        if abs(u) >= 1:
            continue
        weight = (1 - u * u) ** 2
        for a in range(6):
            wa = weight * rows[i, a]
            g[a] += wa * residuals[i]
            for b in range(a, 6):
                N[a, b] += wa * rows[i, b]
    for a in range(6):
        for b in range(a):
            N[a, b] = N[b, a]
    if not inplane:
        stiff = AXIS_SPRING * max(N[3, 3] + N[4, 4] + N[5, 5], 1e-12)
        for a in range(3):
            for b in range(3):
                N[3 + a, 3 + b] += stiff * T[a, 2] * T[b, 2]
    for a in range(6):
        N[a, a] *= 1 + 1e-9
    factorise(N)
    solve(N, g)
    turn_and_move(T, g)


@njit(cache=True)
def turn_and_move(T, step):
    """Translate, and turn about the part's origin by a rotation vector."""
    for a in range(3):
        T[a, 3] += step[a]
    angle = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    if angle < 1e-15:
        return
    kx, ky, kz = step[3] / angle, step[4] / angle, step[5] / angle
    s, c = np.sin(angle), 1 - np.cos(angle)
    for j in range(3):
        x, y, z = T[0, j], T[1, j], T[2, j]
        along = kx * x + ky * y + kz * z
        T[0, j] = x + s * (ky * z - kz * y) + c * (kx * along - x)
        T[1, j] = y + s * (kz * x - kx * z) + c * (ky * along - y)
        T[2, j] = z + s * (kx * y - ky * x) + c * (kz * along - z)
