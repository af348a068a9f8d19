"""The contents of a scene as viser nodes: aircraft, ground, trail, velocity and risk column.

The world is north-east-down, in metres. The attitude is drawn true, surfaces and sideslip
exaggerated. The aircraft stays in place and the ground moves; a translucent aircraft has the
planned attitude. What is not known is left out and named: without the bank a line along the body
shows the pitch, without the pitch a line between the wing tips shows the bank. An elevator that is
not known is drawn as a fixed part.

Positive surfaces: elevator trailing edge down; aileron and rudder as the model's signs say.
"""

from itertools import pairwise
from math import cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import viser
from scipy.spatial.transform import Rotation

from app.scene.airframes import Faces, Part, Point, Vertices, outline
from app.scene.ground_track import TRAIL_POINTS, GroundTrack, body_to_earth
from app.scene.shown import (
    ALERT,
    CALM,
    CAUTION,
    COLOURS,
    EARTH,
    EXAGGERATION,
    FAINT,
    GHOST,
    GREY,
    GRID,
    INK,
    LIMIT,
    PLANNED,
    VELOCITY,
    Colour,
    KnownAngles,
    Shown,
    label,
    tone,
    unknown,
)
from core.monitor.assessment import State
from core.simulation.attitude import Attitude, SurfaceSigns
from core.types import Array

Lines = npt.NDArray[np.float32]
"""(n, 2, 3) [m]."""
WIDEST = pi / 4
"""Largest drawn surface angle [rad]."""
DOWN = (0.0, 0.0, 1.0)
GROUND_BELOW, CELL, SECTION = 11.0, 10.0, 50.0
HORIZON, NEAREST = 4000.0, 0.5
"""Radius of the ground, its edge less than half a degree below the true horizon; and the nearest
thing that is drawn [m]."""
RING_RADIUS = 8.8
WORD_HEIGHT = 0.9
"""[m]"""
COLUMN_AT, COLUMN_HEIGHT, COLUMN_RADIUS = (-8.5, -8.5, 0.5), 6.6, 0.5
"""Beside the aircraft, and over a third of the picture's height, from each of the CAMERAS."""
INWARD = 1.3
"""Shift of the column's numbers [m], forward and right: from each camera towards the aircraft."""


class Camera(NamedTuple):
    """position, look_at: [m]."""

    position: Point
    look_at: Point


CAMERAS = {
    "chase": Camera((-28.0, -6.6, -8.6), (0.0, -1.6, -2.2)),
    "tail": Camera((-29.5, -1.0, -4.4), (0.0, -2.6, -2.0)),
    "side": Camera((-1.0, -29.5, -4.8), (-1.6, 0.0, -2.0)),
}
"""Aircraft and column fill a picture that is as wide as high; the horizon is in it."""
FIELD_OF_VIEW = 0.75
"""Vertical [rad]."""

BODY, WINGS = ((-7.0, 0.0, 0.0), (8.0, 0.0, 0.0)), ((0.0, -5.2, 0.0), (0.0, 5.2, 0.0))
"""Lines from tail to nose and from tip to tip, body axes [m]."""

ELEVATORS = ("right_elevator", "left_elevator")
TICKS = {"none": 0.0, "quarter": 0.25, "half": 0.5, "whole": 1.0}
NUMBERED = ("none", "quarter", "whole")
"""Ticks with a number, far enough apart for the smallest scene."""
LETTERS = {
    "N": ((-1, -1, 1, -1), (1, -1, -1, 1), (-1, 1, 1, 1)),
    "E": ((-1, -1, 1, -1), (1, -1, 1, 1), (0, -1, 0, 0.6), (-1, -1, -1, 1)),
    "S": ((1, 1, 1, -1), (1, -1, 0, -1), (0, -1, 0, 1), (0, 1, -1, 1), (-1, 1, -1, -1)),
    "W": ((1, -1, -1, -0.5), (-1, -0.5, 0.4, 0), (0.4, 0, -1, 0.5), (-1, 0.5, 1, 1)),
}
"""Strokes from (outward, clockwise) to (outward, clockwise), in half letter sizes."""
HEADLINE_AT, UNKNOWN_AT, FIXED_AT = (3.5, 2.3, 4.4), (3.5, 2.3, 5.4), (3.5, 2.3, 6.4)
"""Beside the column from each camera."""
WORDS = "/words"
"""Node of all texts: a page for a large screen hides them, being too small there."""
STATE = f"{WORDS}/state"
"""Node of the words: the Fly page hides them, since they cover the aircraft of a small scene and
stand beside it."""
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


def height(p_value: float) -> float:
    """Height of a p-value on the column [m]: its square root, to resolve small ones."""
    return COLUMN_HEIGHT * sqrt(min(max(p_value, 0.0), 1.0))


class Picture:
    """The nodes of one scene; `draw` sends the changes as one atomic update.

    signs: directions in which the surfaces act.   alpha0: angle of attack at trim [rad].
    airframe: parts of the aircraft; one without surfaces that move is named as such.
    Not thread-safe, and not usable after the server stopped: Scene takes care of both.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        signs: SurfaceSigns,
        alpha0: float,
        airframe: tuple[Part, ...],
    ) -> None:
        self._server, self._signs, self._alpha0 = server, signs, alpha0
        self._airframe = airframe
        self._track = GroundTrack()
        self._sent: dict[tuple[int, str], Any] = {}
        with server.atomic():
            _stage(server)
            self._add_world()
            self._add_aircraft()
            self._add_column()
        server.flush()

    def draw(self, shown: Shown) -> None:
        colour = tone(shown)
        with self._server.atomic():
            self._move(shown, colour)
            self._pose(shown)
            self._risk(shown, colour)
        self._server.flush()

    def _set(self, node: Any, **properties: Any) -> None:
        """Assign only changed properties, since viser sends every assignment."""
        for name, value in properties.items():
            key = id(node), name
            if self._sent.get(key) != value:
                self._sent[key] = value
                setattr(node, name, value)

    # --- building -------------------------------------------------------------------------------

    def _add_lines(
        self, name: str, points: Lines, colour: Colour, thickness: float, **place: Any
    ) -> viser.LineSegmentsHandle:
        """thickness: in pixels."""
        return self._server.scene.add_line_segments(
            name, points, colour, thickness=thickness, thickness_units="screen", **place
        )

    def _add_world(self) -> None:
        scene = self._server.scene
        self._chase = scene.add_frame("/chase", show_axes=False)
        scene.add_mesh_simple(
            "/ground",
            *disc(HORIZON),
            color=EARTH,
            opacity=0.8,
            side="double",
            position=(0.0, 0.0, GROUND_BELOW + 0.4),
            **NO_SHADOW,
        )
        self._ground = scene.add_grid(
            "/chase/ground",
            width=2400.0,
            height=2400.0,
            cell_size=CELL,
            section_size=SECTION,
            cell_color=FAINT,
            section_color=GRID,
            cell_thickness=0.8,
            section_thickness=1.4,
            fade_distance=600.0,
            fade_strength=1.2,
            shadow_opacity=0.0,
            position=(0.0, 0.0, GROUND_BELOW),
        )
        self._ring = self._add_lines("/chase/ring", circle(RING_RADIUS), CALM, 2.0)
        self._compass = self._add_lines("/chase/compass", compass(RING_RADIUS), INK, 1.5)
        trail = np.zeros((2 * TRAIL_POINTS, 2, 3), np.float32)
        self._trail = self._add_lines("/chase/trail", trail, GRID, 4.0)

    def _add_aircraft(self) -> None:
        scene = self._server.scene
        self._aircraft = scene.add_frame("/chase/aircraft", show_axes=False)
        self._parts: dict[str, tuple[Part, Any]] = {}
        for part in self._airframe:
            node = scene.add_mesh_simple(
                f"/chase/aircraft/{part.name}",
                part.vertices,
                part.faces,
                color=part.colour,
                position=part.hinge,
                **NO_SHADOW,
            )
            self._parts[part.name] = part, node
        self._body, self._wings = (
            self._add_lines(f"/chase/aircraft/{name}", np.array([line], np.float32), INK, 5.0)
            for name, line in (("body_line", BODY), ("wing_line", WINGS))
        )
        self._scale = self._add_lines(
            "/chase/aircraft/slip_scale", slip_scale(self._alpha0), INK, 1.5
        )
        self._velocity = scene.add_arrows(
            "/chase/aircraft/velocity",
            np.array([[(8.2, 0.0, 0.0), (14.6, 0.0, 0.0)]]),
            VELOCITY,
            shaft_radius=0.11,
            head_radius=0.34,
            head_length=1.6,
        )
        self._ghost = scene.add_mesh_simple(
            "/chase/planned",
            *outline(self._airframe),
            color=PLANNED,
            opacity=0.3,
            scale=0.97,  # hidden by the aircraft while both agree
            visible=False,
            **NO_SHADOW,
        )

    def _add_column(self) -> None:
        scene = self._server.scene
        scene.add_frame("/column", show_axes=False, position=COLUMN_AT)
        scene.add_cylinder(
            "/column/glass",
            COLUMN_RADIUS * 1.35,
            COLUMN_HEIGHT,
            INK,
            opacity=0.14,
            position=(0.0, 0.0, -COLUMN_HEIGHT / 2),
            side="double",
            **NO_SHADOW,
        )
        self._fill = scene.add_cylinder(
            "/column/fill", COLUMN_RADIUS, 1.0, GREY, visible=False, **NO_SHADOW
        )
        for node in (WORDS, STATE):
            scene.add_frame(node, show_axes=False)
        ring = circle(COLUMN_RADIUS * 1.35)
        for name, p_value in TICKS.items():
            at = (0.0, 0.0, -height(p_value))
            self._add_lines(f"/column/{name}", ring, INK, 1.2, position=at)
            if name in NUMBERED:
                self._add_words(f"{WORDS}/{name}", f"{p_value:g}", 0.75, _beside_column(1.0, at[2]))
        self._threshold = scene.add_line_segments(
            "/column/threshold", circle(COLUMN_RADIUS * 1.75), LIMIT, thickness=0.18
        )
        self._threshold_label = self._add_words(f"{WORDS}/threshold", "", 0.9)
        self._headline, self._unknown = (
            self._add_words(f"{STATE}/{name}", "", size, at)
            for name, at, size in (("headline", HEADLINE_AT, 1.0), ("unknown", UNKNOWN_AT, 0.8))
        )
        if "rudder" not in self._parts:
            self._add_words(f"{WORDS}/fixed", "surfaces do not move", 0.8, FIXED_AT)

    def _add_words(
        self, name: str, text: str, size: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Any:
        """Words that grow with the picture, as everything in it. size: of WORD_HEIGHT."""
        return self._server.scene.add_label(
            name,
            text,
            position=at,
            font_size_mode="scene",
            font_scene_height=size * WORD_HEIGHT,
            anchor="center-center",
        )

    # --- moving ---------------------------------------------------------------------------------

    def _move(self, shown: Shown, colour: Colour) -> None:
        track, (bank, pitch, heading) = self._track, shown.attitude
        track.advance(shown.t, _drawn_attitude(shown.attitude), shown.beta or 0.0, colour)
        north, east = -(track.place % SECTION)
        self._set(self._chase, wxyz=wxyz(turn(DOWN, -track.heading)))
        self._set(self._ground, position=(float(north), float(east), GROUND_BELOW))
        self._set(self._compass, visible=heading is not None)
        self._set(self._trail, visible=bank is not None and pitch is not None)
        self._trail.points, self._trail.colors = track.trail(GRID)

    def _pose(self, shown: Shown) -> None:
        """Attitude, surfaces and velocity; grey if the telemetry is stale or invalid."""
        lost = shown.state in (State.STALE, State.INVALID)
        bank, pitch, _ = shown.attitude
        self._set(self._aircraft, wxyz=wxyz(body_to_earth(*_drawn_attitude(shown.attitude))))
        self._set(self._body, visible=bank is None and pitch is not None)
        self._set(self._wings, visible=pitch is None and bank is not None)
        roll, yaw = (
            None if deflection is None else sign * _drawn(deflection)
            for sign, deflection in zip(self._signs, (shown.delta_a, shown.delta_r), strict=True)
        )
        pitching = None if shown.delta_e is None else _drawn(shown.delta_e)
        turns = {
            "right_aileron": None if roll is None else -roll,  # trailing edge up rolls right
            "left_aileron": roll,
            "rudder": yaw,  # trailing edge right yaws right
        } | dict.fromkeys(ELEVATORS, pitching or 0.0)
        is_seen = bank is not None and pitch is not None
        for name, (part, node) in self._parts.items():
            angle = turns.get(name, 0.0)
            seen = is_seen and angle is not None
            is_fixed = name in ELEVATORS and pitching is None
            colour = self._parts["wings"][0].colour if is_fixed else part.colour
            self._set(node, color=GHOST if lost else colour, visible=seen)
            if name in turns and angle is not None:
                self._set(node, wxyz=wxyz(turn(part.axis, angle)))
        self._slide(shown, lost)
        is_planned = shown.planned is not None and shown.state is not State.STALE
        self._set(self._ghost, visible=is_planned)
        if shown.planned is not None:
            self._set(self._ghost, wxyz=wxyz(body_to_earth(*_drawn_attitude(shown.planned))))

    def _slide(self, shown: Shown, lost: bool) -> None:
        """Velocity and sideslip."""
        for node in (self._velocity, self._scale):
            self._set(node, visible=shown.beta is not None)
        if shown.beta is not None:
            alpha = self._alpha0 if shown.alpha is None else shown.alpha
            self._set(self._velocity, wxyz=wxyz(wind_to_body(alpha, _drawn(shown.beta))))
        self._paint(self._velocity, GHOST if lost else VELOCITY)

    def _risk(self, shown: Shown, colour: Colour) -> None:
        known = colour != GREY
        level = height(shown.p_value) if known and shown.p_value is not None else COLUMN_HEIGHT
        level = max(level, 0.02)
        self._set(self._fill, color=colour, scale=(1.0, 1.0, level), visible=True)
        self._set(self._fill, position=(0.0, 0.0, -level / 2))
        at = (0.0, 0.0, -height(shown.alert_above))
        self._set(self._threshold, position=at)
        beside = _beside_column(1.6, at[2])
        self._set(self._threshold_label, text=f"> {shown.alert_above:.3g}", position=beside)
        urgent = COLOURS[shown.headline.level]
        self._paint(self._ring, urgent)
        self._set(self._ring, thickness=5.0 if urgent in (ALERT, CAUTION) else 2.0)
        self._set(self._headline, text=label(shown))
        lacking = unknown(shown)
        self._set(self._unknown, text=lacking, visible=lacking != "")

    def _paint(self, node: Any, colour: Colour) -> None:
        key = id(node), "colors"
        if self._sent.get(key) != colour:
            self._sent[key] = colour
            node.colors = np.array(colour, np.uint8)


def _beside_column(shift: float, z: float) -> Point:
    """Of a number, at a height on the column. shift: in INWARD."""
    x, y, base = COLUMN_AT
    return x + shift * INWARD, y + shift * INWARD, base + z


def wxyz(rotation: Rotation) -> tuple[float, ...]:
    """The quaternion, as viser takes it."""
    x, y, z, w = rotation.as_quat().tolist()
    return w, x, y, z


def wind_to_body(alpha: float, beta: float) -> Rotation:
    """[rad]"""
    return Rotation.from_euler("YZ", (-alpha, beta))


def turn(axis: Point, angle: float) -> Rotation:
    """Right-handed about a unit vector [rad]."""
    return Rotation.from_rotvec(angle * np.array(axis))


def _drawn_attitude(attitude: KnownAngles) -> Attitude:
    """The attitude of what is drawn: an unknown angle does not show in it."""
    return Attitude(*(0.0 if angle is None else angle for angle in attitude))


def _drawn(angle: float) -> float:
    return min(max(EXAGGERATION * angle, -WIDEST), WIDEST)


def _stage(server: viser.ViserServer) -> None:
    """Up direction, lights, background and camera."""
    server.gui.configure_theme(dark_mode=True)
    scene = server.scene
    scene.set_up_direction("-z")
    scene.configure_environment_map(None)
    scene.configure_default_lights(True, cast_shadow=False)
    scene.add_light_ambient("/light/ambient", intensity=0.9)
    for name, at in (("behind", (-20.0, 14.0, -8.0)), ("left", (4.0, -20.0, -6.0))):
        scene.add_light_directional(f"/light/{name}", intensity=1.3, position=at)
    camera = server.initial_camera
    (camera.position, camera.look_at), camera.fov = CAMERAS["chase"], FIELD_OF_VIEW
    camera.near, camera.far = NEAREST, 2.0 * HORIZON


def disc(radius: float, n: int = 180) -> tuple[Vertices, Faces]:
    """A level disc about the origin: vertices (n + 1, 3) and faces (n, 3)."""
    angle = np.linspace(0.0, 2 * pi, n, endpoint=False)
    rim = radius * np.stack((np.cos(angle), np.sin(angle), 0 * angle), 1)
    k = np.arange(n)
    faces = np.stack((np.full(n, n), k, (k + 1) % n), 1)
    return np.vstack((rim, np.zeros(3))).astype(np.float32), faces.astype(np.uint32)


def circle(radius: float) -> Lines:
    angle = np.linspace(0.0, 2 * pi, 97)
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


def slip_scale(alpha0: float, radius: float = 15.0) -> Lines:
    """An arc ahead of the nose with marks at 0, 5 and 10 degrees of sideslip to both sides."""

    def at(distance: float, beta_deg: float) -> tuple[float, float, float]:
        angle = np.deg2rad(EXAGGERATION * beta_deg)
        ahead = distance * cos(angle)
        return ahead * cos(alpha0), distance * sin(angle), ahead * sin(alpha0)

    degrees = np.linspace(-10.0, 10.0, 25)
    lines = [(at(radius, a), at(radius, b)) for a, b in pairwise(degrees.tolist())]
    for beta_deg in (-10.0, -5.0, 0.0, 5.0, 10.0):
        inner = radius - (0.5 if beta_deg else 1.0)
        lines.append((at(inner, beta_deg), at(radius + 0.5, beta_deg)))
    return np.array(lines, np.float32)
