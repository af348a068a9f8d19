"""The scene's instruments as lines and meshes: level ring, compass, sideslip scale, risk column.

Lines are (n, 2, 3); meshes are vertices (n, 3) and faces (m, 3); metres.
"""

from itertools import pairwise
from math import cos, pi, sin

import numpy as np
import numpy.typing as npt

from app.scene.airframes import Faces, Vertices
from core.types import Array, Indices

Lines = npt.NDArray[np.float32]
Mesh = tuple[Vertices, Faces]
Skin = tuple[Array, Indices]

LETTERS = {
    "N": ((-1, -1, 1, -1), (1, -1, -1, 1), (-1, 1, 1, 1)),
    "E": ((-1, -1, 1, -1), (1, -1, 1, 1), (0, -1, 0, 0.6), (-1, -1, -1, 1)),
    "S": ((1, 1, 1, -1), (1, -1, 0, -1), (0, -1, 0, 1), (0, 1, -1, 1), (-1, 1, -1, -1)),
    "W": ((1, -1, -1, -0.5), (-1, -0.5, 0.4, 0), (0.4, 0, -1, 0.5), (-1, 0.5, 1, 1)),
}
"""Strokes from (outward, clockwise) to (outward, clockwise), in half letter sizes."""


def loft(sections: Array, closed: bool = True) -> Skin:
    """Skin over sections (n_sections, n_points, 3), each a ring if `closed`, else an open line."""
    n, m = sections.shape[:2]
    columns = m if closed else m - 1
    row, column = np.divmod(np.arange((n - 1) * columns), columns)
    a, b = row * m + column, row * m + (column + 1) % m
    c, d = a + m, b + m
    faces = np.stack((np.stack((a, b, c), 1), np.stack((b, d, c), 1)), 1).reshape(-1, 3)
    return sections.reshape(-1, 3), faces


def circle(radius: float, n: int = 96) -> Lines:
    """A level circle."""
    angle = np.linspace(0.0, 2 * pi, n + 1)
    ring = np.stack((radius * np.cos(angle), radius * np.sin(angle), 0 * angle), 1)
    return np.stack((ring[:-1], ring[1:]), 1).astype(np.float32)


def compass(radius: float) -> Lines:
    """Marks outside a circle each 10 and 30 degrees, and the letters of the quarters."""
    lines: list[tuple[Array, Array]] = []
    for k in range(36):
        out = np.array((cos(k * pi / 18), sin(k * pi / 18), 0.0))
        lines.append((radius * out, (radius + (0.45 if k % 3 else 0.9)) * out))
    for quarter, strokes in enumerate(LETTERS.values()):
        out = np.array((cos(quarter * pi / 2), sin(quarter * pi / 2), 0.0))
        up, right = 0.65 * out, 0.45 * np.array((-out[1], out[0], 0.0))
        middle = (radius + 2.0) * out
        for u0, v0, u1, v1 in strokes:
            lines.append((middle + u0 * up + v0 * right, middle + u1 * up + v1 * right))
    return np.array(lines, np.float32)


def slip_scale(alpha0: float, exaggeration: float, radius: float = 15.0) -> Lines:
    """An arc ahead of the nose with marks at 0, 5 and 10 degrees of sideslip to both sides."""

    def at(distance: float, beta_deg: float) -> tuple[float, float, float]:
        angle = np.deg2rad(exaggeration * beta_deg)
        ahead = distance * cos(angle)
        return ahead * cos(alpha0), distance * sin(angle), ahead * sin(alpha0)

    degrees = np.linspace(-10.0, 10.0, 25)
    lines = [(at(radius, a), at(radius, b)) for a, b in pairwise(degrees.tolist())]
    for beta_deg in (-10.0, -5.0, 0.0, 5.0, 10.0):
        inner = radius - (0.5 if beta_deg else 1.0)
        lines.append((at(inner, beta_deg), at(radius + 0.5, beta_deg)))
    return np.array(lines, np.float32)


def arrow() -> Mesh:
    """The velocity vector: along x, from just ahead of the nose."""
    return _turned((14.6, 13.0, 13.0, 8.2, 8.2), (0.0, 0.34, 0.11, 0.11, 0.0), 20)


def tube(radius: float) -> Mesh:
    """A closed upright cylinder of height 1, upwards (-z) from its foot."""
    vertices, faces = _turned((1.0, 1.0, 0.0, 0.0), (0.0, radius, radius, 0.0), 32)
    return np.stack((vertices[:, 2], vertices[:, 1], -vertices[:, 0]), 1), faces


def torus(radius: float, thickness: float) -> Mesh:
    """A level ring of round section."""
    around = np.linspace(0.0, 2 * pi, 49)[:, None]
    section = np.linspace(0.0, 2 * pi, 12, endpoint=False)[None]
    r, z = radius + thickness * np.cos(section), thickness * np.sin(section)
    rings = np.stack((r * np.cos(around), r * np.sin(around), z + 0 * around), -1)
    vertices, faces = loft(rings)
    return vertices.astype(np.float32), faces[:, ::-1].astype(np.uint32)


def _turned(x: tuple[float, ...], radius: tuple[float, ...], n: int) -> Mesh:
    """Surface of revolution about x, through a profile from front to back."""
    angle = np.linspace(0.0, 2 * pi, n, endpoint=False)[None]
    ahead, r = np.array(x)[:, None], np.array(radius)[:, None]
    rings = np.stack((ahead + 0 * angle, r * np.cos(angle), r * np.sin(angle)), -1)
    vertices, faces = loft(rings)
    return vertices.astype(np.float32), faces[:, ::-1].astype(np.uint32)
