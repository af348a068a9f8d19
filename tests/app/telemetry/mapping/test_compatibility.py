"""Data compatibility of recordings, real and simulated."""

from dataclasses import replace

import numpy as np
import pytest

from app.assessment.wording import sensors
from app.telemetry.mapping import motion as module
from app.telemetry.mapping.motion import compatibility
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import repair
from core.clearance.sensors import SensorCheck
from tests.support.attas import record


def checked(traces: Traces) -> dict[str, SensorCheck]:
    return {check.channel: check for check in compatibility(repair(traces).traces)}


def test_a_real_record_agrees_except_for_its_vane_ahead_of_the_centre_of_gravity() -> None:
    """The vane of the ATTAS is on a boom ahead of its nose, itself 10 m ahead of the c.g."""
    checks = checked(record("attas_rud1"))
    assert [key for key, check in checks.items() if check.remarks] == ["beta"]
    assert "measured 13 m ahead of the centre of gravity" in checks["beta"].remarks[0]
    for key, scale in {"p": 1.02, "beta": 0.95, "V": 0.98}.items():
        estimate = checks[key].scale
        assert estimate is not None
        assert abs(estimate.value - scale) < 0.01
    assert checks["r"].unchecked == "without heading"


def test_each_comparison_and_remark_is_one_printed_line() -> None:
    lines = sensors(compatibility(repair(record("attas_rud1")).traces))
    assert [line.split(":")[0].strip() for line in lines] == [
        "Data compatibility, 95 % intervals; remarks where a whole interval is beyond",
        "roll rate against the slope of bank angle",
        "yaw rate against the slope of heading",
        "sideslip against yaw rate",
        "sideslip is 0.10 s late (0.09 to 0.11 s) against yaw rate, or measured 13 m ahead of the "
        "centre of gravity",
        "lateral acceleration against the balance of sideslip",
        "airspeed against the balance of sideslip",
    ]
    assert "bias 0.05" in lines[1]
    assert lines[1].endswith(" s")
    assert lines[2].endswith("not checked: without heading")


def test_a_recording_is_compared_once_however_many_monitors_score_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    traces = repair(record("attas_rud1")).traces
    checks = compatibility(traces)
    monkeypatch.setattr(module, "check_sensors", lambda _: pytest.fail("compared again"))
    assert compatibility(traces) is checks
    with pytest.raises(pytest.fail.Exception, match="compared again"):
        compatibility(replace(traces))


def test_rates_derived_from_the_attitude_are_not_compared_with_it() -> None:
    traces = record("attas_rud1")
    derived = replace(traces.channels["p"], derived=True)
    checks = checked(replace(traces, channels=traces.channels | {"p": derived}))
    assert checks["p"].unchecked == "without roll rate"


def test_sensors_of_different_rates_and_a_heading_that_jumps_are_compared() -> None:
    fast, slow = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 60.0, 0.05)
    turning = 0.3 + 0.1 * np.sin(0.8 * fast)
    heading = 0.3 * slow - 0.125 * np.cos(0.8 * slow)
    wrapped = (heading + np.pi) % (2 * np.pi) - np.pi
    rng = np.random.default_rng(0)
    channels = {
        "r": Trace(fast, turning + 2e-3 * rng.normal(size=len(fast))),
        "psi": Trace(slow, wrapped + 1e-4 * rng.normal(size=len(slow))),
    }
    check = checked(Traces(channels))["r"]
    assert check.scale is not None
    assert check.delay is not None
    assert abs(check.scale.value - 1.0) < 0.01
    assert abs(check.delay.value) < 0.02
    assert not check.remarks


def test_a_recording_without_comparable_channels_names_what_is_missing() -> None:
    t = np.arange(0.0, 10.0, 0.05)
    checks = checked(Traces({"Ny": Trace(t, np.sin(t))}))
    assert all(check.unchecked.startswith("without") for check in checks.values())
    checks = checked(Traces({"p": Trace(t, np.sin(t)), "phi": Trace(t, np.full(len(t), np.nan))}))
    assert checks["p"].unchecked == "without bank angle"
