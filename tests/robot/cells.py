"""Small scenes for the robot's tests, composed without the benchmark."""

from __future__ import annotations

import mujoco

from robot.arm import PUMA_761, SCENES

GRIPPER_PREFIX = "gripper/"


def spec(bodies: str = "") -> mujoco.MjSpec:
    """The floor, the arm at the origin with the gripper on its flange, and extra MJCF bodies."""
    world = mujoco.MjSpec.from_string(f"""
      <mujoco>
        <option integrator="implicitfast" timestep="0.002" cone="elliptic" impratio="10" noslip_iterations="3"/>
        <worldbody><geom name="floor" type="plane" size="3 3 0.1"/>{bodies}</worldbody>
      </mujoco>""")
    arm, gripper = (mujoco.MjSpec.from_file(str(path)) for path in (PUMA_761, SCENES / "gripper.xml"))
    flange = world.attach(arm, prefix="", frame=world.worldbody.add_frame())
    del flange
    world.attach(gripper, prefix=GRIPPER_PREFIX, site=world.site("flange"))
    return world


def ring(inner_m: float, outer_m: float, half_height_m: float, mass_kg: float, pos: str, wedges: int = 24) -> str:
    """A free ring with a real bore, made of boxes."""
    import numpy as np

    angles = 2 * np.pi * np.arange(wedges) / wedges
    middle, half = (inner_m + outer_m) / 2, (outer_m - inner_m) / 2
    width = outer_m * np.tan(np.pi / wedges)
    boxes = "".join(
        f'<geom type="box" size="{half} {width} {half_height_m}" pos="{middle * np.cos(a)} {middle * np.sin(a)} 0"'
        f' euler="0 0 {np.degrees(a)}" mass="{mass_kg / wedges}" condim="4" friction="0.5 0.005 0.0001"/>'
        for a in angles
    )
    return f'<body name="piece" pos="{pos}"><freejoint/>{boxes}</body>'
