"""An aircraft of the user's own, from a binary glTF 2.0 file (.glb): its triangles, in colours.

Nothing outside the file is read: a uri is refused, and so is an extension that needs a decoder. The
page gets triangles, never the file. Textures are left out. glTF looks along +z with +y up; the
scene's axes are those of `airframes`.
"""

import json
import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from app.scene.airframes import SPAN, Part
from app.scene.shown import Colour

LARGEST = 8 * 2**20
"""[bytes]"""
MOST_TRIANGLES, MOST_NODES, MOST_COLOURS = 300_000, 2_000, 60
LONGEST = 16.0
"""Drawn length of an aircraft that is long for its span [m]."""
SIZES = 0.1, 1_000.0
"""Least and greatest length and span of a file: models up to airships [m]."""
MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
TRIANGLES = 4
FLOAT = 5126
INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
"""Types of indices by component type."""
AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""From glTF's axes to body axes."""
PLAIN = (0.8, 0.8, 0.8)

DAMAGE = (
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
    RecursionError,
    struct.error,
)

Mesh = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]
"""vertices (n, 3), faces (m, 3)"""


class AirframeError(ValueError):
    """A file that is no aircraft to draw: what it is, and what is needed."""


def check_airframe(content: bytes) -> None:
    """AirframeError for a file that cannot be drawn, or whose aircraft has no plausible size."""
    own_airframe(content)
    length, span, height = np.ptp(_corners(_meshes(content)), axis=0)
    least, most = SIZES
    if not (least <= min(length, span) and max(length, span, height) <= most):
        raise AirframeError(
            f"the aircraft is {length:.3g} m long, {span:.3g} m wide and {height:.3g} m high; from "
            f"{least:g} to {most:,.0f} m are drawn: scale it to metres, or remove what lies far out"
        )


@lru_cache(maxsize=4)
def own_airframe(content: bytes) -> tuple[Part, ...]:
    """A part a colour, its span that of the other aircraft. AirframeError if it cannot be drawn."""
    meshes = _meshes(content)
    everything = _corners(meshes)
    low, high = everything.min(0), everything.max(0)
    length, span, _ = high - low
    if not min(length, span) > 0.0:
        raise AirframeError("the aircraft is flat: it needs a length along z and a span along x")
    scale = min(SPAN / span, LONGEST / length)
    return tuple(
        Part(
            f"own_{k}",
            ((vertices - (low + high) / 2) * scale).astype(np.float32),
            faces.astype(np.uint32),
            colour,
        )
        for k, (colour, (vertices, faces)) in enumerate(meshes.items())
    )


def _meshes(content: bytes) -> dict[Colour, Mesh]:
    try:
        with np.errstate(all="ignore"):
            meshes = _Document(*_chunks(content)).meshes()
    except AirframeError:
        raise
    except DAMAGE as error:
        raise AirframeError(f"the file is damaged ({error}): export it again as .glb") from None
    if not meshes:
        raise AirframeError("the file has no triangles: export the aircraft's surface as .glb")
    return meshes


def _corners(meshes: dict[Colour, Mesh]) -> npt.NDArray[np.float64]:
    corners = np.concatenate([vertices for vertices, _ in meshes.values()])
    if not np.isfinite(corners).all():
        raise AirframeError("the file has vertices that are no numbers: export it again as .glb")
    return corners


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The description and the data of a file."""
    if len(content) > LARGEST:
        most = f"{LARGEST / 2**20:g} MiB, the most that is read"
        raise AirframeError(f"the file has over {most}: leave out textures, or simplify it")
    if content[:4] != MAGIC:
        raise AirframeError("the file is no binary glTF: export the aircraft as .glb")
    version, length = struct.unpack_from("<II", content, 4)
    if version != VERSION or length != len(content):
        raise AirframeError(
            f"the file is glTF {version} of {length} bytes, and has {len(content)}: "
            "export it again as .glb, glTF 2.0"
        )
    chunks: dict[int, bytes] = {}
    at = 12
    while at < length:
        size, kind = struct.unpack_from("<II", content, at)
        chunks.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(chunks[JSON_CHUNK]), chunks.get(BINARY_CHUNK, b"")


@dataclass(frozen=True)
class _Document:
    plain: dict[str, Any]
    data: bytes

    def __post_init__(self) -> None:
        if _names(self.plain, "uri"):
            raise AirframeError(
                "the file refers to another file or address (uri): export it with everything inside"
            )
        if needed := self.plain.get("extensionsRequired"):
            raise AirframeError(
                f"the file needs {', '.join(map(str, needed))}: export it without compression"
            )
        if len(self.plain.get("nodes", ())) > MOST_NODES:
            raise AirframeError(f"the file has over {MOST_NODES} nodes: join its parts")

    def meshes(self) -> dict[Colour, Mesh]:
        """All triangles by colour, in body axes."""
        found: dict[Colour, list[Mesh]] = {}
        n_triangles = n_nodes = 0
        nodes, scenes = self.plain["nodes"], self.plain.get("scenes")
        roots = scenes[self.plain.get("scene", 0)]["nodes"] if scenes else range(len(nodes))
        waiting = [(nodes[k], np.eye(4)) for k in roots]
        while waiting:
            node, parent = waiting.pop()
            n_nodes += 1
            if n_nodes > MOST_NODES:
                raise AirframeError(f"the file shows over {MOST_NODES} nodes: join its parts")
            place = parent @ _transform(node)
            waiting.extend((nodes[k], place) for k in node.get("children", ()))
            for primitive in self._primitives(node):
                vertices, faces = self._triangles(primitive)
                n_triangles += max(1, len(faces), len(vertices) // 3)
                if n_triangles > MOST_TRIANGLES:
                    raise AirframeError(
                        f"the file has over {MOST_TRIANGLES:,} triangles: simplify the aircraft"
                    )
                moved = vertices @ place[:3, :3].T + place[:3, 3]
                outward = faces if np.linalg.det(place[:3, :3]) >= 0.0 else faces[:, ::-1]
                mesh = moved @ AXES.T, outward
                found.setdefault(self._colour(primitive), []).append(mesh)
        if len(found) > MOST_COLOURS:
            raise AirframeError(f"the file has {len(found)} colours; at most {MOST_COLOURS}")
        return {colour: _joined(meshes) for colour, meshes in found.items()}

    def _primitives(self, node: dict[str, Any]) -> list[dict[str, Any]]:
        if "mesh" not in node:
            return []
        primitives = self.plain["meshes"][node["mesh"]]["primitives"]
        return [one for one in primitives if one.get("mode", TRIANGLES) == TRIANGLES]

    def _triangles(self, primitive: dict[str, Any]) -> Mesh:
        vertices = self._numbers(primitive["attributes"]["POSITION"], "<f4", 3, FLOAT)
        if "indices" not in primitive:
            indices = np.arange(len(vertices))
        else:
            accessor = self.plain["accessors"][primitive["indices"]]
            kind = accessor["componentType"]
            indices = self._numbers(primitive["indices"], INDICES[kind], 1, kind)[:, 0]
        faces = indices[: len(indices) // 3 * 3].reshape(-1, 3).astype(np.int64)
        if faces.size and faces.max() >= len(vertices):
            raise ValueError("an index beyond the vertices")
        return vertices.astype(float), faces

    def _numbers(self, number: int, dtype: str, width: int, kind: int) -> npt.NDArray[Any]:
        """An accessor as (n, width), a view of the file's data."""
        accessor = self.plain["accessors"][number]
        if "sparse" in accessor or accessor["componentType"] != kind:
            raise ValueError("an accessor that is sparse, or of another type")
        if accessor["count"] > 3 * MOST_TRIANGLES:
            raise AirframeError(f"the file has over {MOST_TRIANGLES:,} triangles: simplify it")
        view = self.plain["bufferViews"][accessor["bufferView"]]
        size = np.dtype(dtype).itemsize * width
        return np.ndarray(
            (accessor["count"], width),
            dtype,
            self.data,
            view.get("byteOffset", 0) + accessor.get("byteOffset", 0),
            (view.get("byteStride", size), np.dtype(dtype).itemsize),
        )

    def _colour(self, primitive: dict[str, Any]) -> Colour:
        material = self.plain["materials"][primitive["material"]] if "material" in primitive else {}
        linear = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", PLAIN)[:3]
        shades = np.clip(np.array(linear, float), 0.0, 1.0) ** (1 / 2.2)
        red, green, blue = (int(shade) for shade in np.round(255 * shades))
        return red, green, blue


def _names(plain: Any, key: str) -> bool:
    """Whether an object anywhere in the description has a key."""
    waiting = [plain]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            if key in one:
                return True
            waiting.extend(one.values())
        elif isinstance(one, list):
            waiting.extend(one)
    return False


def _transform(node: dict[str, Any]) -> npt.NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    place = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    place[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), float)
    place[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return place


def _joined(meshes: list[Mesh]) -> Mesh:
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + first for (_, faces), first in zip(meshes, firsts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)
