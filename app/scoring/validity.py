"""Validity of a manoeuvre: every condition of the guarantee, one verdict."""

import numpy as np

from app.scoring.assessed_segment import AssessedSegment
from app.scoring.checks import assessed, channels, flight_condition, manoeuvre, rate, trim, units
from app.scoring.planned_test import read_channels
from app.scoring.scored import OBSERVATIONS, Check, Validity
from core.channels import KEYS
from core.monitor.validity import ValidityVerdict


def validity(flown: AssessedSegment) -> Validity:
    """Every check of a manoeuvre; one that fails takes the right to speak."""
    found = support(flown)
    coverage = assessed(flown)
    checks = (
        rate(flown),
        coverage,
        channels(flown),
        flight_condition(flown),
        *manoeuvre(flown),
        units(flown),
        trim(flown),
        Check(OBSERVATIONS, found.valid, _support_text(found)),
    )
    failed = tuple(check.text for check in checks[:-1] if check.ok is False)
    valid = False if failed else found.valid
    lacking = () if coverage.ok or failed else (coverage.text,)
    if lacking and valid:
        valid = None  # what was said stands, but a flight half unseen is none of the simulated
    return Validity(
        valid=valid,
        p_value=found.p_value,
        residual_p=found.residual_p,
        distance_p=found.distance_p,
        reasons=failed + lacking + found.reasons,
        checks=checks,
    )


def support(flown: AssessedSegment) -> ValidityVerdict:
    """Whether the observations lie within those of training, by conformal rank."""
    monitor, absent = flown.monitor, ~np.isfinite(flown.y).any(axis=0)
    if missing := [KEYS[c] for c in np.flatnonzero(absent & read_channels(monitor))]:
        return ValidityVerdict(
            None, reasons=(f"not judged: that needs {', '.join(missing)}, which is not recorded",)
        )
    return monitor.judge(flown.said.t, flown.assessed, flown.said, end=flown.end)


def _support_text(found: ValidityVerdict) -> str:
    if found.p_value is None or found.level is None:
        return "; ".join(found.reasons)
    numbers = f"p = {found.p_value:.3g}, outside from {found.level:g} down"
    parts = {"residual": found.residual_p, "distance": found.distance_p}
    each = ", ".join(f"{name} {p:.3g}" for name, p in parts.items() if p is not None)
    return f"{numbers} ({each})" + "".join(f"; {reason}" for reason in found.reasons)
