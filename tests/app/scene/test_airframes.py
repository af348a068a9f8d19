import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.catalog import catalog
from app.scene.airframes import SPAN, Part, airframe, outline
from core.simulation.aircraft import AIRCRAFT
from tests.support.airframe_shapes import AIRFRAMES

PARTS = airframe("fighter")
BY_NAME = {part.name: part for part in PARTS}
EVERY = [(kind, part) for kind in AIRFRAMES for part in airframe(kind)]
PAIRED = ("right_aileron", "left_aileron", "right_elevator", "left_elevator")
TWINS = dict(zip(PAIRED, (PAIRED[1], PAIRED[0], PAIRED[3], PAIRED[2]), strict=True))
MOVING = ("right_aileron", "left_aileron", "rudder")


def corners(part: Part) -> np.ndarray:
    """Triangles (n, 3 corners, 3) relative to the hinge, double precision."""
    return part.vertices.astype(float)[part.faces]


def turned(part: Part, angle: float) -> np.ndarray:
    """Vertices in body axes after a turn about the hinge."""
    return Rotation.from_rotvec(np.multiply(angle, part.axis)).apply(part.vertices) + part.hinge


def mean_move(part: Part, angle: float) -> np.ndarray:
    return (turned(part, angle) - turned(part, 0.0)).mean(0)


@pytest.mark.parametrize(
    ("kind", "part"), EVERY, ids=[f"{kind}-{part.name}" for kind, part in EVERY]
)
class TestEveryPart:
    def test_it_is_a_clean_mesh(self, kind, part):
        assert np.isfinite(part.vertices).all()
        assert part.vertices.dtype == np.float32
        assert part.faces.dtype == np.uint32
        assert part.faces.max() < len(part.vertices)
        assert np.linalg.norm(part.axis) == pytest.approx(1.0)

    def test_it_is_closed(self, kind, part):
        a, b, c = corners(part).transpose(1, 0, 2)
        areas = np.cross(b - a, c - a) / 2
        assert np.abs(areas.sum(0)).max() < 1e-4 * np.linalg.norm(areas, axis=1).sum()

    def test_it_faces_outwards(self, kind, part):
        a, b, c = (corners(part) - part.vertices.mean(0)).transpose(1, 0, 2)
        assert (a * np.cross(b, c)).sum() / 6 > 0

    def test_its_left_mirrors_its_right(self, kind, part):
        twin = {p.name: p for p in airframe(kind)}[TWINS.get(part.name) or part.name]
        right = part.vertices.astype(float) + part.hinge
        left = (twin.vertices.astype(float) + twin.hinge) * (1.0, -1.0, 1.0)
        for a, b in ((right, left), (left, right)):
            distance = np.linalg.norm(a[:, None] - b[None], axis=2).min(1)
            assert distance.max() < 1e-4

    def test_its_colour_leaves_red_to_the_alert(self, kind, part):
        red, green, blue = part.colour
        assert red <= green <= blue


def test_the_aircraft_is_of_a_fighters_size_and_few_triangles():
    points = np.vstack([part.vertices + part.hinge for part in PARTS])
    length, span, height = np.ptp(points, axis=0)
    assert 14 < length < 16
    assert SPAN <= span < SPAN + 0.3
    assert 3 < height < 6
    assert sum(len(part.faces) for part in PARTS) < 10_000


def test_it_is_built_once():
    assert airframe("fighter") is PARTS


@pytest.mark.parametrize("name", ["right_aileron", "left_aileron"])
def test_a_positive_turn_of_an_aileron_is_trailing_edge_down(name):
    assert mean_move(BY_NAME[name], 0.3)[2] > 0.05


def test_a_positive_turn_of_the_rudder_is_trailing_edge_right():
    assert mean_move(BY_NAME["rudder"], 0.3)[1] > 0.05


@pytest.mark.parametrize("name", MOVING)
def test_a_turn_leaves_the_hinge_line_in_place(name):
    part = BY_NAME[name]
    ahead = part.vertices @ np.cross(part.axis, np.cross((1.0, 0.0, 0.0), part.axis))
    edge = ahead > ahead.max() - 0.02
    moved = np.linalg.norm(turned(part, 0.5) - turned(part, 0.0), axis=1)
    assert edge.sum() >= 4
    assert moved[edge].max() < 0.1
    assert moved.max() > 0.25


def test_surfaces_sit_in_their_cut_outs():
    for name, body in (("right_aileron", "wings"), ("rudder", "fin")):
        surface, around = turned(BY_NAME[name], 0.0), BY_NAME[body].vertices
        low, high = surface.min(0), surface.max(0)
        assert (around.min(0) <= low + 1e-3).all()
        assert (around.max(0) >= high - 1e-3).all()


@pytest.mark.parametrize("kind", AIRFRAMES)
def test_surfaces_of_every_class_turn_as_those_of_the_fighter(kind):
    parts = {part.name: part for part in airframe(kind)}
    assert {*MOVING, *PAIRED, "fuselage", "canopy", "wings", "fin"} <= parts.keys()
    assert mean_move(parts["rudder"], 0.3)[1] > 0.03
    for name in PAIRED:
        assert mean_move(parts[name], 0.3)[2] > 0.03


@pytest.mark.parametrize(
    ("kind", "features"),
    [
        ("fighter", {"intake", "nozzle", "missiles"}),
        ("transport", {"engines", "pylons", "tailplanes"}),
        ("light", {"intakes", "tanks", "tailplanes"}),
    ],
)
def test_a_class_has_what_it_is_recognised_by(kind, features):
    parts = {part.name: part for part in airframe(kind)}
    assert features <= parts.keys()
    if kind == "transport":
        wings, engines = parts["wings"].vertices, parts["engines"].vertices
        assert engines[:, 2].mean() > wings[:, 2].mean() + 0.5


@pytest.mark.parametrize("kind", AIRFRAMES)
def test_the_outline_is_all_parts_with_neutral_surfaces(kind):
    vertices, faces = outline(airframe(kind))
    corners_of_parts = [turned(part, 0.0)[part.faces] for part in airframe(kind)]
    np.testing.assert_allclose(vertices[faces], np.concatenate(corners_of_parts), atol=1e-4)


def test_the_classes_of_the_published_aircraft_are_theirs():
    looks = {key: aircraft.condition.aircraft_class for key, aircraft in AIRCRAFT.items()}
    assert looks["attas_id_16kft"] == looks["b747_40k_m0p8"] == "transport"
    assert looks["f16_sl_h0_v502"] == "fighter"
    assert set(looks.values()) <= AIRFRAMES.keys()
    entries = catalog()["families"]["aircraft"]["entries"]
    assert {key: entry["aircraft_class"] for key, entry in entries.items()} == looks


def test_the_file_holds_what_its_script_makes():
    for kind, make in AIRFRAMES.items():
        for stored, made in zip(airframe(kind), make(), strict=True):
            np.testing.assert_allclose(stored.vertices, made.vertices, atol=1e-5)
            np.testing.assert_array_equal(stored.faces, made.faces)
            assert (stored.name, stored.colour) == (made.name, made.colour)
            assert (*stored.hinge, *stored.axis) == pytest.approx((*made.hinge, *made.axis))
