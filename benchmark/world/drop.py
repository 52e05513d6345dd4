"""Drop the pieces into the bin and wait until they rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmark.world.parts import get_part
from benchmark.world.scene import CellConfig

Array = NDArray[np.float64]
OnStep = Callable[[], None]

REST_SPEED_DIAMETERS_S = 0.01
REST_TIME_S = 0.2
TIMEOUT_S = 6.0
_CHECK_EVERY_STEPS = 10


@dataclass(frozen=True)
class DropResult:
    """How a drop ended.

    Attributes:
        settled: every piece in the bin came to rest before the timeout.
        in_bin: for every piece, whether its centre ended up between the bin's walls.
    """

    settled: bool
    in_bin: tuple[bool, ...]


def drop_pieces(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    config: CellConfig,
    rng: np.random.Generator,
    on_step: OnStep | None = None,
) -> DropResult:
    """Let the pieces fall into the bin one after another, each from a random pose just above the heap.

    A piece rests when neither its centre nor its rim moves faster than a hundredth of its diameter per second; the
    drop is over when all pieces in the bin have rested for 0.2 s on end, or 6 s after the last one was let go.

    Args:
        model: the compiled cell.
        data: its state, changed in place; the arm holds whatever its controls say.
        config: the sizes of the cell.
        rng: the source of the poses.
        on_step: called after every physics step.
    """
    bodies = [model.body(f"piece_{i}").id for i in range(config.pieces)]
    diameters = np.array([get_part(name).diameter_m for name in config.piece_parts])
    _hover(model, data, bodies)
    for number, body in enumerate(bodies):
        _release(model, data, config, rng, bodies[:number], body, diameters[number])
        _run(model, data, 0.1 + 0.6 * float(np.sqrt(diameters[number])), on_step)
    start = resting_since = data.time
    while data.time - start < TIMEOUT_S:
        _run(model, data, _CHECK_EVERY_STEPS * model.opt.timestep, on_step)
        inside = in_bin(data, config, bodies)
        if (rim_speeds(model, data, bodies, diameters) > REST_SPEED_DIAMETERS_S * diameters)[inside].any():
            resting_since = data.time
        elif data.time - resting_since >= REST_TIME_S:
            break
    settled = data.time - resting_since >= REST_TIME_S
    inside = in_bin(data, config, bodies)
    return DropResult(settled, tuple(bool(value) for value in inside))


def in_bin(data: mujoco.MjData, config: CellConfig, bodies: list[int]) -> NDArray[np.bool_]:
    """For every body, whether its centre is between the walls of the bin and not below its floor."""
    offset = data.xpos[bodies] - config.bin_centre_m
    half = np.array(config.bin_size_m) / 2
    return np.asarray((np.abs(offset[:, :2]) < half).all(axis=1) & (offset[:, 2] > 0))


def rim_speeds(model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int], diameters: Array) -> Array:
    """The larger of the centre's speed and the rim's speed about it, per body, in m/s."""
    velocities = np.stack([data.qvel[_dof_slice(model, body)] for body in bodies])
    return np.maximum(
        np.linalg.norm(velocities[:, :3], axis=1), np.linalg.norm(velocities[:, 3:], axis=1) * diameters / 2
    )


def _dof_slice(model: mujoco.MjModel, body: int) -> slice:
    start = model.body_dofadr[body]
    return slice(start, start + 6)


def _hover(model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]) -> None:
    """Bear the weight of pieces that wait for their release high above the cell."""
    for body in bodies:
        data.xfrc_applied[body, :3] = -model.opt.gravity * model.body_mass[body]


def _release(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    config: CellConfig,
    rng: np.random.Generator,
    released: list[int],
    body: int,
    diameter_m: float,
) -> None:
    """Put one piece at a random pose just above the walls and the heap, and let go of it."""
    half = np.maximum(np.array(config.bin_size_m) / 2 - 0.55 * diameter_m, 0.0)
    top = config.bin_centre_m[2] + config.bin_wall_m
    inside = [b for b, kept in zip(released, in_bin(data, config, released), strict=True) if kept] if released else []
    heap = max((float(data.xpos[b, 2]) for b in inside), default=0.0) + 0.5 * diameter_m
    position = (*(np.array(config.bin_centre_m[:2]) + rng.uniform(-half, half)), max(top, heap) + 0.55 * diameter_m)
    address = model.jnt_qposadr[model.body_jntadr[body]]
    data.qpos[address : address + 3] = position
    data.qpos[address + 3 : address + 7] = Rotation.random(rng=rng).as_quat(scalar_first=True)
    data.qvel[_dof_slice(model, body)] = 0.0
    data.xfrc_applied[body] = 0.0


def _run(model: mujoco.MjModel, data: mujoco.MjData, seconds: float, on_step: OnStep | None) -> None:
    steps = max(1, round(seconds / model.opt.timestep))
    if on_step is None:
        mujoco.mj_step(model, data, steps)
        return
    for _ in range(steps):
        mujoco.mj_step(model, data)
        on_step()
