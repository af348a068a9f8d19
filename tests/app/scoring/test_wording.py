"""Sentences about a manoeuvre: what a monitor that is not applicable would have said."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from app.scoring.outcome import Limited, Peak, RecordedExceedance
from app.scoring.wording import withdrawn
from core.monitor import Assessments

NONE = Limited(None, (Peak("Ny", 0.1, 0.2, 0.1),), 0.0)


def said(*p_values: float) -> Assessments:
    """Assessments at 8.0, 8.1, ... s; what else they say does not matter."""
    n = len(p_values)
    given: dict[str, Any] = {field.name: np.zeros(n) for field in fields(Assessments)}
    given["t"], given["p_value"] = 8.0 + 0.1 * np.arange(n), np.array(p_values)
    return Assessments(**given)


def reached(t: float) -> Limited:
    return NONE._replace(exceedance=RecordedExceedance(t, "Ny", 0.2))


@pytest.mark.parametrize(
    ("limited", "end"),
    [
        (NONE, "epsilon 0.1 at 8.20 s"),
        (reached(8.51), "epsilon 0.1 at 8.20 s, 0.31 s before the limit"),
        (reached(8.2), "epsilon 0.1 at 8.20 s, 0.00 s before the limit"),
        (reached(8.0), "epsilon 0.1 at 8.20 s, 0.20 s after the limit"),
    ],
)
def test_an_alert_that_was_withdrawn_is_told_with_its_lead(limited: Limited, end: str):
    words = withdrawn(said(np.nan, 0.1, 0.11, 0.9), limited, 0.1)
    assert words == f"without the withdrawal the risk would have exceeded {end}"


def test_so_is_a_silence():
    words = withdrawn(said(np.nan, 0.05, 0.031), NONE, 0.1)
    assert words.endswith("stayed at or below epsilon 0.1, at most 0.050 at 8.10 s")
    assert "no sample could be assessed" in withdrawn(said(np.nan, np.nan), NONE, 0.1)
