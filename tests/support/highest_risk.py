"""A rule that takes the highest risk of its parts, by a plain loop over their own streams."""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from core.monitor import Monitor
from tests.support import oscillator
from tests.support.oscillator import N_SAMPLES, TIMES, Array

Failures = tuple[Array, np.ndarray]


def forty_flights(seed: int, h: int) -> Failures:
    """Forty fresh flights, one of which fails too early to be warned of."""
    y = oscillator.fly(np.random.default_rng(seed), 40)[1]
    fails = oscillator.fail_indices(y)
    fails[np.flatnonzero(fails < N_SAMPLES)[0]] = h - 1
    return y, fails


def check_highest_risk(
    rule: Monitor, parts: Sequence[Monitor], failures: Failures, h: int, flights: Array
) -> None:
    """Assert its calibration scores on failures, and its p-values on flights, to the bit.

    h: samples of its lead.
    """

    def risks(y: Array) -> list[float]:
        """Highest risk of the parts, sample by sample."""
        streams = [part.stream() for part in parts]
        return [
            max(stream.update(t, sample).p_value or 0.0 for stream in streams)
            for t, sample in zip(TIMES, y, strict=True)
        ]

    alphas = sorted(
        -max(risks(y)[: last + 1], default=-math.inf)
        for y, fail in zip(*failures, strict=True)
        if fail < N_SAMPLES
        for last in [fail - h]
    )
    assert rule.alphas.tolist() == alphas
    assert (rule.n_early, alphas[-1]) == (1, math.inf)
    for y in flights:
        assessments = rule.assess(TIMES, y)
        for risk, p in zip(risks(y), assessments.p_value, strict=True):
            at_least = sum(alpha >= -risk for alpha in alphas)
            assert p == float(Fraction(at_least + 1, len(alphas) + 1))
