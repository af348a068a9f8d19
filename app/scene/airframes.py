"""Aircraft by class as meshes: fighter, transport, jet trainer ("light"); no particular type.

Body axes, metres: x forward, y right, z down, origin at the centre of gravity; one size whatever
the aircraft's own, since the scene shows attitude. `tests/support/airframe_shapes.py` makes the
file.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.scene.shown import Colour
from core.simulation.aircraft import AircraftClass

Vertices = npt.NDArray[np.float32]
Faces = npt.NDArray[np.uint32]
Point = tuple[float, float, float]
FILE = Path(__file__).with_name("airframes.npz")
SPAN = 10.4
"""[m]"""


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh of one colour; a moving one turns about its hinge.

    vertices: (n, 3) relative to `hinge`.   faces: (m, 3), outward normals.
    hinge: a point of the hinge line [m].   axis: unit vector; right-handed turns are positive.
    """

    name: str
    vertices: Vertices
    faces: Faces
    colour: Colour
    hinge: Point = (0.0, 0.0, 0.0)
    axis: Point = (0.0, 1.0, 0.0)


@cache
def airframe(aircraft_class: AircraftClass) -> tuple[Part, ...]:
    """Every part, fixed ones first; read once and shared by all scenes."""
    with np.load(FILE) as arrays:
        descriptions: dict[str, list[dict[str, Any]]] = json.loads(str(arrays["parts"]))
        return tuple(
            Part(
                about["name"],
                arrays[f"{aircraft_class}/{about['name']}/vertices"],
                arrays[f"{aircraft_class}/{about['name']}/faces"],
                *(tuple(about[key]) for key in ("colour", "hinge", "axis")),
            )
            for about in descriptions[aircraft_class]
        )


def outline(parts: tuple[Part, ...]) -> tuple[Vertices, Faces]:
    """All parts as one mesh, the surfaces neutral."""
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices + part.hinge for part in parts])
    faces = np.concatenate([part.faces + k for part, k in zip(parts, firsts, strict=False)])
    return vertices.astype(np.float32), faces.astype(np.uint32)
