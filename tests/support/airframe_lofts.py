"""Lofts: skins of bodies and lifting surfaces, and parts made of them.

Body axes, metres: x forward, y right, z down, origin at the centre of gravity.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from app.scene.airframes import Part, Point
from app.scene.shown import Colour
from core.types import Array, Indices

Skin = tuple[Array, Indices]

HULL: Colour = (78, 88, 102)
HULL_LIGHT: Colour = (104, 116, 132)
HULL_DARK: Colour = (16, 19, 25)
SILVER: Colour = (146, 154, 164)
WHITE: Colour = (188, 194, 202)
MARKING: Colour = (14, 44, 92)
GLASS: Colour = (10, 40, 60)
SURFACE: Colour = (206, 214, 224)


def loft(sections: Array, closed: bool = True) -> Skin:
    """Skin over sections (n_sections, n_points, 3), each a ring if `closed`, else an open line."""
    n, m = sections.shape[:2]
    columns = m if closed else m - 1
    row, column = np.divmod(np.arange((n - 1) * columns), columns)
    a, b = row * m + column, row * m + (column + 1) % m
    c, d = a + m, b + m
    faces = np.stack((np.stack((a, b, c), 1), np.stack((b, d, c), 1)), 1).reshape(-1, 3)
    return sections.reshape(-1, 3), faces


def cap(ring: Array, flip: bool = False) -> Skin:
    """Close a convex ring (n, 3) with a fan about its middle."""
    n = len(ring)
    following = (np.arange(n) + 1) % n
    faces = np.stack((np.full(n, n), np.arange(n), following), 1)
    return np.vstack((ring, ring.mean(0))), faces[:, ::-1] if flip else faces


def join(*skins: Skin) -> Skin:
    """Several skins as one; vertices are not shared, so the edges between them stay sharp."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in skins[:-1]])
    return (
        np.vstack([vertices for vertices, _ in skins]),
        np.vstack([faces + k for (_, faces), k in zip(skins, offsets, strict=True)]),
    )


def mirror(skin: Skin) -> Skin:
    vertices, faces = skin
    return vertices * (1.0, -1.0, 1.0), faces[:, ::-1]


def body(stations: list[tuple[float, float, float, float, float]], n: int = 36) -> Skin:
    """Fuselage through stations (x, half width, half height, z of the middle, exponent).

    Sections are superellipses: exponent 2 is an ellipse, more is boxier. Both ends are closed.
    """
    table = np.array(stations)
    x = np.linspace(table[0, 0], table[-1, 0], 4 * len(stations))
    columns = [np.interp(-x, -table[:, 0], table[:, k]) for k in range(1, 5)]
    width, height, middle, power = (_smooth(column)[:, None] for column in columns)
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)[None]
    cosine, sine = np.cos(angle), np.sin(angle)
    y = width * np.sign(cosine) * np.abs(cosine) ** (2.0 / power)
    z = middle + height * np.sign(sine) * np.abs(sine) ** (2.0 / power)
    rings = np.stack((np.broadcast_to(x[:, None], y.shape), y, z), -1)
    vertices, faces = join(loft(rings), cap(rings[0], flip=True), cap(rings[-1]))
    return vertices, faces[:, ::-1]


def _smooth(column: Array) -> Array:
    """Round the corners between stations; the ends stay."""
    inner = (column[:-2] + 2.0 * column[1:-1] + column[2:]) / 4.0
    return np.concatenate((column[:1], inner, column[-1:]))


@dataclass(frozen=True)
class Blade:
    """A tapered lifting surface: leading edges and chords at root and tip, sections in x.

    root, tip: leading edge points.   root_chord, tip_chord, thickness: of chord.
    up: the direction in which it is thick.
    """

    root: Point
    tip: Point
    root_chord: float
    tip_chord: float
    thickness: float
    up: Point = (0.0, 0.0, -1.0)

    def at(self, span: float, chord: float) -> Array:
        """Point of the middle plane at fractions of span and chord (0: leading edge)."""
        edge = np.array(self.root) + span * (np.array(self.tip) - self.root)
        edge[0] -= chord * (self.root_chord + span * (self.tip_chord - self.root_chord))
        return edge

    def panel(self, span: tuple[float, float], chord: tuple[float, float], n: int = 12) -> Skin:
        """The closed piece between two spanwise and two chordwise fractions."""
        fraction = chord[0] + (chord[1] - chord[0]) * (1 - np.cos(np.linspace(0, np.pi, n))) / 2
        sides = []
        for sign in (1.0, -1.0):
            lines = []
            for eta in span:
                local = self.root_chord + eta * (self.tip_chord - self.root_chord)
                half = sign * self.thickness * local * _profile(fraction)
                middle = np.array([self.at(eta, c) for c in fraction])
                lines.append(middle + half[:, None] * np.array(self.up))
            sides.append(np.array(lines))
        upper, lower = sides
        skins = [_facing(loft(upper, closed=False), self.up)]
        skins.append(_facing(loft(lower, closed=False), tuple(-u for u in self.up)))
        outward = np.array(self.tip) - self.root
        for k, sign in ((0, -1.0), (-1, 1.0)):
            ring = np.vstack((upper[k], lower[k][::-1]))
            skins.append(_facing(cap(ring), sign * outward))
        for k, sign in ((0, 1.0), (-1, -1.0)):  # blunt edges where the piece was cut
            strip = np.stack((upper[:, k], lower[:, k]))
            skins.append(_facing(loft(strip, closed=False), (sign, 0.0, 0.0)))
        return join(*skins)


def _profile(fraction: Array) -> Array:
    """Half thickness of a NACA four-digit section, as a fraction of its full thickness."""
    x = np.clip(fraction, 0.0, 1.0)
    return 5.0 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)


def _facing(skin: Skin, direction: npt.ArrayLike) -> Skin:
    """The skin with its faces turned so that they look in a direction on the whole."""
    vertices, faces = skin
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return (
        skin
        if np.cross(b - a, c - a).sum(0) @ np.asarray(direction) >= 0
        else (vertices, faces[:, ::-1])
    )


def part(name: str, skin: Skin, colour: Colour) -> Part:
    """A part that does not move."""
    vertices, faces = skin
    return Part(name, vertices.astype(np.float32), faces.astype(np.uint32), colour)


def _point(vector: Array) -> Point:
    x, y, z = vector.tolist()
    return x, y, z


def hinged(name: str, skin: Skin, inner: Array, outer: Array) -> Part:
    """A surface that turns about the line from inner to outer."""
    vertices, faces = skin
    line = (outer - inner) / np.linalg.norm(outer - inner)
    return Part(
        name,
        (vertices - inner).astype(np.float32),
        faces.astype(np.uint32),
        SURFACE,
        _point(inner),
        _point(line),
    )
