"""Writes the aircraft of the scene by class: `python -m tests.support.airframe_shapes`.

No particular types: a single-engine fighter with its intake below, a transport with four engines
under a swept wing, a jet trainer with two seats, a straight wing and tanks at its tips.
"""

import json
from collections.abc import Callable
from functools import cache

import numpy as np

from app.scene.airframes import FILE, SPAN, Part
from core.simulation.aircraft import AircraftClass
from tests.support.airframe_lofts import (
    GLASS,
    HULL,
    HULL_DARK,
    HULL_LIGHT,
    MARKING,
    SILVER,
    WHITE,
    Blade,
    Colour,
    Skin,
    body,
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
SPINDLE = 0.5
"""Where an all-moving tailplane turns, as a fraction of its root chord."""


def lifting(
    wing: Blade,
    tailplane: Blade,
    fin: Blade,
    aileron: tuple[float, float],
    chord: float = 0.74,
    elevator: float | None = 0.66,
    colour: Colour = HULL_LIGHT,
) -> tuple[Part, ...]:
    """Wings, tail and the hinged surfaces. aileron: from and to, as fractions of the half span.

    chord, elevator: fraction of it at which ailerons and rudder, and elevators, are hinged; None
    for a tailplane that moves as a whole.
    """
    first, last = aileron
    panels = [
        wing.panel((0.0, first), (0.0, 1.0)),
        wing.panel((first, last), (0.0, chord - GAP)),
        wing.panel((last, 1.0), (0.0, 1.0)),
    ]
    surface = wing.panel((first + GAP, last - GAP), (chord, 1.0))
    fixed = join(*panels)
    upright = [
        fin.panel((0.0, 0.08), (0.0, 1.0)),
        fin.panel((0.08, 0.92), (0.0, chord - GAP)),
        fin.panel((0.92, 1.0), (0.0, 1.0)),
    ]
    rudder = fin.panel((0.08 + GAP, 0.92 - GAP), (chord, 1.0))
    return (
        part("wings", join(fixed, mirror(fixed)), colour),
        part("fin", join(*upright), colour),
        *_hinged_pair("aileron", surface, wing.at(first, chord), wing.at(last, chord)),
        hinged("rudder", rudder, fin.at(0.08, chord), fin.at(0.92, chord)),
        *_tail(tailplane, elevator, colour),
    )


def _tail(tailplane: Blade, elevator: float | None, colour: Colour) -> tuple[Part, ...]:
    if elevator is None:
        hinge = tailplane.at(0.0, SPINDLE)
        whole = tailplane.panel((0.0, 1.0), (0.0, 1.0))
        return _hinged_pair("elevator", whole, hinge, hinge + np.array(UP))
    fixed = tailplane.panel((0.0, 1.0), (0.0, elevator - GAP))
    surface = tailplane.panel((0.0, 1.0), (elevator, 1.0))
    hinges = tailplane.at(0.0, elevator), tailplane.at(1.0, elevator)
    stabilizer = part("tailplanes", join(fixed, mirror(fixed)), colour)
    return stabilizer, *_hinged_pair("elevator", surface, *hinges)


def _hinged_pair(name: str, right: Skin, inner: np.ndarray, outer: np.ndarray) -> tuple[Part, Part]:
    """Both sides of a surface; a positive turn of either is trailing edge down."""
    return (
        hinged(f"right_{name}", right, inner, outer),
        hinged(f"left_{name}", mirror(right), outer * FLIP, inner * FLIP),
    )


def moved(skin: Skin, y: float = 0.0, z: float = 0.0) -> Skin:
    return skin[0] + (0.0, y, z), skin[1]


def both_sides(*right: Skin) -> Skin:
    return join(*right, *map(mirror, right))


@cache
def fighter() -> tuple[Part, ...]:
    wing = Blade((1.9, 0.7, -0.05), (-2.3, SPAN / 2, 0.0), 5.2, 1.5, 0.05)
    tailplane = Blade((-4.6, 0.75, 0.05), (-6.5, 2.9, 0.2), 2.5, 0.9, 0.045)
    fin = Blade((-2.9, 0.0, -0.75), (-6.0, 0.0, -4.1), 3.9, 1.5, 0.055, up=UP)
    hull = body([
        (7.6, 0.03, 0.03, 0.14, 2.0), (7.0, 0.24, 0.22, 0.12, 2.0), (5.8, 0.48, 0.46, 0.05, 2.0),
        (4.4, 0.66, 0.66, -0.04, 2.2), (2.6, 0.82, 0.76, -0.05, 2.5), (0.6, 1.04, 0.78, 0.0, 3.0),
        (-2.0, 1.10, 0.74, 0.0, 3.0), (-4.4, 0.94, 0.68, 0.0, 2.6), (-6.0, 0.72, 0.60, 0.0, 2.2),
        (-6.7, 0.62, 0.56, 0.0, 2.0),
    ])  # fmt: skip
    spine = body([
        (1.6, 0.16, 0.14, -0.70, 2.0), (0.0, 0.32, 0.26, -0.72, 2.0),
        (-3.0, 0.30, 0.24, -0.68, 2.0), (-6.3, 0.10, 0.10, -0.56, 2.0),
    ], 20)  # fmt: skip
    canopy = body([
        (5.3, 0.05, 0.04, -0.46, 2.0), (4.7, 0.34, 0.32, -0.56, 2.0), (3.8, 0.48, 0.60, -0.66, 2.0),
        (2.8, 0.50, 0.64, -0.68, 2.0), (1.7, 0.40, 0.42, -0.70, 2.0), (0.4, 0.14, 0.12, -0.76, 2.0),
    ], 24)  # fmt: skip
    intake = body([
        (2.9, 0.66, 0.36, 0.86, 3.0), (1.6, 0.72, 0.42, 0.80, 3.0), (-1.6, 0.66, 0.36, 0.62, 3.0),
        (-4.2, 0.44, 0.18, 0.50, 2.5),
    ], 28)  # fmt: skip
    mouth = body([(2.96, 0.54, 0.26, 0.87, 3.0), (2.5, 0.54, 0.26, 0.87, 3.0)], 28)
    nozzle = body([
        (-6.3, 0.54, 0.49, 0.0, 2.0), (-7.0, 0.58, 0.54, 0.0, 2.0), (-7.5, 0.46, 0.44, 0.0, 2.0),
    ], 28)  # fmt: skip
    extension = Blade((4.4, 0.45, -0.08), (1.4, 1.5, -0.05), 3.6, 1.2, 0.02)
    ventral = Blade((-4.4, 0.62, 0.55), (-5.4, 1.05, 1.35), 1.7, 0.9, 0.05, up=UP)
    missile = body([
        (0.4, 0.02, 0.02, 0.0, 2.0), (0.0, 0.10, 0.10, 0.0, 2.0), (-3.6, 0.10, 0.10, 0.0, 2.0),
        (-4.0, 0.03, 0.03, 0.0, 2.0),
    ], 12)  # fmt: skip
    whole = (0.0, 1.0)
    return (
        part("fuselage", join(hull, spine), HULL),
        part("intake", intake, HULL),
        part("mouth", mouth, HULL_DARK),
        part("nozzle", nozzle, HULL_DARK),
        part("canopy", canopy, GLASS),
        part("extensions", both_sides(extension.panel(whole, whole)), HULL),
        part("ventral_fins", both_sides(ventral.panel(whole, whole)), HULL),
        part("missiles", both_sides(moved(missile, SPAN / 2 + 0.05)), WHITE),
        *lifting(wing, tailplane, fin, (0.42, 0.92), elevator=None),
    )


@cache
def transport() -> tuple[Part, ...]:
    wing = Blade((2.6, 0.6, 0.45), (-3.0, 7.6, -0.35), 3.6, 1.0, 0.10)
    tailplane = Blade((-5.6, 0.3, -0.35), (-7.3, 2.9, -0.6), 1.8, 0.7, 0.09)
    fin = Blade((-4.6, 0.0, -0.7), (-7.1, 0.0, -3.8), 2.9, 1.2, 0.09, up=UP)
    tube = body([
        (7.6, 0.06, 0.06, 0.20, 2.0), (7.1, 0.48, 0.44, 0.12, 2.0), (6.0, 0.80, 0.80, 0.0, 2.0),
        (4.2, 0.92, 0.92, 0.0, 2.0), (-2.5, 0.92, 0.92, 0.0, 2.0), (-5.0, 0.66, 0.66, -0.22, 2.0),
        (-7.8, 0.10, 0.14, -0.55, 2.0),
    ])  # fmt: skip
    windscreen = body([
        (6.95, 0.20, 0.10, -0.26, 2.0), (6.4, 0.52, 0.20, -0.46, 2.0),
        (5.9, 0.46, 0.08, -0.68, 2.0),
    ], 20)  # fmt: skip
    windows = body([(5.3, 0.93, 0.09, -0.22, 4.0), (-3.0, 0.93, 0.09, -0.22, 4.0)], 20)
    nacelle = body([
        (1.1, 0.40, 0.40, 0.0, 2.0), (0.5, 0.46, 0.46, 0.0, 2.0), (-0.9, 0.38, 0.38, 0.0, 2.0),
        (-1.3, 0.28, 0.28, 0.0, 2.0),
    ], 24)  # fmt: skip
    mouth = body([(1.13, 0.33, 0.33, 0.0, 2.0), (0.8, 0.33, 0.33, 0.0, 2.0)], 24)
    exhaust = body([(-1.1, 0.24, 0.24, 0.0, 2.0), (-1.7, 0.15, 0.15, 0.0, 2.0)], 24)
    skins: dict[str, list[Skin]] = {"engines": [], "mouths": [], "pylons": []}
    for ahead, out, below in ((1.9, 2.7, 1.15), (-0.3, 5.0, 0.85)):
        at = np.array((ahead, out, below))
        for name, skin in (("engines", nacelle), ("mouths", mouth), ("mouths", exhaust)):
            skins[name].append((skin[0] + at, skin[1]))
        foot, head = (ahead + 0.2, out, below - 0.3), (ahead - 0.3, out, below - 0.9)
        pylon = Blade(foot, head, 1.5, 1.5, 0.08, up=UP)
        skins["pylons"].append(pylon.panel((0.0, 1.0), (0.0, 1.0)))
    return (
        part("fuselage", tube, WHITE),
        part("canopy", windscreen, GLASS),
        part("windows", windows, MARKING),
        part("engines", both_sides(*skins["engines"]), SILVER),
        part("mouths", both_sides(*skins["mouths"]), HULL_DARK),
        part("pylons", both_sides(*skins["pylons"]), HULL_LIGHT),
        *lifting(wing, tailplane, fin, (0.60, 0.94), colour=SILVER),
    )


@cache
def light() -> tuple[Part, ...]:
    wing = Blade((1.6, 0.5, 0.30), (0.7, 5.0, -0.05), 2.7, 1.3, 0.11)
    tailplane = Blade((-4.6, 0.2, -0.55), (-5.0, 2.3, -0.60), 1.5, 0.8, 0.09)
    fin = Blade((-3.9, 0.0, -0.45), (-5.3, 0.0, -2.7), 2.3, 1.1, 0.09, up=UP)
    hull = body([
        (5.9, 0.08, 0.08, 0.10, 2.0), (5.3, 0.36, 0.36, 0.06, 2.0), (4.0, 0.56, 0.58, 0.0, 2.0),
        (2.2, 0.66, 0.70, 0.0, 2.2), (-0.6, 0.72, 0.70, 0.0, 2.4), (-3.0, 0.58, 0.58, -0.1, 2.2),
        (-5.6, 0.34, 0.36, -0.2, 2.0),
    ])  # fmt: skip
    canopy = body([
        (3.9, 0.06, 0.05, -0.50, 2.0), (3.3, 0.38, 0.40, -0.60, 2.0),
        (2.2, 0.46, 0.60, -0.66, 2.0), (0.4, 0.46, 0.60, -0.66, 2.0),
        (-0.8, 0.34, 0.34, -0.64, 2.0), (-2.0, 0.10, 0.08, -0.60, 2.0),
    ], 24)  # fmt: skip
    frame = body([(1.42, 0.475, 0.62, -0.66, 2.0), (1.22, 0.475, 0.62, -0.66, 2.0)], 24)
    intake = body([
        (1.9, 0.24, 0.40, 0.02, 2.5), (1.2, 0.30, 0.46, 0.02, 2.5), (-1.4, 0.16, 0.36, 0.0, 2.2),
    ], 20)  # fmt: skip
    mouth = body([(1.94, 0.17, 0.31, 0.02, 2.5), (1.6, 0.17, 0.31, 0.02, 2.5)], 20)
    tank = body([
        (2.6, 0.03, 0.03, 0.0, 2.0), (2.0, 0.28, 0.28, 0.0, 2.0), (0.6, 0.40, 0.40, 0.0, 2.0),
        (-1.0, 0.36, 0.36, 0.0, 2.0), (-2.6, 0.04, 0.04, 0.0, 2.0),
    ], 20)  # fmt: skip
    exhaust = body([(-5.4, 0.26, 0.28, -0.2, 2.0), (-5.75, 0.24, 0.26, -0.2, 2.0)], 20)
    return (
        part("fuselage", hull, SILVER),
        part("canopy", canopy, GLASS),
        part("canopy_frame", frame, SILVER),
        part("intakes", both_sides(moved(intake, 0.72)), SILVER),
        part("mouths", join(both_sides(moved(mouth, 0.72)), exhaust), HULL_DARK),
        part("tanks", both_sides(moved(tank, 5.2, -0.05)), MARKING),
        *lifting(wing, tailplane, fin, (0.48, 0.92), colour=HULL_LIGHT),
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
