"""Validity of a manoeuvre: all conditions of the guarantee in one verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from app.assessment.assessed_segment import AssessedSegment
from app.assessment.checks import channels, coverage, flight_condition, manoeuvre, rate, trim, units
from app.assessment.planned_test import read_channels
from app.assessment.scored import OBSERVATIONS, Check, Validity
from core.channels import KEYS
from core.monitor.assessment import Withdrawal
from core.monitor.validity.verdict import ValidityVerdict, in_words

LIMITS = "limits in force"
"""Name of the check that these are the monitor's own limits."""


def validity(assessed: AssessedSegment) -> tuple[Validity, Withdrawal | None]:
    """Check a manoeuvre; return its validity and the withdrawal, if any.

    The withdrawal starts where a live stream withdraws. If another check fails (airspeed, wrong
    manoeuvre: a stream cannot know these), it starts at the first sample. None if valid throughout.
    """
    verdict, withdrawal = support(assessed)
    enough = coverage(assessed)
    checks = (
        rate(assessed),
        enough,
        channels(assessed),
        flight_condition(assessed),
        *manoeuvre(assessed),
        units(assessed),
        trim(assessed),
        Check(OBSERVATIONS, verdict.valid, _support_text(verdict)),
    )
    failed = tuple(check.text for check in checks[:-1] if check.ok is False)
    valid = False if failed else verdict.valid
    lacking = () if enough.ok or failed else (enough.text,)
    if lacking and valid:
        valid = None  # keep the assessments, but simulated flights have no such gaps
    result = Validity(
        valid=valid,
        p_value=verdict.p_value,
        residual_p=verdict.residual_p,
        distance_p=verdict.distance_p,
        reasons=failed + lacking + verdict.reasons,
        checks=checks,
    )
    return result, Withdrawal(0, in_words(failed)) if failed else withdrawal


def under_limits(verdict: Validity, in_force: Sequence[Mapping[str, Any]]) -> Validity:
    """Add the limit set's check: not applicable where its limits are not the monitor's.

    in_force: plain, see InForceTimeline.intervals.
    """
    reasons = tuple(dict.fromkeys(each["reason"] for each in in_force if each["reason"]))
    if not reasons:
        return verdict
    check = Check(LIMITS, False, "; ".join(reasons))
    checks, reasons = (*verdict.checks, check), (*reasons, *verdict.reasons)
    return replace(verdict, valid=False, reasons=reasons, checks=checks)


def support(assessed: AssessedSegment) -> tuple[ValidityVerdict, Withdrawal | None]:
    """Are the observations within training, by conformal rank; and from where not?"""
    monitor, absent = assessed.monitor, ~np.isfinite(assessed.y).any(axis=0)
    if missing := [KEYS[c] for c in np.flatnonzero(absent & read_channels(monitor))]:
        reason = f"not judged: {', '.join(missing)} not recorded"
        return ValidityVerdict(None, reasons=(reason,)), None
    streamed = assessed.streamed
    return monitor.judge_and_withdraw(streamed.t, assessed.y_read, streamed)


def _support_text(verdict: ValidityVerdict) -> str:
    if verdict.p_value is None or verdict.level is None:
        return "; ".join(verdict.reasons)
    numbers = f"p = {verdict.p_value:.3g}, outside training at p ≤ {verdict.level:g}"
    parts = {"residual": verdict.residual_p, "distance": verdict.distance_p}
    each = ", ".join(f"{name} {p:.3g}" for name, p in parts.items() if p is not None)
    return f"{numbers} ({each})" + "".join(f"; {reason}" for reason in verdict.reasons)
