"""The contents of a scene as viser nodes: aircraft, ground, trail, velocity and risk column.

The world is north-east-down, in metres, seen by a camera behind the aircraft. The attitude is
drawn true, surfaces and sideslip exaggerated. The aircraft stays in place and the ground moves.
What is not known is left out and named: without the bank a line along the body shows the pitch,
without the pitch a line between the wing tips shows the bank.
"""

from itertools import pairwise
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
import viser
from scipy.spatial.transform import Rotation

from app.scene.airframes import Part, airframe
from app.scene.ground_track import TRAIL_POINTS, GroundTrack, body_to_earth
from app.scene.shown import (
    ALERT,
    CALM,
    CAUTION,
    COLOURS,
    EXAGGERATION,
    FAINT,
    GHOST,
    GREY,
    GRID,
    INK,
    LIMIT,
    VELOCITY,
    Colour,
    Shown,
    caption,
    label,
    readout,
    tone,
)
from core.monitor.assessment import State
from core.simulation.aircraft import AircraftClass
from core.simulation.attitude import Attitude, SurfaceSigns
from core.types import Array

Lines = npt.NDArray[np.float32]
"""(n, 2, 3) [m]."""
WIDEST = pi / 4
"""Largest drawn surface angle [rad]."""
DOWN = (0.0, 0.0, 1.0)
GROUND_BELOW, CELL, SECTION = 11.0, 10.0, 50.0
RING_RADIUS = 8.8
COLUMN_AT, COLUMN_HEIGHT, COLUMN_RADIUS = (-4.3, -11.75, -1.2), 7.0, 0.5
"""Left of all letters of the compass, with its foot above them."""

CAMERA_AT, LOOKS_AT, FIELD_OF_VIEW = (-28.0, 7.8, -16.1), (-0.8, -2.2, -2.6), 0.75
"""Compass and column fill a picture that is a quarter wider than high."""

BODY, WINGS = ((-7.0, 0.0, 0.0), (8.0, 0.0, 0.0)), ((0.0, -5.2, 0.0), (0.0, 5.2, 0.0))
"""Lines from tail to nose and from tip to tip, body axes [m]."""

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
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


def height(p_value: float) -> float:
    """Height of a p-value on the column [m]: its square root, to resolve small ones."""
    return COLUMN_HEIGHT * sqrt(min(max(p_value, 0.0), 1.0))


class Picture:
    """The nodes of one scene; `draw` sends the changes as one atomic update.

    signs: directions in which the surfaces act.   alpha0: angle of attack at trim [rad].
    Not thread-safe, and not usable after the server stopped: Scene takes care of both.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        signs: SurfaceSigns,
        alpha0: float,
        aircraft_class: AircraftClass = "fighter",
    ) -> None:
        self._server, self._signs, self._alpha0 = server, signs, alpha0
        self._class: AircraftClass = aircraft_class
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
        self._ground = scene.add_grid(
            "/chase/ground",
            width=900.0,
            height=900.0,
            cell_size=CELL,
            section_size=SECTION,
            cell_color=FAINT,
            section_color=GRID,
            cell_thickness=0.6,
            section_thickness=1.0,
            fade_distance=240.0,
            fade_strength=1.4,
            shadow_opacity=0.0,
            position=(0.0, 0.0, GROUND_BELOW),
        )
        self._ring = self._add_lines("/chase/ring", circle(RING_RADIUS), CALM, 2.0)
        self._compass = self._add_lines("/chase/compass", compass(RING_RADIUS), INK, 1.5)
        trail = np.zeros((2 * TRAIL_POINTS, 2, 3), np.float32)
        self._trail = self._add_lines("/chase/trail", trail, GRID, 2.0)

    def _add_aircraft(self) -> None:
        scene = self._server.scene
        self._aircraft = scene.add_frame("/chase/aircraft", show_axes=False)
        self._parts: dict[str, tuple[Part, Any]] = {}
        for part in airframe(self._class):
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
        self._slip = scene.add_label(
            "/chase/aircraft/slip",
            "",
            position=(16.4, 0.0, -0.6),
            font_screen_scale=0.9,
            anchor="bottom-center",
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
        ring = circle(COLUMN_RADIUS * 1.35)
        for name, p_value in TICKS.items():
            at = (0.0, 0.0, -height(p_value))
            self._add_lines(f"/column/{name}", ring, INK, 1.2, position=at)
            if name in NUMBERED:
                scene.add_label(
                    f"/column/{name}_label",
                    f"{p_value:g}",
                    font_screen_scale=0.75,
                    anchor="center-left",
                    position=(0.0, 1.6 * COLUMN_RADIUS, at[2]),
                )
        self._threshold = scene.add_line_segments(
            "/column/threshold", circle(COLUMN_RADIUS * 1.75), LIMIT, thickness=0.18
        )
        self._threshold_label = scene.add_label(
            "/column/threshold_label", "", font_screen_scale=0.9, anchor="center-right"
        )
        self._headline = scene.add_label(
            "/column/headline",
            "",
            position=(0.0, -2.0 * COLUMN_RADIUS, -COLUMN_HEIGHT - 1.4),
            font_screen_scale=1.0,
            anchor="bottom-left",
        )
        self._unknown = scene.add_label(
            "/column/unknown",
            "",
            position=(0.0, -2.0 * COLUMN_RADIUS, 1.2),
            font_screen_scale=0.8,
            anchor="top-left",
        )
        self._readout = self._server.gui.add_html("")

    # --- moving ---------------------------------------------------------------------------------

    def _move(self, shown: Shown, colour: Colour) -> None:
        track, (bank, pitch, heading) = self._track, shown.attitude
        track.advance(shown.t, _drawn_attitude(shown), shown.beta or 0.0, colour)
        north, east = -(track.place % SECTION)
        self._set(self._chase, wxyz=turned(DOWN, -track.heading))
        self._set(self._ground, position=(float(north), float(east), GROUND_BELOW))
        self._set(self._compass, visible=heading is not None)
        self._set(self._trail, visible=bank is not None and pitch is not None)
        self._trail.points, self._trail.colors = track.trail(GRID)

    def _pose(self, shown: Shown) -> None:
        """Attitude, surfaces and velocity; grey if the telemetry is stale or invalid."""
        lost = shown.state in (State.STALE, State.INVALID)
        bank, pitch, _ = shown.attitude
        self._set(self._aircraft, wxyz=wxyz(body_to_earth(*_drawn_attitude(shown))))
        self._set(self._body, visible=bank is None and pitch is not None)
        self._set(self._wings, visible=pitch is None and bank is not None)
        roll, yaw = (
            None if deflection is None else sign * _drawn(deflection)
            for sign, deflection in zip(self._signs, (shown.delta_a, shown.delta_r), strict=True)
        )
        turns = {
            "right_aileron": None if roll is None else -roll,  # trailing edge up rolls right
            "left_aileron": roll,
            "rudder": yaw,  # trailing edge right yaws right
        }
        is_seen = bank is not None and pitch is not None
        for name, (part, node) in self._parts.items():
            angle = turns.get(name, 0.0)
            seen = is_seen and angle is not None
            self._set(node, color=GHOST if lost else part.colour, visible=seen)
            if name in turns and angle is not None:
                self._set(node, wxyz=turned(part.axis, angle))
        self._slide(shown.beta, lost)

    def _slide(self, beta: float | None, lost: bool) -> None:
        """Velocity and sideslip."""
        for node in (self._velocity, self._scale):
            self._set(node, visible=beta is not None)
        if beta is not None:
            wind = Rotation.from_euler("YZ", (-self._alpha0, _drawn(beta)))
            self._set(self._velocity, wxyz=wxyz(wind))
        self._paint(self._velocity, GHOST if lost else VELOCITY)
        words = "" if lost or beta is None else f"β {np.rad2deg(beta):+.1f}°"
        self._set(self._slip, text=words, visible=words != "")

    def _risk(self, shown: Shown, colour: Colour) -> None:
        known = colour != GREY
        level = height(shown.p_value) if known and shown.p_value is not None else COLUMN_HEIGHT
        level = max(level, 0.02)
        self._set(self._fill, color=colour, scale=(1.0, 1.0, level), visible=True)
        self._set(self._fill, position=(0.0, 0.0, -level / 2))
        at = (0.0, 0.0, -height(shown.alert_above))
        self._set(self._threshold, position=at)
        beside = (0.0, -2.2 * COLUMN_RADIUS, at[2])
        self._set(self._threshold_label, text=f"> {shown.alert_above:.3g}", position=beside)
        urgent = COLOURS[shown.headline.level]
        self._paint(self._ring, urgent)
        self._set(self._ring, thickness=5.0 if urgent in (ALERT, CAUTION) else 2.0)
        words = caption(shown)
        self._set(self._headline, text=label(shown))
        self._set(self._unknown, text=words.unknown, visible=words.unknown != "")
        self._set(self._readout, content=readout(words, urgent))

    def _paint(self, node: Any, colour: Colour) -> None:
        key = id(node), "colors"
        if self._sent.get(key) != colour:
            self._sent[key] = colour
            node.colors = np.array(colour, np.uint8)


def wxyz(rotation: Rotation) -> tuple[float, ...]:
    """The quaternion of a rotation as viser uses it, from a child's frame to its parent's."""
    x, y, z, w = rotation.as_quat().tolist()
    return w, x, y, z


def turned(axis: tuple[float, float, float], angle: float) -> tuple[float, ...]:
    """The quaternion of a right-handed turn about a unit vector by an angle [rad]."""
    return wxyz(Rotation.from_rotvec(np.multiply(angle, axis)))


def _drawn_attitude(shown: Shown) -> Attitude:
    """The attitude of what is drawn: an unknown angle does not show in it."""
    return Attitude(*(0.0 if angle is None else angle for angle in shown.attitude))


def _drawn(angle: float) -> float:
    return min(max(EXAGGERATION * angle, -WIDEST), WIDEST)


def _stage(server: viser.ViserServer) -> None:
    """Up direction, lights, background, camera, and viser's panel out of the way."""
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    server.gui.main_panel.float(x=-10, y=10, width=262)
    scene = server.scene
    scene.set_up_direction("-z")
    scene.configure_environment_map(None)
    scene.configure_default_lights(True, cast_shadow=False)
    scene.add_light_ambient("/light/ambient", intensity=0.9)
    for name, at in (("behind", (-20.0, 14.0, -8.0)), ("left", (4.0, -20.0, -6.0))):
        scene.add_light_directional(f"/light/{name}", intensity=1.3, position=at)
    camera = server.initial_camera
    camera.position, camera.look_at, camera.fov = CAMERA_AT, LOOKS_AT, FIELD_OF_VIEW


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
