"""The belt pulley, taught by the simulated person through the same calls as the benchmark's own parts."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from benchmark.study.simulated_person import Operator, record
from benchmark.world.part import Part, Rim
from benchmark.world.parts import get_part
from tests.parts.belt_pulley import MESH, RIMS
from vision.geometry.camera import View
from vision.teaching.session import Session


def pulley_with_rims() -> Part:
    """The part as measured on its mesh, and the rims that the person's eye sees."""
    rims = tuple(Rim(r.name, r.z * 1e-3, r.radius * 1e-3, r.side, r.offset * 1e-3, r.copies) for r in RIMS)
    return replace(get_part(str(MESH)), rims=rims)


@cache
def recorded() -> tuple[Session, list[View]]:
    """The session and the views that it was recorded on: clicks with an error of one pixel."""
    return record(pulley_with_rims(), Operator(seed=3))
