"""The contents of a scene as viser nodes: aircraft, ground, trail, velocity and risk column.

The world is north-east-down, in metres, seen by a camera behind the aircraft. The attitude is
drawn true, surfaces and sideslip exaggerated. The aircraft stays in place and the ground moves.
"""

from html import escape
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import viser

from app.scene.airframes import Colour, Part, airframe
from app.scene.ground_track import TRAIL_POINTS, GroundTrack
from app.scene.quaternion import body_to_earth, product, turn
from app.scene.shapes import arrow, circle, compass, slip_scale, torus, tube
from core.monitor.assessment import Cause, State
from core.monitor.status import Facts, Headline, Level, Status, headline, in_words
from core.simulation.aircraft import AircraftClass
from core.simulation.attitude import Attitude, SurfaceSigns

CALM: Colour = (24, 156, 144)
ALERT: Colour = (255, 40, 32)
CAUTION: Colour = (228, 142, 12)
ADVISORY: Colour = (72, 136, 236)
GREY: Colour = (128, 132, 140)
GHOST: Colour = (92, 95, 101)
INK: Colour = (124, 135, 149)
FAINT: Colour = (96, 104, 116)
VELOCITY: Colour = (72, 132, 236)
LIMIT: Colour = (232, 160, 8)
GRID: Colour = (104, 114, 128)
"""Visible on a dark and on a light sky: the sky is the page's background, in the viewer's theme."""

EXAGGERATION = 3.0
"""Factor of the drawn surface angles and sideslip; shown in the scene."""
WIDEST = pi / 4
"""Largest drawn surface angle [rad]."""
DOWN = (0.0, 0.0, 1.0)
GROUND_BELOW, CELL, SECTION = 11.0, 10.0, 50.0
RING_RADIUS = 8.8
COLUMN_AT, COLUMN_HEIGHT, COLUMN_RADIUS = (-4.3, -11.75, -1.2), 7.0, 0.5
"""Left of all letters of the compass, with its foot above them."""

CAMERA_AT, LOOKS_AT, FIELD_OF_VIEW = (-28.0, 7.8, -16.1), (-0.8, -2.2, -2.6), 0.75
"""Compass and column fill a picture that is a quarter wider than high."""

LONGEST_DETAIL, LONGEST_LABEL = 120, 36
TICKS = {"none": 0.0, "quarter": 0.25, "half": 0.5, "whole": 1.0}
NUMBERED = ("none", "quarter", "whole")
"""Ticks with a number, far enough apart for the smallest scene."""


COLOURS = {
    Level.WARNING: ALERT,
    Level.CAUTION: CAUTION,
    Level.ADVISORY: ADVISORY,
    Level.NONE: CALM,
}
"""Colours of ring and words: red is for warnings only."""


class Shown(NamedTuple):
    """All that a picture depends on; see Scene.show."""

    t: float
    attitude: Attitude
    beta: float
    delta_a: float
    delta_r: float
    p_value: float | None
    alert_above: float
    alert: bool
    state: State
    reason: str
    paused: bool = False
    facts: Facts | None = None
    cause: Cause | None = None

    @property
    def headline(self) -> Headline:
        """The flight's headline; by default that of the sample alone."""
        return headline(self._sampled() if self.facts is None else self.facts)

    def _sampled(self) -> Facts:
        unknown = self.state is State.OK and self.p_value is None
        return Facts(
            alert=self.alert,
            stale=self.state is State.STALE,
            invalid=self.state is State.INVALID or unknown,
            warming_up=self.state is State.WARMING_UP,
        )


class Caption(NamedTuple):
    """Words of a scene: headline, risk if known, and detail."""

    word: str
    risk: str
    detail: str


def caption(shown: Shown) -> Caption:
    """A number only for an assessed sample; a word unless the flight is calm."""
    now = shown.headline
    both = "" if now.status is Status.OK else in_words(now, shown.cause)
    if shown.state is not State.OK or shown.p_value is None:
        return Caption(both, "", shown.reason or "no risk known")
    word = f"{both}{' PAUSED' * shown.paused}".strip()
    return Caption(
        word,
        f"RISK {as_text(shown.p_value, shown.alert_above)}",
        f"alert above {shown.alert_above:.3g}",
    )


def label(shown: Shown) -> str:
    """As much of the caption as fits the narrowest scene, the current status in any case."""
    words, now = caption(shown), shown.headline
    first = in_words(now._replace(exceeded_t=None), shown.cause)
    headline = in_words(now, shown.cause)
    texts = (f"{words.word} {words.risk}".strip(), words.word, headline, first)
    return next((text for text in texts if len(text) <= LONGEST_LABEL), first)


def as_text(p_value: float, alert_above: float) -> str:
    """Two decimals, or more where rounding would give 0 or cross the threshold."""
    text = ""
    for digits in range(2, 6):
        text = f"{p_value:.{digits}f}"
        if float(text) > 0.0 and (float(text) > alert_above) == (p_value > alert_above):
            break
    return text


def readout(words: Caption, colour: Colour) -> str:
    """The words as HTML for viser's panel; `detail` is escaped since it may be external text."""
    tint = f"rgb{colour}"
    style = f"background:{tint};color:#0b0f14;padding:0 8px;margin:0 -8px 2px;border-radius:4px"
    word = f'<div style="{style};font-size:24px;font-weight:800">{words.word}</div>'
    small = '<span style="font-size:12px;font-weight:400;color:#cdd6e0">(higher is worse)</span>'
    large = f"white-space:nowrap;font-size:20px;font-weight:700;color:{tint}"
    risk = f'<div style="{large}">{words.risk} {small}</div>'
    return (
        '<div style="font-family:system-ui,sans-serif;padding:0 12px 4px;line-height:1.3">'
        + word * bool(words.word)
        + risk * bool(words.risk)
        + f'<div style="font-size:13px">{escape(words.detail[:LONGEST_DETAIL])}</div>'
        '<div style="font-size:11px;opacity:.7">surfaces and sideslip drawn '
        f"×{EXAGGERATION:g}</div></div>"
    )


def tone(shown: Shown) -> Colour:
    """Colour of the risk: calm, alert, or grey if unknown."""
    if shown.state is not State.OK or shown.p_value is None:
        return GREY
    return ALERT if shown.alert else CALM


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
        self._ring = scene.add_line_segments(
            "/chase/ring", circle(RING_RADIUS), CALM, thickness=2.0, thickness_units="screen"
        )
        scene.add_line_segments(
            "/chase/compass", compass(RING_RADIUS), INK, thickness=1.5, thickness_units="screen"
        )
        self._trail = scene.add_line_segments(
            "/chase/trail",
            np.zeros((2 * TRAIL_POINTS, 2, 3)),
            np.zeros((2 * TRAIL_POINTS, 2, 3), np.uint8),
            thickness=2.0,
            thickness_units="screen",
        )

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
                cast_shadow=False,
                receive_shadow=False,
            )
            self._parts[part.name] = part, node
        scene.add_line_segments(
            "/chase/aircraft/slip_scale",
            slip_scale(self._alpha0, EXAGGERATION),
            INK,
            thickness=1.5,
            thickness_units="screen",
        )
        self._velocity = scene.add_mesh_simple(
            "/chase/aircraft/velocity",
            *arrow(),
            color=VELOCITY,
            cast_shadow=False,
            receive_shadow=False,
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
        common: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
        glass = tube(COLUMN_RADIUS * 1.35)
        scene.add_mesh_simple(
            "/column/glass",
            *glass,
            color=INK,
            opacity=0.14,
            scale=(1.0, 1.0, COLUMN_HEIGHT),
            side="double",
            **common,
        )
        self._fill = scene.add_mesh_simple(
            "/column/fill", *tube(COLUMN_RADIUS), color=GREY, visible=False, **common
        )
        for name, p_value in TICKS.items():
            at = (0.0, 0.0, -height(p_value))
            scene.add_line_segments(
                f"/column/{name}",
                circle(COLUMN_RADIUS * 1.35),
                INK,
                thickness=1.2,
                thickness_units="screen",
                position=at,
            )
            if name in NUMBERED:
                scene.add_label(
                    f"/column/{name}_label",
                    f"{p_value:g}",
                    font_screen_scale=0.75,
                    anchor="center-left",
                    position=(0.0, 1.6 * COLUMN_RADIUS, at[2]),
                )
        self._threshold = scene.add_mesh_simple(
            "/column/threshold", *torus(COLUMN_RADIUS * 1.75, 0.09), color=LIMIT, **common
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
        self._readout = self._server.gui.add_html("")

    # --- moving ---------------------------------------------------------------------------------

    def _move(self, shown: Shown, colour: Colour) -> None:
        """Turn the world under the camera, move the ground, extend the trail."""
        track = self._track
        track.advance(shown.t, shown.attitude, shown.beta, colour)
        north, east = -(track.place % SECTION)
        self._set(self._chase, wxyz=turn(DOWN, -track.heading))
        self._set(self._ground, position=(float(north), float(east), GROUND_BELOW))
        self._trail.points, self._trail.colors = track.trail(GRID)

    def _pose(self, shown: Shown) -> None:
        """Attitude, surfaces and velocity; grey if the telemetry is stale or invalid."""
        lost = shown.state in (State.STALE, State.INVALID)
        self._set(self._aircraft, wxyz=body_to_earth(*shown.attitude))
        roll = self._signs.aileron * _drawn(shown.delta_a)
        turns = {
            "right_aileron": -roll,  # trailing edge up rolls right
            "left_aileron": roll,
            "rudder": self._signs.rudder * _drawn(shown.delta_r),  # trailing edge right yaws right
        }
        for name, (part, node) in self._parts.items():
            self._set(node, color=GHOST if lost else part.colour)
            if name in turns:
                self._set(node, wxyz=turn(part.axis, turns[name]))
        yaw = turn(DOWN, _drawn(shown.beta))
        pitch = turn((0.0, 1.0, 0.0), -self._alpha0)
        self._set(self._velocity, wxyz=product(pitch, yaw), color=GHOST if lost else VELOCITY)
        beta = "" if lost else f"β {np.rad2deg(shown.beta):+.1f}°"
        self._set(self._slip, text=beta, visible=not lost)

    def _risk(self, shown: Shown, colour: Colour) -> None:
        """Column, threshold ring, level ring and words."""
        known = colour != GREY
        level = height(shown.p_value) if known and shown.p_value is not None else COLUMN_HEIGHT
        self._set(self._fill, color=colour, scale=(1.0, 1.0, max(level, 0.02)), visible=True)
        at = (0.0, 0.0, -height(shown.alert_above))
        self._set(self._threshold, position=at)
        beside = (0.0, -2.2 * COLUMN_RADIUS, at[2])
        self._set(self._threshold_label, text=f"> {shown.alert_above:.3g}", position=beside)
        urgent = COLOURS[shown.headline.level]
        self._paint_ring(urgent)
        words = caption(shown)
        self._set(self._headline, text=label(shown))
        self._set(self._readout, content=readout(words, urgent))

    def _paint_ring(self, colour: Colour) -> None:
        key = id(self._ring), "colors"
        if self._sent.get(key) != colour:
            self._sent[key] = colour
            self._ring.colors = np.array(colour, np.uint8)
            self._ring.thickness = 5.0 if colour in (ALERT, CAUTION) else 2.0


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
