"""Makes one solid of the bodies in a mesh that a user brings.

A closed surface consists of shells. One that faces outwards bounds a body; one that faces inwards and lies within a
body is the hollow in it. Bodies that overlap or touch are united. Lengths are in millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from benchmark.meshes.shells import Shell, shells_of
from benchmark.meshes.surface import GAP_MM, TURN, Surface

Floats = NDArray[np.float64]

APART_MM = 0.1  # bodies further from one another's hull than this do not make one part
MOST_TURNED = 0.25  # share of a sheet's area that may be turned before it is in doubt which way the sheet looks
TWICE = 1e-3  # share of a shell's volume that its own surface may enclose twice: neighbouring fillets cross a little
WALL_MM = 0.1  # around a hollow; what is nearer to the surface touches it
SMALL_MM = 0.1  # up to this length, a shell as thin as a gap is a crumb
NEGLIGIBLE = 1e-6  # of a body's volume
SLICES = 64


class BodiesError(Exception):
    """Bodies of which it is in doubt what solid they make.

    Attributes:
        got: what they are.
        do: the remedy.
    """

    def __init__(self, got: str, do: str) -> None:
        super().__init__(got)
        self.got, self.do = got, do


def one_solid(surface: Surface) -> Manifold:
    """The solid that a closed surface bounds.

    Raises:
        BodiesError: the surface passes through itself, or it is in doubt what the shells in it stand for.
    """
    try:
        shells = _shells(surface, by_angle=False)
    except BodiesError:
        shells = _shells(surface, by_angle=True)
    if len(shells) == 1:
        return shells[0]
    if surface.turned > MOST_TURNED:
        raise BodiesError(
            f"{len(shells)} bodies with triangles that look in opposite directions",
            TURN,
        )
    solid = Manifold.batch_boolean(_bodies(shells), manifold3d.OpType.Add)
    _check_in_one_place(solid)
    return solid


def _shells(surface: Surface, by_angle: bool) -> list[Manifold]:
    """The shells of a surface, the largest first; altogether they enclose more than nothing.

    Raises:
        BodiesError: they do not, or one passes through itself.
    """
    shells = [shell for shell in shells_of(surface, by_angle) if not _is_crumb(shell)]
    if not shells:
        raise BodiesError("crumbs", "Export the part as a solid.")
    if sum(shell.volume for shell in shells) < 0:  # its triangles look inwards
        shells = [shell.inside_out() for shell in shells]
    return sorted(map(_manifold, shells), key=lambda shell: -abs(shell.volume()))


def _is_crumb(shell: Shell) -> bool:
    """Whether a shell is too small to count.

    Raises:
        BodiesError: it is as thin as nothing, but not small.
    """
    if 2 * abs(shell.volume) > GAP_MM * shell.area:
        return False
    size = np.ptp(shell.vertices, axis=0)
    if size.max() > SMALL_MM:
        told = " x ".join(f"{length:.3g}" for length in size)
        raise BodiesError(f"a sheet of {told} mm without thickness", "Delete it, or export the part as a solid.")
    return True


def _manifold(shell: Shell) -> Manifold:
    """A shell for exact cuts.

    Raises:
        BodiesError: it passes through itself, or touches itself.
    """
    solid = _as_is(shell)
    outwards = solid if shell.volume > 0 else _as_is(shell.inside_out())
    _check_simple(outwards)
    if shell.touches_itself or abs(solid.volume() - shell.volume) > NEGLIGIBLE * abs(shell.volume):
        raise BodiesError("a surface that touches itself", "Unite what touches in the program that made it.")
    return solid


def _as_is(shell: Shell) -> Manifold:
    return Manifold(manifold3d.Mesh64(np.array(shell.vertices), np.array(shell.faces, dtype=np.uint64)))


def _inside_out(shell: Manifold) -> Manifold:
    mesh = shell.to_mesh64()
    return _as_is(Shell(mesh.vert_properties[:, :3], mesh.tri_verts[:, ::-1].astype(np.int64)))


def _check_simple(shell: Manifold) -> None:
    """Make sure that a shell encloses nothing twice.

    A slice fills what is within its outlines once. The area within the outlines by their own measure is larger where
    they overlap.

    Raises:
        BodiesError: the shell passes through itself.
    """
    _, _, low, _, _, high = shell.bounding_box()
    heights = low + (np.arange(SLICES) + 0.5) * (high - low) / SLICES
    filled = np.array([shell.slice(height).area() for height in heights])
    different = np.abs(_measured_areas(shell, heights) - filled).sum()
    if different > TWICE * filled.sum():
        raise BodiesError(
            f"a surface that passes through itself, with {different / filled.sum():.1%} of its volume enclosed twice",
            "Unite what overlaps in the program that made it.",
        )


def _measured_areas(shell: Manifold, heights: Floats) -> Floats:
    """The areas within the outlines at some heights, by the integral along the sides of the outlines."""
    mesh = shell.to_mesh64()
    corners = mesh.vert_properties[:, :3][mesh.tri_verts.astype(np.int64)]
    return np.array([_measured_area(corners, height) for height in heights])


def _measured_area(corners: Floats, height: float) -> float:
    above = corners[:, :, 2] > height
    cut = above.any(axis=1) & ~above.all(axis=1)
    corners, above = corners[cut], above[cut]
    # Turn each triangle so that its first corner is alone on its side of the plane.
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners, order[:, :, None], axis=1).transpose(1, 0, 2)
    p, q = (a + (o - a) * ((height - a[:, 2]) / (o[:, 2] - a[:, 2]))[:, None] for o in (b, c))
    areas = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2
    return float(np.where(a[:, 2] > height, areas, -areas).sum())


def _bodies(shells: Sequence[Manifold]) -> list[Manifold]:
    """Every shell that faces outwards with the hollows in it taken out, and shells that are inside out turned.

    Raises:
        BodiesError: a shell is a hollow or a body, and nobody can tell which.
    """
    outer = [shell for shell in shells if shell.volume() > 0]
    hollows: list[list[Manifold]] = [[] for _ in outer]
    for shell in (_inside_out(shell) for shell in shells if shell.volume() < 0):
        places = [_place(shell, body) for body in outer]
        if "within" in places:  # the last is the smallest
            hollows[len(places) - 1 - places[::-1].index("within")].append(shell)
        elif "flush" in places:
            raise _doubt(shell, "faces inwards and touches from within the body that it lies in")
        else:
            outer.append(shell)
            hollows.append([])
    outwards = sum(shell.volume() > 0 for shell in shells)
    if len(outer) > outwards and any(hollows):
        raise BodiesError(f"{len(outer) - outwards} bodies inside out, and hollows that may be either", TURN)
    bodies = [_hollowed(*pair) for pair in zip(outer, hollows, strict=True)]
    for k, shell in enumerate(outer):
        if any(_place(shell, body) == "within" for body in bodies[:k] + bodies[k + 1 :]):
            raise _doubt(shell, "lies within another one and faces outwards")
    return bodies


def _doubt(shell: Manifold, what: str) -> BodiesError:
    return BodiesError(
        f"a body of {_size(shell)} that {what}",
        "Turn its faces inwards if it is a hollow that does not touch the surface; else unite it with the body "
        "around it, or delete it.",
    )


def _size(body: Manifold) -> str:
    x0, y0, z0, x1, y1, z1 = body.bounding_box()
    return " x ".join(f"{length:.3g}" for length in (x1 - x0, y1 - y0, z1 - z0)) + " mm"


def _hollowed(body: Manifold, hollows: Sequence[Manifold]) -> Manifold:
    left = Manifold.batch_boolean([body, *hollows], manifold3d.OpType.Subtract) if hollows else body
    taken = sum(hollow.volume() for hollow in hollows)
    if abs(body.volume() - taken - left.volume()) > NEGLIGIBLE * body.volume():
        raise BodiesError(f"{len(hollows)} hollows that overlap", "Unite them, or delete those that are too many.")
    return left


def _place(shell: Manifold, body: Manifold) -> str:
    """Where a shell that faces outwards is: ``apart``, ``across`` the surface of a body, ``within`` or ``flush``.

    Flush is what lies within the body but for a wall that is too thin to be one.
    """
    little = NEGLIGIBLE * shell.volume()
    if not _boxes_meet(shell, body, 0.0) or (shell ^ body).volume() <= little:
        return "apart"
    if (shell - body).volume() > little:
        return "across"
    low, high = np.reshape(body.bounding_box(), (2, 3))
    around = Manifold.cube(tuple(high - low + 2)).translate(tuple(low - 1)) - body
    return "within" if around.min_gap(shell, 2 * WALL_MM) > WALL_MM else "flush"


def _boxes_meet(one: Manifold, other: Manifold, margin: float) -> bool:
    a, b = np.reshape(one.bounding_box(), (2, 3)), np.reshape(other.bounding_box(), (2, 3))
    return bool((a[0] <= b[1] + margin).all() and (b[0] <= a[1] + margin).all())


def _check_in_one_place(solid: Manifold) -> None:
    """Make sure that the bodies touch, or reach into one another as those of a bearing.

    Raises:
        BodiesError: some lie apart.
    """
    bodies = [body for body in solid.decompose() if body.volume() > 0]
    hulls = [body.hull() for body in bodies]
    reached, ahead = {0}, [0]
    while ahead:
        here = ahead.pop()
        near = [k for k in range(len(hulls)) if k not in reached and _is_near(hulls[here], hulls[k])]
        reached.update(near)
        ahead += near
    if len(reached) < len(bodies):
        told = " and ".join(map(_size, bodies[:3])) + " and others" * (len(bodies) > 3)
        raise BodiesError(
            f"{len(bodies)} bodies that do not touch, of {told}",
            "Leave one in the file, or unite them in the program that made it.",
        )


def _is_near(one: Manifold, other: Manifold) -> bool:
    return _boxes_meet(one, other, APART_MM) and one.min_gap(other, 2 * APART_MM) < APART_MM
