"""Aircraft of the users' own: binary glTF as triangles, and what is refused."""

import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from app.scene.airframes import SPAN, airframe
from app.scene.own_airframe import LARGEST, AirframeError, check_airframe, own_airframe
from app.scene.scene import Scene
from core.simulation.attitude import SurfaceSigns
from tests.support.glb_file import glb, plain_of, with_plain

RED = (1.0, 0.0, 0.0, 1.0)


def corners(parts) -> np.ndarray:
    return np.concatenate([part.vertices[part.faces] for part in parts])


def test_an_aircraft_has_the_span_of_the_others_and_looks_ahead():
    """A wing of 10 across x, a fuselage of 14 along +z with its nose there, a fin above."""
    nose = ((1, 1, 4), (0, 0, 5))
    parts = own_airframe(glb(((10, 0.4, 2), (0, 0, 0)), ((1, 1, 9), (0, 0, 0)), nose))
    found = corners(parts)
    low, high = found.reshape(-1, 3).min(0), found.reshape(-1, 3).max(0)
    assert high[1] - low[1] == pytest.approx(SPAN)
    fin = own_airframe(glb(((10, 1, 10), (0, 0, 0)), ((1, 3, 1), (0, 2, 0))))
    heights = corners(fin)[..., 2]
    assert -heights.min() == pytest.approx(heights.max())
    across = np.ptp(corners(fin)[heights < 0.0][:, 1])
    assert across < SPAN / 5  # the fin is above: z is down


def test_the_triangles_are_those_of_trimesh_and_turn_outward():
    content = glb(((10, 0.4, 2), (0, 0, 1)), ((1, 1, 9), (0, 0.5, 0)), mirrored=True)
    whole: Any = trimesh.load(trimesh.util.wrap_as_stream(content), file_type="glb")
    twin = whole.to_geometry()
    ours = np.concatenate([part.vertices[part.faces] for part in own_airframe(content)])
    scale = SPAN / twin.extents[0]
    body = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    theirs = ((twin.triangles - twin.bounds.mean(0)) @ body.T) * scale
    middle, area = ours.mean(1), np.cross(ours[:, 1] - ours[:, 0], ours[:, 2] - ours[:, 0])
    order, their_order = np.lexsort(middle.round(3).T), np.lexsort(theirs.mean(1).round(3).T)
    assert middle[order] == pytest.approx(theirs.mean(1)[their_order], abs=2e-3)
    volume = (ours[:, 0] * np.cross(ours[:, 1], ours[:, 2])).sum() / 6
    assert volume > 0.0
    assert len(area) == len(theirs)


def test_each_colour_is_a_part_of_its_own():
    parts = own_airframe(glb(((10, 1, 8), (0, 0, 0)), ((1, 3, 1), (0, 2, 0)), colours=(RED, None)))
    assert {part.colour for part in parts} == {(255, 0, 0), (230, 230, 230)}


def test_a_scene_draws_it_in_place_of_the_usual_one(clock):
    parts = own_airframe(glb(((10, 1, 8), (0, 0, 0))))
    scene = Scene(clock, SurfaceSigns(1, -1), 0.0, 2.0, parts)
    try:
        drawn = scene._picture._parts
        assert list(drawn) == ["own_0"]
        assert "rudder" not in drawn
        scene.draw()
    finally:
        scene.close()
    assert "rudder" in {part.name for part in airframe("fighter")}


BOX = glb(((10, 1, 8), (0, 0, 0)))


def changed(**plain: Any) -> bytes:
    return with_plain(BOX, plain_of(BOX) | plain)


def cyclic() -> bytes:
    plain = plain_of(BOX)
    plain["nodes"][0]["children"] = [0]
    return with_plain(BOX, plain)


def vast() -> bytes:
    plain = plain_of(BOX)
    plain["bufferViews"][0]["byteStride"] = 0
    plain["accessors"][0]["count"] = 10**9
    return with_plain(BOX, plain)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no binary glTF"),
        (b"solid cube", "no binary glTF"),
        (BOX[:-8], "bytes"),
        (b"glTF" + struct.pack("<II", 1, len(BOX)) + BOX[12:], "glTF 1"),
        (bytes(LARGEST + 1), "8 MiB"),
        (changed(buffers=[{"uri": "https://example.org/wing.bin", "byteLength": 8}]), "uri"),
        (changed(images=[{"uri": "data:image/png;base64,AAAA"}]), "uri"),
        (changed(extensions={"X": {"deep": [{"uri": "wing.bin"}]}}), "uri"),
        (changed(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco"),
        (changed(nodes=[]), "damaged"),
        (changed(meshes=[{"primitives": []}]), "no triangles"),
        (changed(accessors=[]), "damaged"),
        (changed(nodes=[{"mesh": 0, "scale": [1e308, 1e308, 1e308]}]), "no numbers"),
        (changed(nodes=[{"mesh": 0, "scale": [0, 1, 1]}]), "flat"),
        (glb(((10, 1, 8), (0, 0, 0)), ((1, 1, 1), (0, 0, 1e30))), r"1e\+30 m long"),
        (glb(((10, 1, 8), (0, 0, 0)), ((1, 1, 1), (0, 2000, 0))), "metres"),
        (changed(nodes=[{"mesh": 0, "scale": [0.001, 0.001, 0.001]}]), "0.008 m long"),
        (cyclic(), "nodes"),
        (vast(), "triangles"),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_its_reason(content: bytes, words: str):
    with pytest.raises(AirframeError, match=words):
        check_airframe(content)


@given(st.integers(12, len(BOX) - 1), st.integers(0, 255))
def test_a_damaged_file_is_drawn_or_refused_and_nothing_else(place: int, value: int):
    content = bytearray(BOX)
    content[place] = value
    try:
        parts = own_airframe(bytes(content))
    except AirframeError:
        return
    assert all(np.isfinite(part.vertices).all() for part in parts)


def test_a_file_of_deep_nesting_is_refused():
    head = json.dumps(plain_of(BOX))[:-1] + ', "extras": ' + "[" * 9_000 + "]" * 9_000 + "}"
    with pytest.raises(AirframeError, match="damaged"):
        own_airframe(with_plain(BOX, head))
