"""Suggest an amplitude at which enough flights of a planned test exceed a limit."""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import copysign

from core.monitor.group import Pooled
from core.planned_test.planned_test import ManeuverTest
from core.seeds import Branch, stream

WANTED_SHARE = 0.25
"""Default share of rollouts that exceed a limit at the suggested amplitude."""
TOLERANCE = 0.1
"""Largest difference between the share reached and the one wanted."""
LOWEST_DEG, HIGHEST_DEG = 0.01, 45.0
"""Range of plausible amplitudes."""
CLOSE_ENOUGH = 1.003
"""Ratio of two amplitudes at which the bisection ends."""
PILOT_ROLLOUTS, PILOT_STEPS = 400, 1_000_000
"""Rollouts at each amplitude, and the largest number of their steps; at least FEWEST rollouts."""
FEWEST = 50
NOT_FLOWN = {"groups": Pooled(), "n_unsafe": 2, "n_obs": 1, "max_rollouts": 1, "max_safe": 1}
"""Fields of a recipe that change no flight, with values for the search."""


class AmplitudeError(ValueError):
    """No plausible amplitude at which the wanted share of rollouts exceeds a limit."""


@dataclass(frozen=True)
class Suggestion:
    """An amplitude and the result of a pilot run at it.

    share: of n_rollouts that exceeded a limit.
    """

    amplitude_deg: float
    share: float
    n_rollouts: int

    def __str__(self) -> str:
        return (
            f"At an amplitude of {self.amplitude_deg:g} deg {100 * self.share:.0f} % of "
            f"{self.n_rollouts} pilot rollouts exceed a limit"
        )


def suggest_amplitude(
    recipe: ManeuverTest, share: float = WANTED_SHARE, most: int = PILOT_ROLLOUTS
) -> Suggestion:
    """Find the amplitude [deg] at which about this share of the rollouts exceeds a limit.

    most: rollouts at each amplitude.
    Bisection with the same aircraft, pilots and seed. A table is scaled as a whole; the sign stays.
    AmplitudeError if no amplitude from LOWEST_DEG to HIGHEST_DEG has about that share.
    """
    if recipe.margins.label:
        raise AmplitudeError(
            "stability margins do not depend on the amplitude, so none can be suggested: choose it "
            "yourself"
        )
    if not 0 < share < 1:
        raise AmplitudeError(f"share={share} was given: give a number between 0 and 1")
    suggestion = _remembered(replace(recipe, **NOT_FLOWN), share, most)
    if isinstance(suggestion, AmplitudeError):
        raise AmplitudeError(*suggestion.args)
    return suggestion


@lru_cache(maxsize=256)
def _remembered(recipe: ManeuverTest, share: float, most: int) -> Suggestion | AmplitudeError:
    """The same for monitors of one test with other leads or sizes."""
    try:
        return _bisected(recipe, share, most)
    except AmplitudeError as error:
        return error


def _bisected(recipe: ManeuverTest, share: float, most: int) -> Suggestion:
    n = max(FEWEST, min(most, PILOT_STEPS // recipe.n_steps, recipe.most_at_once))
    low, high = LOWEST_DEG, HIGHEST_DEG
    _check_range(share, low, _share(recipe, low, n), high, _share(recipe, high, n))
    while high > CLOSE_ENOUGH * low:
        middle = (low * high) ** 0.5
        if _share(recipe, middle, n) < share:
            low = middle
        else:
            high = middle
    return _checked(recipe, share, float(f"{high:.3g}"), n)


def _share(recipe: ManeuverTest, amplitude_deg: float, n: int) -> float:
    """Share of n rollouts at this amplitude that exceed a limit; always the same aircraft."""
    peak = copysign(amplitude_deg, recipe.maneuver.peak_deg)
    test = replace(recipe, maneuver=recipe.maneuver.with_peak(peak))
    flown = test.simulator().rollouts(n, stream(recipe.seed, Branch.PILOT_RUN))
    return float(flown.is_unsafe.mean())


def _check_range(share: float, low: float, least: float, high: float, most: float) -> None:
    if least >= share:
        raise AmplitudeError(
            f"{100 * least:.0f} % of the rollouts exceed a limit even at {low:g} deg, wanted "
            f"{100 * share:.0f} %: raise the limit, shorten the manoeuvre "
            "or choose a stabilising law"
        )
    if most < share:
        raise AmplitudeError(
            f"{100 * most:.0f} % of the rollouts exceed a limit even at {high:g} deg, wanted "
            f"{100 * share:.0f} %: lower the limit or choose another manoeuvre or law"
        )


def _checked(recipe: ManeuverTest, share: float, amplitude_deg: float, n: int) -> Suggestion:
    reached = _share(recipe, amplitude_deg, n)
    if abs(reached - share) > TOLERANCE:
        raise AmplitudeError(
            f"the share of rollouts that exceed a limit jumps to {100 * reached:.0f} % at "
            f"{amplitude_deg:g} deg, wanted {100 * share:.0f} %: the aircraft are too similar, "
            "increase their uncertainty"
        )
    return Suggestion(copysign(amplitude_deg, recipe.maneuver.peak_deg), reached, n)
