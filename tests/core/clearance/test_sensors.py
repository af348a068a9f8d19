"""Data compatibility of sensors, on motion that is exact by construction."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from core.channels import KEYS
from core.clearance.sensors import GRAVITY, SensorCheck, SensorReadings, check_sensors
from core.types import Array

DT, SPEED, ALPHA, THETA = 0.05, 130.0, 0.05, 0.04
T: Array = np.arange(0.0, 40.0, DT)
NOISE = {"beta": 1e-3, "p": 2e-3, "r": 2e-3, "Ny": 3e-3, "phi": 1e-3, "psi": 1e-3}


def moved(rng: np.random.Generator, size: float) -> tuple[Array, Array]:
    """A smooth motion of many frequencies, like Dutch roll and doublets, and its derivative."""
    omega = rng.uniform(0.5, 4.0, 12)
    phase, share = rng.uniform(0, 2 * np.pi, 12), rng.normal(size=12) / np.sqrt(6)
    inside = omega * T[:, None] + phase
    return size * np.sin(inside) @ share, size * np.cos(inside) @ (share * omega)


def flown(
    seed: int = 1, size: float = 1.0, gust: float = 1.0, *, flat: bool = False
) -> dict[str, Array]:
    """Readings of a motion that obeys the kinematics exactly, with noise, and gust on the vane.

    flat: it only yaws about its path, as a Dutch roll mostly does.
    """
    rng = np.random.default_rng(seed)
    phi, phi_dot = moved(rng, 0.1 * size)
    psi, psi_dot = moved(rng, 0.03 * size)
    beta, beta_dot = moved(rng, 0.04 * size)
    if flat:
        beta, beta_dot = -psi, -psi_dot
    p = phi_dot - psi_dot * np.sin(THETA)
    r = psi_dot * np.cos(THETA) * np.cos(phi)
    force = beta_dot + r * np.cos(ALPHA) - p * np.sin(ALPHA)
    lateral = SPEED / GRAVITY * force - np.sin(phi) * np.cos(THETA)
    exact = {"beta": beta, "p": p, "r": r, "Ny": lateral, "phi": phi, "psi": psi}
    readings = {key: x + NOISE[key] * rng.normal(size=len(T)) for key, x in exact.items()}
    innovations = rng.normal(size=len(T)) * 2e-3 * gust * np.sqrt(2 * DT / 3.0)
    of_air = np.zeros(len(T))
    for k in range(1, len(T)):
        of_air[k] = (1 - DT / 3.0) * of_air[k - 1] + innovations[k]
    readings["beta"] += of_air
    return readings | {"theta": np.full(len(T), THETA), "V": np.full(len(T), SPEED)}


def checked(channels: dict[str, Array]) -> dict[str, SensorCheck]:
    return {check.channel: check for check in check_sensors(SensorReadings(DT, channels))}


def late(x: Array, seconds: float) -> Array:
    n = round(seconds / DT)
    return np.concatenate([np.full(n, x[0]), x[: len(x) - n]])


def test_sensors_that_agree_have_no_remarks() -> None:
    checks = checked(flown())
    assert list(checks) == ["p", "r", "beta", "Ny", "V"]
    for check in checks.values():
        assert check.scale is not None
        assert check.scale.value == pytest.approx(1.0, abs=0.1)
        assert (check.remarks, check.suspects, check.unchecked) == ((), (), "")


def test_intervals_have_their_coverage() -> None:
    """Nineteen in twenty, in gusts that correlate the residuals."""
    n, covered = 40, Counter[str]()
    for seed in range(n):
        checks = checked(flown(seed, gust=3.0))
        for key, check in checks.items():
            assert check.scale is not None
            covered[key] += check.scale.low <= 1.0 <= check.scale.high
        delay = checks["beta"].delay
        assert delay is not None
        covered["delay"] += delay.low <= 0.0 <= delay.high
    assert covered.keys() == {"p", "r", "beta", "Ny", "V", "delay"}
    assert all(share >= 0.95 * n - 3 * np.sqrt(n * 0.05 * 0.95) for share in covered.values()), (
        covered
    )


FAULTS: dict[str, tuple[str, Callable[[Array], Array], str, float]] = {
    "roll rate reads a fifth too little": ("p", lambda x: 0.8 * x, "p", 0.8),
    "roll rate is reversed": ("p", lambda x: -x, "p", -1.0),
    "roll rate is in degrees": ("p", np.degrees, "p", 57.3),
    "yaw rate reads a quarter too much": ("r", lambda x: 1.25 * x, "r", 1.25),
    "sideslip reads a fifth too little": ("beta", lambda x: 0.8 * x, "beta", 0.8),
    "sideslip is reversed": ("beta", lambda x: -x, "beta", -1.0),
    "airspeed is in knots": ("V", lambda x: x / 0.514444, "V", 1.94),
    "lateral acceleration is reversed": ("Ny", lambda x: -x, "Ny", -1.0),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_scale_error_is_found_and_attributed_to_its_sensor(fault: str) -> None:
    key, change, where, scale = FAULTS[fault]
    readings = flown(gust=0.3)
    check = checked(readings | {key: change(readings[key])})[where]
    assert check.scale is not None
    assert check.scale.value == pytest.approx(scale, rel=0.05)
    angle = {"p": "phi", "r": "psi"}.get(key)
    assert check.suspects == ((key, angle) if angle else (key,))
    assert "check gain, unit and sign of" in check.remarks[0]


@pytest.mark.parametrize("key", ["p", "r", "beta"])
def test_a_delay_is_found(key: str) -> None:
    readings = flown()
    if key == "r":
        readings = {k: x if k in ("psi", "theta") else late(x, 0.1) for k, x in readings.items()}
    check = checked(readings | ({} if key == "r" else {key: late(readings[key], 0.1)}))[key]
    assert check.delay is not None
    assert check.delay.value == pytest.approx(0.1, abs=0.01)
    assert any("0.10 s late" in remark for remark in check.remarks)


def test_a_late_vane_may_be_one_ahead_of_the_centre_of_gravity() -> None:
    readings = flown(flat=True)
    ahead = readings["beta"] + 13.0 * readings["r"] / SPEED
    (remark,) = checked(readings | {"beta": ahead})["beta"].remarks
    assert remark.endswith("against yaw rate, or measured 13 m ahead of the centre of gravity")


def test_a_bias_of_a_rate_is_found() -> None:
    readings = flown()
    check = checked(readings | {"p": readings["p"] + 0.02})["p"]
    assert check.bias is not None
    assert check.bias.low < 0.02 < check.bias.high
    assert "roll rate has a bias of 1.1" in check.remarks[0]


def test_a_bias_of_the_accelerometer_is_found() -> None:
    readings = flown()
    bias = checked(readings | {"Ny": readings["Ny"] + 0.05})["Ny"].bias
    assert bias is not None
    assert bias.low < 0.05 < bias.high


def of_balance(readings: dict[str, Array]) -> tuple[str, ...]:
    return checked(readings)["Ny"].remarks


def test_a_constant_of_the_balance_of_sideslip_is_found() -> None:
    readings = flown() | {"r": flown()["r"] + np.radians(2.0)}
    (remark,) = of_balance({key: x for key, x in readings.items() if key != "psi"})
    assert "a constant of 2.0" in remark
    (remark,) = of_balance({key: x for key, x in readings.items() if key not in ("psi", "V")})
    assert "a constant of 2.0" in remark
    assert of_balance(readings | {"r": flown()["r"] + np.radians(0.3)}) == ()


def test_calm_flight_gives_no_estimate() -> None:
    for check in checked(flown(size=0.02)).values():
        assert check.unchecked == "not enough motion"
        assert (check.scale, check.bias, check.delay, check.remarks) == (None, None, None, ())


def test_missing_channels_are_named() -> None:
    readings = flown()
    without = {key: readings[key] for key in KEYS if key in readings}
    words = {key: check.unchecked for key, check in checked(without).items()}
    assert words == {
        "p": "without bank angle",
        "r": "without heading",
        "beta": "without bank angle",
        "Ny": "without bank angle and airspeed",
        "V": "without airspeed and bank angle",
    }
    checks = checked({key: x for key, x in readings.items() if key != "V"})
    assert checks["beta"].scale is not None
    assert checks["Ny"].unchecked == checks["V"].unchecked == "without airspeed"


def test_a_rate_that_does_not_follow_gets_a_remark() -> None:
    readings = flown()
    check = checked(readings | {"p": flown(2)["p"]})["p"]
    assert check.scale is None
    assert "roll rate does not follow the slope of bank angle" in check.remarks[0]


def test_gaps_are_not_bridged() -> None:
    readings = flown()
    gap = slice(300, 400)
    for key in ("beta", "p", "r", "Ny", "phi", "psi"):
        readings[key][gap] = np.nan
        readings[key][400:] += {"phi": 0.3, "psi": 1.0}.get(key, 0.0)
    check = checked(readings)["p"]
    assert check.scale is not None
    assert check.scale.low < 1.0 < check.scale.high
    assert not check.remarks


@pytest.mark.parametrize("key", ["p", "r", "beta", "Ny", "phi", "psi", "theta", "V"])
@pytest.mark.parametrize("value", [0.0, 1.0, np.nan])
def test_a_dead_sensor_gives_no_estimate(key: str, value: float) -> None:
    readings = flown()
    checks = checked(readings | {key: np.full(len(T), value)})
    if key in checks:
        assert checks[key].scale is None
    for check in checks.values():
        for estimate in (check.scale, check.bias, check.delay):
            assert estimate is None or np.isfinite(estimate).all()


def test_a_short_recording_gives_no_estimate() -> None:
    for n in (0, 1, 10, 60):
        for check in checked({key: x[:n] for key, x in flown().items()}).values():
            assert (check.scale, check.unchecked) == (None, "not enough motion")
