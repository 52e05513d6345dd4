"""The peg and the bores of an insertion's cell have the clearance that was asked for, as contact sees them."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmark.world.fixtures import PEG_SIDES, PegTool, peg_for
from benchmark.world.parts import PART_NAMES, get_part
from benchmark.world.scene import build_model, cell_config
from vision.errors import InputError


@pytest.mark.parametrize("part", [*PART_NAMES])
def test_a_bore_is_round_to_a_hundredth_of_a_millimetre(part: str) -> None:
    """Rays from the axis meet the contact hulls nowhere before the nominal radius, and soon behind it."""
    bore = get_part(part).bore
    assert bore is not None
    model = build_model(replace(cell_config((part,), 1), peg=peg_for(bore, 1e-4)))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = model.body("piece_0").id
    frame = data.xmat[body].reshape(3, 3)
    middle = bore.T_part_bore.apply([0.0, 0.0, bore.depth_m / 2])
    only_hulls = np.zeros(6, np.uint8)
    only_hulls[3] = 1
    radii = []
    for turn in np.linspace(0, 2 * np.pi, 400):
        direction = frame @ [np.cos(turn), np.sin(turn), 0.0]
        hit = np.zeros(1, np.int32)
        radii.append(mujoco.mj_ray(model, data, data.xpos[body] + frame @ middle, direction, only_hulls, 1, -1, hit))
    radius = bore.diameter_m / 2
    assert min(radii) > radius - 1e-6
    assert max(radii) < radius + 1.2e-5


def test_the_peg_is_as_thick_as_asked_and_chamfered() -> None:
    peg = PegTool(0.019, chamfer_m=0.0005)
    radii = np.hypot(peg.vertices[:, 0], peg.vertices[:, 1])
    assert radii.max() == pytest.approx(0.0095)
    assert (radii.max() * (1 - np.cos(np.pi / PEG_SIDES))) < 1e-5  # what the polygon lacks between its corners
    assert radii[np.argmax(peg.vertices[:, 2])] == pytest.approx(0.009)


def test_pegs_that_make_no_sense_are_refused() -> None:
    bore = get_part("cover1").bore
    assert bore is not None
    with pytest.raises(InputError, match="clearance"):
        peg_for(bore, 0.0)
    with pytest.raises(InputError, match="chamfer"):
        PegTool(0.001, chamfer_m=0.001)
