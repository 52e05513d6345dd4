"""The drawings of the three parts: what is turned, drilled and cast, in millimetres.

Frame of every part: z is the axis of revolution, +z the front (the face of the hat or cup), the origin on the axis
at mid-height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from manifold3d import CrossSection, Manifold

from benchmark.world import shapes
from benchmark.world.shapes import Point

CAST_IRON_KG_M3 = 7200.0
ALUMINIUM_KG_M3 = 2700.0


@dataclass(frozen=True)
class Edge:
    """A circular edge of the profile, or of holes drilled along the axis.

    Attributes:
        name: what a person would call it.
        radius: in mm.
        z: in mm.
        side: +1 where it is seen from the front, -1 from the back.
        offset: distance of its centre from the axis in mm; the centre of the first copy lies on +x.
        copies: number of equal edges, evenly spaced around the axis.
    """

    name: str
    radius: float
    z: float
    side: int
    offset: float = 0.0
    copies: int = 1


@dataclass(frozen=True)
class Design:
    """One drawing.

    Attributes:
        name: the part's name.
        diameter: nominal outline in mm.
        density_kg_m3: of the material.
        rgba: its colour.
        fold: the part is unchanged by 1 / fold of a turn about z.
        bore: diameter, front z and back z of the central bore in mm.
        edges: the main circular edges.
        solid: makes the exact solid.
        pieces: makes the convex collision pieces.
    """

    name: str
    diameter: float
    density_kg_m3: float
    rgba: tuple[float, float, float, float]
    fold: int
    bore: tuple[float, float, float]
    edges: tuple[Edge, ...]
    solid: Callable[[], Manifold]
    pieces: Callable[[], list[Manifold]]


# ---------------------------------------------------------------- hub
# A brake hub rotor: flange z -26..-12, hat up to z 26 with a 9 mm top, hollow beneath, bore in a collar 15 mm deep.


def hub_profile() -> list[Point]:
    """(r, z) outline of the brake hub."""
    return [
        (62.2, -26.0),
        (119.8, -26.0),
        (120.0, -25.8),
        (120.0, -12.2),
        (119.8, -12.0),
        *shapes.arc((75.0, -8.0), 4.0, 270.0, 180.0),
        (71.0, 25.8),
        (70.8, 26.0),
        (32.2, 26.0),
        (32.0, 25.8),
        (32.0, 11.2),
        (32.2, 11.0),
        (39.0, 11.0),
        *shapes.arc((41.0, 15.0), 2.0, 180.0, 90.0),
        *shapes.arc((59.5, 14.5), 2.5, 90.0, 0.0),
        (62.0, -25.8),
    ]


def hub_solid() -> Manifold:
    """The turned hub less 5 bolt holes on a 104 mm circle and 20 cooling holes on a 195 mm circle."""
    bolts = shapes.ring_of(shapes.drill(7.0, 17.0, 26.0, 0.2).translate((52.0, 0.0, 0.0)), 5)
    cooling = shapes.ring_of(shapes.drill(4.75, -26.0, -12.0, 0.2).translate((97.5, 0.0, 0.0)), 20)
    return shapes.lathe(hub_profile(), 240) - bolts - cooling


def hub_pieces() -> list[Manifold]:
    """Collar, top, hat wall and flange; the bolt and cooling holes are closed."""
    collar = [(32.0, 11.0), (39.0, 11.0), (39.0, 26.0), (32.0, 26.0)]
    top = [(39.0, 17.0), (71.0, 17.0), (71.0, 25.8), (70.8, 26.0), (39.0, 26.0)]
    wall = [(62.0, -12.0), (71.0, -12.0), (71.0, 17.0), (62.0, 17.0)]
    flange = [(62.0, -26.0), (119.8, -26.0), (120.0, -25.8), (120.0, -12.2), (119.8, -12.0), (62.0, -12.0)]
    return [
        *shapes.convex_ring(collar, 20, 3, bore=True),
        *shapes.convex_ring(top, 10, 6),
        *shapes.convex_ring(wall, 15, 4),
        *shapes.convex_ring(flange, 15, 6),
    ]


HUB = Design(
    name="hub",
    diameter=240.0,
    density_kg_m3=CAST_IRON_KG_M3,
    rgba=(0.50, 0.50, 0.51, 1.0),
    fold=5,
    bore=(64.0, 26.0, 11.0),
    edges=(
        Edge("outline_front", 120.0, -12.2, +1),
        Edge("hat_front", 71.0, 25.8, +1),
        Edge("bore_front", 32.0, 25.8, +1),
        Edge("outline_back", 120.0, -25.8, -1),
        Edge("hollow_back", 62.0, -25.8, -1),
        Edge("collar_back", 39.0, 11.0, -1),
        Edge("bore_back", 32.0, 11.2, -1),
        Edge("bolt_hole_front", 7.0, 25.8, +1, 52.0, 5),
        Edge("bolt_hole_back", 7.0, 17.2, -1, 52.0, 5),
        Edge("cooling_hole_front", 4.75, -12.2, +1, 97.5, 20),
        Edge("cooling_hole_back", 4.75, -25.8, -1, 97.5, 20),
    ),
    solid=hub_solid,
    pieces=hub_pieces,
)


# ---------------------------------------------------------------- cover 1
# A small die-cast cup: wall 1.6, face z 2.4..4.2, bearing boss z 0..7, six vents and three screw holes between them.


def cover1_profile() -> list[Point]:
    """(r, z) outline of the small cover."""
    return [
        (13.4, -7.0),
        (14.95, -7.0),
        (15.0, -6.95),
        (15.0, 4.15),
        (14.95, 4.2),
        *shapes.arc((8.8, 5.0), 0.8, 270.0, 180.0),
        (8.0, 6.95),
        (7.95, 7.0),
        (5.05, 7.0),
        (5.0, 6.95),
        (5.0, 0.05),
        (5.05, 0.0),
        (8.0, 0.0),
        *shapes.arc((8.6, 1.8), 0.6, 180.0, 90.0),
        *shapes.arc((12.4, 1.4), 1.0, 90.0, 0.0),
    ]


def cover1_solid() -> Manifold:
    """The cup with its screw bosses, less six vent slots and three screw holes."""
    bosses = shapes.ring_of(_screw_boss(), 3)
    vents = shapes.ring_of(shapes.prism(shapes.arc_slot(10.6, 1.2, 12.0), -2.0, 6.0), 6, 30.0)
    screws = shapes.ring_of(shapes.drill(1.1, -0.5, 4.2, 0.05).translate((11.6, 0.0, 0.0)), 3)
    return shapes.lathe(cover1_profile(), 180) + bosses - vents - screws


def cover1_pieces() -> list[Manifold]:
    """Wall, face, boss and screw bosses; vents and screw holes are closed."""
    wall = [(13.4, -7.0), (14.95, -7.0), (15.0, -6.95), (15.0, 4.15), (14.95, 4.2), (13.4, 4.2)]
    face = [(8.0, 2.4), (13.5, 2.4), (13.5, 4.2), (8.0, 4.2)]
    boss = [(5.0, 0.0), (8.0, 0.0), (8.0, 6.95), (7.95, 7.0), (5.0, 7.0)]
    return [
        *shapes.convex_ring(wall, 18, 4),
        *shapes.convex_ring(face, 12, 3),
        *shapes.convex_ring(boss, 18, 3, bore=True),
        *shapes.rotations(_screw_boss(), 3),
    ]


def _screw_boss() -> Manifold:
    return shapes.prism(shapes.disc(11.6, 0.0, 2.1), -0.5, 3.0)


COVER1 = Design(
    name="cover1",
    diameter=30.0,
    density_kg_m3=ALUMINIUM_KG_M3,
    rgba=(0.68, 0.69, 0.70, 1.0),
    fold=3,
    bore=(10.0, 7.0, 0.0),
    edges=(
        Edge("outline_front", 15.0, 4.15, +1),
        Edge("boss_front", 8.0, 6.95, +1),
        Edge("bore_front", 5.0, 6.95, +1),
        Edge("outline_back", 15.0, -6.95, -1),
        Edge("cup_back", 13.4, -7.0, -1),
        Edge("boss_back", 8.0, 0.0, -1),
        Edge("bore_back", 5.0, 0.05, -1),
        Edge("screw_hole_front", 1.1, 4.15, +1, 11.6, 3),
        Edge("screw_boss_back", 2.1, -0.5, -1, 11.6, 3),
        Edge("screw_hole_back", 1.1, -0.45, -1, 11.6, 3),
    ),
    solid=cover1_solid,
    pieces=cover1_pieces,
)


# ---------------------------------------------------------------- cover 2
# The alternator's end shield: wall 2.6, face z 5..8, bearing boss z 0..14, twelve vents, ribs at every second spoke,
# three mounting ears at the open end.

EAR_CENTRE, EAR_RADIUS, EAR_HOLE_RADIUS = 35.2, 4.6, 2.25
EAR_BOTTOM, EAR_TOP = -14.0, -8.0


def cover2_profile() -> list[Point]:
    """(r, z) outline of the large cover."""
    return [
        (29.9, -14.0),
        (32.45, -14.0),
        (32.5, -13.95),
        (32.5, 7.95),
        (32.45, 8.0),
        *shapes.arc((16.5, 9.5), 1.5, 270.0, 180.0),
        (15.0, 13.95),
        (14.95, 14.0),
        (9.55, 14.0),
        (9.5, 13.95),
        (9.5, 0.05),
        (9.55, 0.0),
        (15.0, 0.0),
        *shapes.arc((16.0, 4.0), 1.0, 180.0, 90.0),
        *shapes.arc((28.4, 3.5), 1.5, 90.0, 0.0),
    ]


def cover2_solid() -> Manifold:
    """The cup with ribs and ears, less twelve vents and the ears' holes."""
    vents = shapes.ring_of(shapes.prism(shapes.radial_slot((20.0, 2.4), (25.6, 3.3)), -2.0, 11.0), 12, 15.0)
    holes = shapes.ring_of(
        shapes.drill(EAR_HOLE_RADIUS, EAR_BOTTOM, EAR_TOP, 0.05).translate((EAR_CENTRE, 0.0, 0.0)), 3
    )
    ribs = [*shapes.rotations(_front_rib(), 6), *shapes.rotations(_inner_rib(), 6)]
    solid = shapes.lathe(cover2_profile(), 180)
    for addition in [*ribs, *shapes.rotations(_ear(), 3)]:
        solid = solid + addition
    return solid - vents - holes


def cover2_pieces() -> list[Manifold]:
    """Wall, face, boss, ribs and ears; vents and holes are closed."""
    wall = [(29.9, -14.0), (32.45, -14.0), (32.5, -13.95), (32.5, 7.95), (32.45, 8.0), (29.9, 8.0)]
    face = [(15.0, 5.0), (30.0, 5.0), (30.0, 8.0), (15.0, 8.0)]
    boss = [(9.5, 0.0), (15.0, 0.0), (15.0, 13.95), (14.95, 14.0), (9.5, 14.0)]
    return [
        *shapes.convex_ring(wall, 15, 4),
        *shapes.convex_ring(face, 12, 3),
        *shapes.convex_ring(boss, 18, 3, bore=True),
        *shapes.rotations(_front_rib(), 6),
        *shapes.rotations(_inner_rib(), 6),
        *shapes.rotations(_ear(), 3),
    ]


def _front_rib() -> Manifold:
    corners = [(14.6, 7.0), (14.6, 12.0), (28.0, 8.0), (28.0, 7.0)]
    return shapes.hull((r, side, z) for r, z in corners for side in (-1.0, 1.0))


def _inner_rib() -> Manifold:
    return shapes.box((14.6, -0.9, 1.5), (30.5, 0.9, 5.5))


def _ear() -> Manifold:
    foot = CrossSection([[(31.0, -7.5), (31.5, -7.5), (31.5, 7.5), (31.0, 7.5)]])
    outline = CrossSection.batch_hull([foot, shapes.disc(EAR_CENTRE, 0.0, EAR_RADIUS)])
    shrunk = CrossSection.batch_hull([foot, shapes.disc(EAR_CENTRE, 0.0, EAR_RADIUS - 0.1)])
    return Manifold.batch_hull(
        [shapes.prism(outline, EAR_BOTTOM, EAR_TOP - 0.1), shapes.prism(shrunk, EAR_BOTTOM, EAR_TOP)]
    )


COVER2 = Design(
    name="cover2",
    diameter=65.0,
    density_kg_m3=ALUMINIUM_KG_M3,
    rgba=(0.68, 0.69, 0.70, 1.0),
    fold=3,
    bore=(19.0, 14.0, 0.0),
    edges=(
        Edge("outline_front", 32.5, 7.95, +1),
        Edge("boss_front", 15.0, 13.95, +1),
        Edge("bore_front", 9.5, 13.95, +1),
        Edge("outline_back", 32.5, -13.95, -1),
        Edge("cup_back", 29.9, -14.0, -1),
        Edge("boss_back", 15.0, 0.0, -1),
        Edge("bore_back", 9.5, 0.05, -1),
        Edge("ear_hole_front", 2.25, -8.05, +1, 35.2, 3),
        Edge("ear_hole_back", 2.25, -13.95, -1, 35.2, 3),
    ),
    solid=cover2_solid,
    pieces=cover2_pieces,
)

DESIGNS = {design.name: design for design in (HUB, COVER1, COVER2)}
