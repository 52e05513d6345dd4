"""The cell in a rerun recording: its geoms once, and where its bodies were over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from benchmark.world.scene import COLLISION_GROUP

Array = NDArray[np.float64]

CELL = "world/cell"
PIECES = "world/pieces"
TIME, STAGE = "sim_time", "stage"
"""Timelines: seconds of simulated time, and the number of the last thing that happened."""

SAMPLES_PER_SECOND = 25.0
_FLOOR_HALF_SIZE_M = 2.0
_STILL = 1e-6  # metres, and of a quaternion's numbers


def log_geometry(recording: rr.RecordingStream, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Log every visible geom once, below the entity of its body; pieces once for each type of part.

    Args:
        recording: to log to.
        model: the compiled cell.
        data: any state; bodies that are fixed to the world are placed after it.
    """
    for geom in np.flatnonzero(model.geom_group != COLLISION_GROUP).tolist():
        body = int(model.geom_bodyid[geom])
        if _is_piece(model, body):
            continue
        entity = f"{body_entity(model, body)}/{geom}"
        recording.log(entity, _shape(model, geom), _pose(model.geom_pos[geom], model.geom_quat[geom]), static=True)
    for part, bodies in _pieces(model).items():
        recording.log(f"{PIECES}/{part}", _piece_mesh(model, bodies[0]), static=True)
    for body in np.flatnonzero(model.body_weldid == 0).tolist():
        recording.log(body_entity(model, body), _pose(data.xpos[body], data.xquat[body]), static=True)


def body_entity(model: mujoco.MjModel, body: int) -> str:
    """The entity path of a body; all bodies hang below the cell, for their poses are those in the world."""
    return f"{CELL}/{model.body(body).name.replace('/', '_')}"


@dataclass
class Motion:
    """Samples of the poses of all moving bodies, which become columns at the end.

    Attributes:
        model: the compiled cell.
        data: its state.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    _times_s: list[float] = field(default_factory=list)
    _stages: list[int] = field(default_factory=list)
    _positions: list[Array] = field(default_factory=list)
    _quaternions: list[Array] = field(default_factory=list)
    _due_s: float = 0.0

    def sample(self, stage: int) -> None:
        """Take a sample if one is due; cheap enough to be called after every physics step."""
        time_s = self.data.time
        if time_s < self._due_s:
            return
        self._due_s = time_s + 1 / SAMPLES_PER_SECOND
        self._times_s.append(time_s)
        self._stages.append(stage)
        self._positions.append(self.data.xpos.copy())
        self._quaternions.append(self.data.xquat[:, [1, 2, 3, 0]])

    def send(self, recording: rr.RecordingStream) -> None:
        """Log all samples; a body only where it moved."""
        if not self._times_s:
            return
        positions, quaternions = np.stack(self._positions), np.stack(self._quaternions)
        moving = np.flatnonzero(self.model.body_weldid != 0).tolist()
        for body in moving:
            if not _is_piece(self.model, body) and self.model.body_geomnum[body]:
                kept = _changes(np.hstack([positions[:, body], quaternions[:, body]]))
                columns = rr.Transform3D.columns(
                    translation=positions[kept, body], quaternion=quaternions[kept, body]
                )
                recording.send_columns(body_entity(self.model, body), self._index(kept), columns)
        for part, bodies in _pieces(self.model).items():
            poses = np.concatenate([positions[:, bodies], quaternions[:, bodies]], axis=2)
            kept = _changes(poses.reshape(len(poses), -1))
            columns = rr.InstancePoses3D.columns(
                translations=poses[kept, :, :3].reshape(-1, 3), quaternions=poses[kept, :, 3:].reshape(-1, 4)
            )
            lengths = [len(bodies)] * len(kept)
            recording.send_columns(f"{PIECES}/{part}", self._index(kept), columns.partition(lengths))

    def _index(self, kept: NDArray[np.intp]) -> list[rr.TimeColumn]:
        times, stages = np.array(self._times_s)[kept], np.array(self._stages)[kept]
        return [rr.TimeColumn(TIME, duration=times), rr.TimeColumn(STAGE, sequence=stages)]


def _changes(rows: Array) -> NDArray[np.intp]:
    """The rows (T, N) that differ from the one before, and the one before such a row, for viewers do not blend."""
    moved = np.abs(np.diff(rows, axis=0)).max(axis=1) > _STILL
    return np.flatnonzero(np.concatenate([[True], moved]) | np.concatenate([moved, [False]]))


def _is_piece(model: mujoco.MjModel, body: int) -> bool:
    return bool(model.body(body).name.startswith("piece_"))


def _pieces(model: mujoco.MjModel) -> dict[str, list[int]]:
    """Bodies of the pieces by part."""
    pieces: dict[str, list[int]] = {}
    for body in range(model.nbody):
        if _is_piece(model, body):
            geom = model.geom(model.body(body).name).id
            pieces.setdefault(_part_name(model, geom), []).append(body)
    return pieces


def _part_name(model: mujoco.MjModel, geom: int) -> str:
    return str(model.mesh(model.geom_dataid[geom]).name)


def _pose(position: Array, quaternion_wxyz: Array) -> rr.Transform3D:
    return rr.Transform3D(translation=position, quaternion=np.asarray(quaternion_wxyz)[[1, 2, 3, 0]])


def _shape(model: mujoco.MjModel, geom: int) -> rr.AsComponents:
    """The archetype of a geom in its own frame."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    colour, solid = _colour(model, geom), rr.components.FillMode.Solid
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]), colour)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], colors=[colour], fill_mode=solid)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        # rerun's capsules begin at the origin, MuJoCo's are centred on it.
        middle = [(0.0, 0.0, -size[1])]
        return rr.Capsules3D(
            lengths=[2 * size[1]], radii=[size[0]], translations=middle, colors=[colour], fill_mode=solid
        )
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        half = [size[0]] * 3 if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        return rr.Ellipsoids3D(half_sizes=[half], colors=[colour], fill_mode=solid)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        half = [*np.minimum(size[:2], _FLOOR_HALF_SIZE_M), 0.005]
        return rr.Boxes3D(half_sizes=[half], centers=[(0, 0, -0.005)], colors=[colour], fill_mode=solid)
    return rr.Boxes3D(half_sizes=[size], colors=[colour], fill_mode=solid)


def _colour(model: mujoco.MjModel, geom: int) -> list[int]:
    material = model.geom_matid[geom]
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    if material >= 0 and model.material(material).name == "concrete":
        rgba = (0.42, 0.43, 0.44, 1.0)  # its colour is in its texture
    return [round(255 * float(value)) for value in rgba]


def _piece_mesh(model: mujoco.MjModel, body: int) -> rr.Mesh3D:
    """The mesh of a piece in the frame of its part, so that the poses of pieces are those of its instances."""
    geom = model.geom(model.body(body).name).id
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[geom])
    T_part_mesh = np.eye(4)
    T_part_mesh[:3, :3], T_part_mesh[:3, 3] = R.reshape(3, 3), model.geom_pos[geom]
    return _mesh(model, int(model.geom_dataid[geom]), _colour(model, geom), T_part_mesh)


def _mesh(model: mujoco.MjModel, mesh: int, colour: Sequence[int], T_frame_mesh: Array | None = None) -> rr.Mesh3D:
    """A mesh in MuJoCo's centred frame or another; MuJoCo numbers vertices and normals apart, rerun together."""
    T = np.eye(4) if T_frame_mesh is None else T_frame_mesh
    first_vertex, first_normal = model.mesh_vertadr[mesh], model.mesh_normaladr[mesh]
    first_face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    span = slice(first_face, first_face + faces)
    corners = np.stack([model.mesh_face[span].ravel(), model.mesh_facenormal[span].ravel()], axis=1)
    pairs, number = np.unique(corners, axis=0, return_inverse=True)
    return rr.Mesh3D(
        vertex_positions=model.mesh_vert[first_vertex + pairs[:, 0]] @ T[:3, :3].T + T[:3, 3],
        vertex_normals=model.mesh_normal[first_normal + pairs[:, 1]] @ T[:3, :3].T,
        triangle_indices=number.reshape(-1, 3),
        albedo_factor=colour,
    )
