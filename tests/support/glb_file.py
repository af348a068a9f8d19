"""Binary glTF files of boxes."""

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""size and middle, glTF's axes"""


def glb(
    *boxes: Box, colours: Sequence[Sequence[float] | None] = (), mirrored: bool = False
) -> bytes:
    """mirrored: by the transforms of the nodes."""
    scene = trimesh.Scene()
    for k, (size, middle) in enumerate(boxes):
        box = trimesh.creation.box(size)
        colour = colours[k] if k < len(colours) else None
        if colour is not None:
            material = PBRMaterial(baseColorFactor=np.array(colour))
            box.visual = TextureVisuals(material=material)
        place = trimesh.transformations.translation_matrix(middle)
        if mirrored:
            place = place @ np.diag((-1.0, 1.0, 1.0, 1.0))
        scene.add_geometry(box, transform=place)
    exported: Any = scene.export(file_type="glb")
    return bytes(exported)


def plain_of(content: bytes) -> dict[str, Any]:
    (size,) = struct.unpack_from("<I", content, 12)
    return json.loads(content[20 : 20 + size])


def with_plain(content: bytes, plain: dict[str, Any] | str) -> bytes:
    """The file with another description."""
    (size,) = struct.unpack_from("<I", content, 12)
    head = (plain if isinstance(plain, str) else json.dumps(plain)).encode()
    head += b" " * (-len(head) % 4)
    body = struct.pack("<I", len(head)) + content[16:20] + head + content[20 + size :]
    return content[:8] + struct.pack("<I", 12 + len(body)) + body
