"""Shared by tests of reports: scored manoeuvres as plain data, and a subject made of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from app.report.subject import ReportSubject
from core.monitor import Monitor
from tests.support.oscillator import DT
from tests.support.samples import SAMPLE_LIKE

LENGTH = 100
"""Samples of a manoeuvre; one follows the other."""
OBSERVATIONS = "observations within training"


def manoeuvre(number: int, outcome: str, **more: Any) -> dict[str, Any]:
    """A plain scored manoeuvre."""
    first, valid = LENGTH * number, outcome != "invalid"
    return {
        "name": f"manoeuvre {number + 1}",
        "start": first * DT,
        "end": (first + LENGTH - 1) * DT,
        "first": first,
        "last": first + LENGTH - 1,
        "trim": [0.01, 0.0, None, 0.02, 0.0, 0.0],
        "peak_risk": 0.31,
        "peak_t": (first + 40) * DT,
        "alerts": [],
        "exceedance": None,
        "lead": None,
        "outcome": outcome,
        "guarantee": f"P(no alert) is small in {number}" if valid else "It is withdrawn: bent",
        "remarks": [f"it begins late, {number}"],
        "validity": {
            "valid": valid,
            "p_value": 0.4,
            "residual_p": 0.4,
            "distance_p": 0.6,
            "reasons": [] if valid else ["N_y was 9 sigma off its forecast"],
            "checks": [
                {"name": "rate", "ok": True, "text": "20 Hz, as the monitor needs"},
                {"name": "trim", "ok": None, "text": "taken as it is"},
                {"name": OBSERVATIONS, "ok": valid, "text": "p was off" if not valid else "p = 1"},
            ],
        },
    } | more


def exceedance(number: int, after: float = 2.0, value: float = -0.53) -> dict[str, Any]:
    """A limit reached so long after the start of a manoeuvre [s]."""
    return {"t": LENGTH * number * DT + after, "channel": "Ny", "value": value}


def subject_of(monitor: Monitor, manoeuvres: Sequence[dict[str, Any]]) -> ReportSubject:
    """A recording of these manoeuvres and a little more; the invalid ones are withdrawn."""
    n = LENGTH * (len(manoeuvres) + 1)
    samples = np.zeros(n, SAMPLE_LIKE)
    samples["t"] = DT * np.arange(n)
    samples["y"] = 0.1 * np.sin(samples["t"])[:, None]
    samples["p_value"], samples["withdrawn"], samples["manoeuvre"] = 0.05, np.nan, -1
    for number, one in enumerate(manoeuvres):
        part = samples[one["first"] : one["last"] + 1]
        part["manoeuvre"] = number
        if one["outcome"] == "invalid":
            part["p_value"], part["withdrawn"], part["state"] = np.nan, 0.7, 3
        for begin, end in one["alerts"]:
            part["alert"] |= (part["t"] > begin - DT / 2) & (part["t"] < end + DT / 2)
    return ReportSubject(
        recording={
            "name": "<b>flight</b> & more.csv", "digest": "ab" * 32, "size": 1_234_567,
            "format": "csv", "aircraft": "PH-LAB", "start": "", "n_bad_rows": 2,
            "bad_rows": [{"line": 7, "reason": "12 cells where the header has 11", "text": "x"}],
            "ignored": ["<i>comment</i>: not a number"], "notes": ["the comma is the decimal mark"],
        },
        scoring={
            "created": "2030-01-01T10:20:30.000000Z", "version": "0", "epsilon": 0.1, "dt": DT,
            "lead": monitor.lead, "n_samples": n, "start": 0.0, "end": n * DT,
            "notes": ["resampled", "beta: 3 gaps."], "digest": "cd" * 32,
            "monitor_name": "oscillator", "monitor_digest": "ef" * 32, "manoeuvres": manoeuvres,
            "outside_exceedances": [],
            "quality": {
                "compatibility_tolerances": "remarked on beyond 0.1",
                "compatibility": [
                    {
                        "channel": "p", "title": "roll rate against the slope of bank angle",
                        "scale": {"value": 0.8, "low": 0.78, "high": 0.82},
                        "bias": {"value": 0.01, "low": -0.01, "high": 0.03}, "delay": None,
                        "unchecked": "", "remarks": ["roll rate reads 0.80 times"],
                        "suspects": ["p", "phi"],
                    },
                    {
                        "channel": "r", "title": "yaw rate against the slope of heading",
                        "scale": None, "bias": None, "delay": None,
                        "unchecked": "without heading", "remarks": [], "suspects": [],
                    },
                ],
                "sentences": ["beta: 3 gaps."],
                "clocks": [{"start": 0.0, "end": n * DT}],
                "faults": [
                    {"start": 1.0, "end": 1.5, "kind": "missing:Ny"},
                    {"start": 3.0, "end": 3.2, "kind": "gap"},
                ],
            },
            "mapping": {
                "times": {"": {"signal": "clock", "unit": "ms"}},
                "channels": {
                    "beta": {"signal": "AOSS", "unit": "deg", "sign": -1, "bias": 0.0,
                             "derivation": ""},
                    "Ny": {"signal": "", "unit": "", "sign": 1, "bias": 0.02,
                           "derivation": "Ny_without_gravity"},
                },
            },
        },
        monitor=monitor,
        samples=samples,
        mapped="proposed by the program, not confirmed",
        rationales={"beta": {"confidence": 0.61, "reasons": ["its sign is turned"]}},
        markers=[{"t": 3.0, "end": None, "kind": "note", "text": "gust <here>"}],
    )  # fmt: skip
