"""The ground track: position over the ground, trail, and heading of the camera.

Telemetry has no position: the track follows heading and sideslip at a fixed speed.
"""

from collections import deque
from math import cos, exp, sin

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from app.scene.airframes import SPAN
from app.scene.shown import Colour
from core.simulation.attitude import Attitude, wrapped
from core.types import Array

DISPLAY_SPEED = 28.0
"""Speed of the ground [m/s]."""
CHASE_S = 2.5
"""Time constant with which the camera follows the heading [s]."""
LONGEST_STEP_S = 1.0
"""A longer or a backward step of flight time restarts the trail [s]."""
TRAIL_POINTS, TRAIL_STEP_S = 48, 0.12
TIPS: Array = np.array([(-3.2, -3.2), (-SPAN / 2, SPAN / 2), (0.0, 0.0)])
"""Left and right wing tip, body axes [m]; (3, 2)."""


def body_to_earth(phi: float, theta: float, psi: float) -> Rotation:
    """Body axes to north-east-down: heading, then pitch, then bank [rad]."""
    return Rotation.from_euler("ZYX", (psi, theta, phi))


class GroundTrack:
    """The flight path so far.

    heading: what the camera follows [rad].   place: north and east [m].
    """

    def __init__(self) -> None:
        self.heading = 0.0
        self.place = np.zeros(2)
        self._t: float | None = None
        self._trail: deque[tuple[float, Array, Colour]] = deque(maxlen=TRAIL_POINTS)
        self._tips, self._colour = np.zeros((3, 2)), (0, 0, 0)

    def advance(self, t: float, attitude: Attitude, beta: float, colour: Colour) -> None:
        step = np.inf if self._t is None else t - self._t
        if not 0.0 <= step <= LONGEST_STEP_S:
            self._trail.clear()
            self.heading, step = attitude.psi, 0.0
        self._t = t
        lag = wrapped(attitude.psi - self.heading)
        self.heading = wrapped(self.heading + lag * (1.0 - exp(-step / CHASE_S)))
        course = attitude.psi + beta
        self.place += DISPLAY_SPEED * step * np.array((cos(course), sin(course)))
        self._tips = body_to_earth(*attitude).as_matrix() @ TIPS
        self._tips[:2] += self.place[:, None]
        self._colour = colour
        if not self._trail or t - self._trail[-1][0] >= TRAIL_STEP_S:
            self._trail.append((t, self._tips, colour))

    def trail(self, background: Colour) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
        """Lines behind both wing tips, relative to the aircraft; they fade into the background.

        Points (2 TRAIL_POINTS, 2, 3) [m] and their colours; unused lines have no length.
        """
        points = np.zeros((2, TRAIL_POINTS, 2, 3), np.float32)
        colours = np.zeros((2, TRAIL_POINTS, 2, 3), np.uint8)
        nodes = [*((tips, colour) for _, tips, colour in self._trail), (self._tips, self._colour)]
        n = len(nodes) - 1
        places = np.array([tips for tips, _ in nodes])
        places[:, :2] -= self.place[:, None]
        shade = np.linspace(0.0, 1.0, n + 1)[:, None]
        tints = shade * np.array([colour for _, colour in nodes])
        tints += (1.0 - shade) * np.array(background)
        points[:, :n, 0] = places[:-1].transpose(2, 0, 1)
        points[:, :n, 1] = places[1:].transpose(2, 0, 1)
        colours[:, :n, 0], colours[:, :n, 1] = tints[:-1], tints[1:]
        return points.reshape(-1, 2, 3), colours.reshape(-1, 2, 3)
