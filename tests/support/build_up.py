"""Build-ups to a planned test by steps of smaller amplitude."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from core.clearance.clearance import BuildUp


def build_up(following: Any, fractions: Sequence[float]) -> BuildUp:
    """Steps of these fractions of the next point's amplitude."""
    peak = following.maneuver.peak_deg
    flown = (following.maneuver.with_peak(part * peak) for part in fractions)
    return BuildUp(tuple(replace(following, maneuver=each) for each in flown), following)
