"""Writes the aircraft of the scene by class: `python -m tests.support.airframe_shapes`."""

import json
from collections.abc import Callable
from functools import cache

import numpy as np

from app.scene.airframes import FILE, Part
from core.simulation.aircraft import AircraftClass
from tests.support.airframe_lofts import (
    GLASS,
    HULL,
    HULL_DARK,
    HULL_LIGHT,
    Blade,
    Skin,
    body,
    fighter,
    hinged,
    join,
    mirror,
    part,
)

GAP = 0.008
"""Slit around a surface, as a fraction of span or chord, so that it reads as separate."""
FLIP = np.array((1.0, -1.0, 1.0))
UP = (0.0, 1.0, 0.0)
"""Direction of the thickness of a fin."""


def lifting(
    wing: Blade, tailplane: Blade, fin: Blade, aileron: tuple[float, float], chord: float = 0.76
) -> tuple[Part, ...]:
    """Wings, tail and the hinged surfaces. aileron: from and to, as fractions of the half span.

    chord: fraction of it at which ailerons and rudder are hinged.
    """
    first, last = aileron
    panels = [
        wing.panel((0.0, first), (0.0, 1.0)),
        wing.panel((first, last), (0.0, chord - GAP)),
        wing.panel((last, 1.0), (0.0, 1.0)),
    ]
    surface = wing.panel((first + GAP, last - GAP), (chord, 1.0))
    inner, outer = wing.at(first, chord), wing.at(last, chord)
    fixed, tail = join(*panels), tailplane.panel((0.0, 1.0), (0.0, 1.0))
    upright = fin.panel((0.0, 1.0), (0.0, chord - GAP))
    rudder = fin.panel((0.06, 0.94), (chord, 1.0))
    return (
        part("wings", join(fixed, mirror(fixed)), HULL_LIGHT),
        part("tailplanes", join(tail, mirror(tail)), HULL_LIGHT),
        part("fin", upright, HULL_LIGHT),
        hinged("right_aileron", surface, inner, outer),
        # From tip to root, so that a positive turn is trailing edge down on this side too.
        hinged("left_aileron", mirror(surface), outer * FLIP, inner * FLIP),
        hinged("rudder", rudder, fin.at(0.06, chord), fin.at(0.94, chord)),
    )


def _both_sides(skin: Skin, y: float) -> Skin:
    right = skin[0] + (0.0, y, 0.0), skin[1]
    return join(right, mirror(right))


@cache
def transport() -> tuple[Part, ...]:
    """A swept wing of high aspect ratio, two engines under it, a tube for a body."""
    wing = Blade((2.0, 0.6, 0.35), (-2.6, 7.4, -0.25), 3.0, 0.8, 0.10)
    tailplane = Blade((-5.4, 0.3, -0.35), (-7.1, 2.8, -0.55), 1.6, 0.6, 0.09)
    fin = Blade((-4.8, 0.0, -0.6), (-7.0, 0.0, -3.5), 2.5, 1.0, 0.09, up=UP)
    tube = body([
        (7.4, 0.05, 0.05, 0.15, 2.0), (6.9, 0.45, 0.42, 0.10, 2.0), (5.8, 0.75, 0.75, 0.0, 2.0),
        (4.0, 0.85, 0.85, 0.0, 2.0), (-2.5, 0.85, 0.85, 0.0, 2.0), (-5.0, 0.60, 0.60, -0.2, 2.0),
        (-7.4, 0.10, 0.12, -0.5, 2.0),
    ])  # fmt: skip
    windscreen = body([
        (6.7, 0.20, 0.10, -0.30, 2.0), (6.2, 0.46, 0.18, -0.46, 2.0), (5.6, 0.40, 0.08, -0.66, 2.0),
    ], 20)  # fmt: skip
    engine = body([
        (2.4, 0.36, 0.36, 0.95, 2.0), (1.6, 0.46, 0.46, 0.95, 2.0), (-0.2, 0.36, 0.36, 0.9, 2.0),
        (-0.7, 0.20, 0.20, 0.9, 2.0),
    ], 24)  # fmt: skip
    return (
        part("fuselage", tube, HULL),
        part("canopy", windscreen, GLASS),
        part("engines", _both_sides(engine, 2.5), HULL_DARK),
        *lifting(wing, tailplane, fin, (0.62, 0.94)),
    )


@cache
def light() -> tuple[Part, ...]:
    """A straight wing, a short body, a canopy amidships."""
    wing = Blade((1.4, 0.4, 0.25), (0.9, 5.6, 0.0), 1.9, 1.2, 0.13)
    tailplane = Blade((-3.9, 0.15, -0.1), (-4.2, 1.9, -0.1), 1.2, 0.7, 0.10)
    fin = Blade((-3.4, 0.0, -0.3), (-4.5, 0.0, -2.2), 1.8, 0.9, 0.10, up=UP)
    hull = body([
        (4.2, 0.06, 0.06, 0.05, 2.0), (3.8, 0.34, 0.34, 0.03, 2.0), (2.4, 0.56, 0.58, 0.0, 2.3),
        (0.4, 0.60, 0.66, 0.0, 2.5), (-1.6, 0.46, 0.50, -0.05, 2.2), (-5.0, 0.10, 0.16, -0.15, 2.0),
    ])  # fmt: skip
    canopy = body([
        (2.2, 0.10, 0.06, -0.52, 2.0), (1.5, 0.42, 0.34, -0.62, 2.2), (0.0, 0.44, 0.38, -0.62, 2.2),
        (-1.4, 0.14, 0.08, -0.50, 2.0),
    ], 24)  # fmt: skip
    spinner = body([(4.75, 0.02, 0.02, 0.05, 2.0), (4.15, 0.24, 0.24, 0.05, 2.0)], 16)
    return (
        part("fuselage", hull, HULL),
        part("canopy", canopy, GLASS),
        part("spinner", spinner, HULL_DARK),
        *lifting(wing, tailplane, fin, (0.56, 0.95)),
    )


AIRFRAMES: dict[AircraftClass, Callable[[], tuple[Part, ...]]] = {
    "fighter": fighter,
    "transport": transport,
    "light": light,
}


def write() -> None:
    arrays, parts = {}, {}
    for name, make in AIRFRAMES.items():
        parts[name] = []
        for each in make():
            about = {key: getattr(each, key) for key in ("name", "colour", "hinge", "axis")}
            parts[name].append(about)
            arrays[f"{name}/{each.name}/vertices"] = each.vertices
            arrays[f"{name}/{each.name}/faces"] = each.faces
    np.savez_compressed(FILE, parts=np.array(json.dumps(parts)), **arrays)


if __name__ == "__main__":
    write()
