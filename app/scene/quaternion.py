"""Unit quaternions (w, x, y, z) as viser uses them: from a child's frame to its parent's."""

from math import cos, sin

import numpy as np

from core.types import Array

Quaternion = tuple[float, float, float, float]


def turn(axis: tuple[float, float, float], angle: float) -> Quaternion:
    """Right-handed turn about a unit vector by an angle [rad]."""
    s = sin(0.5 * angle)
    return cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2]


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First b, then a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def body_to_earth(phi: float, theta: float, psi: float) -> Quaternion:
    """Body axes to north-east-down: heading, then pitch, then bank (3-2-1) [rad]."""
    yaw, pitch = turn((0.0, 0.0, 1.0), psi), turn((0.0, 1.0, 0.0), theta)
    return product(yaw, product(pitch, turn((1.0, 0.0, 0.0), phi)))


def matrix(q: Quaternion) -> Array:
    """The same rotation as a (3, 3) matrix."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
