"""Choose the rate signal that fits the attitude best."""

import numpy as np
import pytest

from app.telemetry.mapping.proposal import propose
from tests.support.tables import columns_of, flight, quaternion

ANGLE_OF = {"p": "phi", "r": "psi"}
OTHER_KEYS = ("t", "beta", "Ny", "phi", "psi")
NAMES = {"p": ("roll_rate", "P_RATE_2"), "r": ("yaw_rate", "R_RATE_2")}


def two_rates(key, correlation, *, first, second):
    """A table with a correlated signal named `first` and the true rate named `second`."""
    truth = flight()[key]
    t = flight()["t"]
    slow = np.sin(0.9 * t + 1.0) + 0.7 * np.sin(2.3 * t)  # another quantity, which moves as slowly
    slow *= truth.std() / slow.std() * np.sqrt(1.0 / correlation**2 - 1.0)
    return {name: flight()[name] for name in OTHER_KEYS} | {
        first: truth + slow, second: truth
    }  # fmt: skip


@pytest.mark.parametrize("key", ANGLE_OF)
def test_the_rate_that_the_attitude_follows_is_chosen(key, tmp_path):
    surer, other = NAMES[key]
    proposal = propose(columns_of(tmp_path, two_rates(key, 0.7, first=surer, second=other)))
    assert proposal.mapping.channels[key].signal == other
    assert proposal.alternatives[key] == (surer,)
    reasons = " ".join(proposal.rationales[key].reasons)
    assert f"it follows d({ANGLE_OF[key]})/dt with a correlation of " in reasons
    assert f", {surer} with only 0." in reasons


def test_the_attitude_may_be_a_quaternion(tmp_path):
    table = two_rates("p", 0.7, first="roll_rate", second="P_RATE_2")
    theta = 0.1 + 0.0 * table["t"]
    table |= quaternion(table.pop("phi"), theta, table.pop("psi"))
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["p"].signal == "P_RATE_2"


@pytest.mark.parametrize("key", ANGLE_OF)
def test_a_little_noise_does_not_outweigh_a_name(key, tmp_path):
    surer, other = NAMES[key]
    proposal = propose(columns_of(tmp_path, two_rates(key, 0.97, first=surer, second=other)))
    assert proposal.mapping.channels[key].signal == surer


@pytest.mark.parametrize("derived", ["roll_rate_derived", "ROLL_RATE_CALC", "rollrate_computed"])
def test_a_measured_gyro_is_preferred_to_a_derived_rate(derived, tmp_path):
    proposal = propose(columns_of(tmp_path, two_rates("p", 0.8, first="gyro_x", second=derived)))
    assert proposal.mapping.channels["p"].signal == "gyro_x"
    assert proposal.alternatives["p"] == (derived,)


def test_a_derived_rate_is_used_if_none_was_measured(tmp_path):
    table = two_rates("p", 0.9, first="gyro_x", second="roll_rate_derived")
    del table["gyro_x"]
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["p"].signal == "roll_rate_derived"


@pytest.mark.parametrize("place", ["RATE.", "RATE_", ""])
def test_r_p_and_y_are_rates_of_roll_pitch_and_yaw(place, tmp_path):
    channels = flight()
    axes = {"R": channels["p"], "P": 0.3 * channels["beta"], "Y": channels["r"]}
    table = {name: channels[name] for name in OTHER_KEYS}
    table |= {f"{place}{letter}": rate for letter, rate in axes.items()}
    channels = propose(columns_of(tmp_path, table)).mapping.channels
    assert (channels["p"].signal, channels["r"].signal) == (f"{place}R", f"{place}Y")
    table[f"{place}Q"] = table.pop(f"{place}Y")
    channels = propose(columns_of(tmp_path, table)).mapping.channels
    assert channels["r"].signal == f"{place}R"


def test_a_multiple_of_the_attitude_rate_is_not_the_rate(tmp_path):
    channels = flight()
    table = {name: channels[name] for name in OTHER_KEYS}
    table |= {"roll_rate": 4.66 * channels["p"], "p_mix": 1.03 * channels["p"]}
    units = {"roll_rate": "rad/s", "p_mix": "rad/s", "phi": "rad"}
    proposal = propose(columns_of(tmp_path / "both", table, units=units))
    assert proposal.mapping.channels["p"].signal == "p_mix"
    assert "roll_rate is 4." in " ".join(proposal.rationales["p"].reasons)
    del table["p_mix"]
    rationale = propose(columns_of(tmp_path / "one", table, units=units)).rationales["p"]
    assert rationale.confidence < 0.5
    assert " 4." in " ".join(rationale.reasons)
