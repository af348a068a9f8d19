"""Infer units that neither file nor names give, by physics and other signals."""

import numpy as np
import pytest

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.mapping.proposal import propose
from app.telemetry.mapping.recorded_motion import turn_of
from core.simulation.published import MODELS
from tests.support.tables import columns_of, flight, quaternion

ANGLES = ("beta", "phi", "theta", "psi", "delta_a", "delta_r")
RATES = ("p", "r")
ATTITUDE = ("phi", "theta", "psi")
SURE = 0.9
"""Least confidence that command line and page call "high"."""


def gentle(model="attas_id_16kft", share=0.3):
    """A flight whose motion is a share of the usual one."""
    return {
        key: values if key in ("t", "V", "theta") else share * values
        for key, values in flight(model).items()
    }


def unnamed(channels: dict[str, np.ndarray], *degrees: str) -> dict[str, np.ndarray]:
    """A table whose names give no unit but that of N_y; some channels in degrees."""
    names = {"t": "t_s", "Ny": "ny_g", "V": "tas_mps", "p": "roll_rate", "r": "yaw_rate"}
    return {
        names.get(key, key): np.rad2deg(values) if key in degrees else values
        for key, values in channels.items()
    }


def assert_read_right(columns, proposal, channels):
    for key, trace in apply_mapping(columns, proposal.mapping).channels.items():
        sign = proposal.mapping.channels[key].sign
        np.testing.assert_allclose(sign * trace.values, channels[key], rtol=1e-9, err_msg=key)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("degrees", "lacking"),
    [((*ANGLES, *RATES), ()), ((*ANGLES, *RATES), ATTITUDE), (ANGLES, ())],
    ids=["degrees", "degrees-no-attitude", "angles-in-degrees"],
)
def test_a_gentle_manoeuvre_is_read_in_its_units(model, degrees, lacking, tmp_path):
    channels = {key: x for key, x in gentle(model).items() if key not in lacking}
    columns = columns_of(tmp_path, unnamed(channels, *degrees))
    assert_read_right(columns, propose(columns), channels)


@pytest.mark.parametrize("lacking", [(), ATTITUDE], ids=["attitude", "no-attitude"])
def test_a_gentle_manoeuvre_in_radians_stays_in_radians(lacking, tmp_path):
    channels = {key: x for key, x in gentle().items() if key not in lacking}
    columns = columns_of(tmp_path, unnamed(channels))
    assert_read_right(columns, propose(columns), channels)


def test_two_rates_of_one_group_are_in_one_unit_though_the_angles_are_in_another(tmp_path):
    channels = {key: gentle("f104a_sl_m0p8", 3.0)[key] for key in ("t", "phi", "beta", *RATES)}
    table = unnamed(channels, "phi", "beta")
    table |= {f"{key}_deg": table.pop(key) for key in ("phi", "beta")}
    proposal = propose(columns_of(tmp_path, table))
    assert {proposal.mapping.channels[rate].unit for rate in RATES} == {"rad/s"}


@pytest.mark.parametrize("model", ["f4c_35k_m0p6", "b747_40k_m0p8"])
def test_a_roll_rate_without_a_bank_angle_has_the_unit_of_the_yaw_rate_beside_it(model, tmp_path):
    """The yaw rate's is known by the heading, and differs from that of the angles."""
    keys = ("t", "beta", "Ny", "psi", "delta_a", "delta_r", *RATES)
    channels = {key: gentle(model, 0.7)[key] for key in keys}
    columns = columns_of(tmp_path, unnamed(channels, *RATES))
    assert_read_right(columns, propose(columns), channels)


def test_a_matching_sign_does_not_make_a_unit_certain(tmp_path):
    """Roll, bank, yaw and heading agree in either unit; their magnitudes alone are no proof."""
    keys = ("t", "phi", "psi", "delta_a", *RATES)
    table = unnamed({key: gentle("nt33a_fc1_pa", 0.2)[key] for key in keys}, *ANGLES, *RATES)
    rationales = propose(columns_of(tmp_path, table)).rationales
    assert all(rationales[key].confidence < SURE for key in ("phi", "psi", *RATES))


def test_the_evidence_of_a_unit_is_shown(tmp_path):
    columns = columns_of(tmp_path, unnamed(gentle(), *ANGLES, *RATES))
    reasons = {key: " ".join(r.reasons) for key, r in propose(columns).rationales.items()}
    assert "are taken as deg/s, because then p is 1" in reasons["p"]
    assert "times d(phi)/dt" in reasons["phi"]
    assert "times d(psi)/dt, and d(beta)/dt is" in reasons["r"]
    assert "the side force is 2.6 g per rad of sideslip" in reasons["beta"]
    assert "delta_a makes 6.4 rad/s^2 of d(p)/dt per rad" in reasons["delta_a"]
    table = unnamed({k: x for k, x in gentle().items() if k != "p"}, *ANGLES, *RATES)
    without_roll_rate = propose(columns_of(tmp_path / "few", table)).rationales["delta_a"]
    assert "like the other angles of the file" in " ".join(without_roll_rate.reasons)


@pytest.mark.parametrize("known", [True, False], ids=["rates", "no-rates"])
def test_surfaces_in_hundredths_of_a_degree_are_found_by_their_effect(known, tmp_path):
    """As ArduPilot logs them; an aileron of 75 could be degrees, a rudder of 120 could not."""
    channels = {key: x for key, x in gentle().items() if known or key not in RATES}
    channels |= {key: 100.0 * channels[key] for key in ("delta_a", "delta_r")}
    proposal = propose(columns_of(tmp_path, unnamed(channels, *ANGLES, *RATES)))
    units = {key: proposal.mapping.channels[key].unit for key in ("delta_a", "delta_r")}
    assert units == {"delta_a": "cdeg" if known else "deg", "delta_r": "cdeg"}
    if not known:
        reasons = {key: " ".join(proposal.rationales[key].reasons) for key in units}
        assert "rare for aileron: check the unit" in reasons["delta_a"]
        assert "this may not be an angle: check" in reasons["delta_r"]
        assert all(proposal.rationales[key].confidence < SURE - 0.1 for key in units)


@pytest.mark.parametrize(
    ("key", "name"), [("p", "p_degps"), ("r", "r_degps"), ("phi", "phi_deg"), ("psi", "psi_deg")]
)
def test_a_given_unit_that_the_motion_contradicts_is_never_sure(key, name, tmp_path):
    table = unnamed(flight()) | {name: flight()[key]}
    for given in ("phi", "psi", "roll_rate", "yaw_rate"):
        if given == {"p": "roll_rate", "r": "yaw_rate"}.get(key, key):
            del table[given]
        else:
            unit = "rad" if given in ("phi", "psi") else "radps"
            table[f"{given}_{unit}"] = table.pop(given)
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels[key].signal == name
    assert proposal.rationales[key].confidence < 0.6
    assert "the unit of one of them is wrong" in " ".join(proposal.rationales[key].reasons)


def of_quaternion(**channels):
    """A table of topics: rates, and the attitude as a quaternion alone."""
    motion = gentle()
    table = {"attitude//t_a": motion["t"], "gyro//t_g": motion["t"]}
    attitude = quaternion(*(motion[key] for key in ATTITUDE))
    table |= {f"attitude//q[{key[1]}]": values for key, values in attitude.items()}
    return table | {f"gyro//{name}": values for name, values in channels.items()}


@pytest.mark.parametrize("in_degrees", [False, True], ids=["rad/s", "deg/s"])
def test_the_quaternion_gives_the_unit_of_the_rates(in_degrees, tmp_path):
    turn = np.rad2deg if in_degrees else np.positive
    table = of_quaternion(**{f"{rate}_rate": turn(gentle()[rate]) for rate in RATES})
    proposal = propose(columns_of(tmp_path, table, times={"attitude": "t_a", "gyro": "t_g"}))
    units = {proposal.mapping.channels[rate].unit for rate in RATES}
    assert units == {"deg/s" if in_degrees else "rad/s"}
    assert "because then p is 1.01 times d(phi)/dt" in " ".join(proposal.rationales["p"].reasons)


def test_a_given_unit_that_the_quaternion_contradicts_is_never_sure(tmp_path):
    table = of_quaternion(p_degps=gentle()["p"], r_radps=gentle()["r"])
    proposal = propose(columns_of(tmp_path, table, times={"attitude": "t_a", "gyro": "t_g"}))
    assert proposal.mapping.channels["p"] == ChannelSource("p_degps", "deg/s")
    assert proposal.rationales["p"].confidence < 0.6
    assert proposal.rationales["r"].confidence > SURE - 0.1


def test_a_confirmed_unit_that_the_motion_contradicts_is_never_sure(tmp_path):
    known = Mapping({"p": ChannelSource("roll_rate", "deg/s")}, {"": TimeSource("t_s")})
    table = unnamed(flight())
    table["phi_rad"] = table.pop("phi")
    proposal = propose(columns_of(tmp_path, table), known)
    assert proposal.mapping.channels["p"] == ChannelSource("roll_rate", "deg/s")
    assert proposal.rationales["p"].confidence < SURE


@pytest.mark.parametrize(("unit", "per_g"), [("g", 1.0), ("m/s^2", 9.80665), ("ft/s^2", 32.174)])
@pytest.mark.parametrize("normal", ["NZ", "NZ_NORMAL_ACCEL", "accel_z"])
def test_the_normal_acceleration_at_1_g_gives_the_unit_of_the_lateral_one(
    unit, per_g, normal, tmp_path
):
    channels = gentle(share=0.6)
    table = unnamed(channels) | {normal: per_g * (1.0 + 0.02 * np.sin(channels["t"]))}
    table["accel_y"] = per_g * table.pop("ny_g")
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["Ny"].unit == unit
    assert f"{normal} in its group is at 1 g" in " ".join(proposal.rationales["Ny"].reasons)


def test_the_given_unit_of_the_normal_acceleration_is_that_of_the_lateral_one(tmp_path):
    table = unnamed(gentle()) | {"nz_ftps2": np.full(len(flight()["t"]), 40.0)}
    table["ny"] = 32.174 * table.pop("ny_g")
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["Ny"].unit == "ft/s^2"


@pytest.mark.parametrize(("unit", "per_mps"), [("m/s", 1.0), ("kt", 1.94384), ("ft/s", 3.28084)])
def test_the_mach_number_gives_the_unit_of_the_airspeed(unit, per_mps, tmp_path):
    table = unnamed(flight()) | {"Mach": flight()["V"] / 320.0}
    table["true_airspeed"] = per_mps * table.pop("tas_mps")
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["V"].unit == unit
    assert "over Mach is 320 m/s" in " ".join(proposal.rationales["V"].reasons)
    assert proposal.rationales["V"].confidence > 0.8


@pytest.mark.parametrize(("unit", "per_mps"), [("m/s", 1.0), ("kt", 1.94384), ("ft/s", 3.28084)])
@pytest.mark.parametrize(
    ("ny", "per_g"), [("ny_g", 1.0), ("ny", 32.174)], ids=["g-given", "ft/s^2-not-given"]
)
def test_side_force_and_bank_give_the_unit_of_the_airspeed(unit, per_mps, ny, per_g, tmp_path):
    """Of a flight of 131 m/s, which is usual in m/s and in kt."""
    table = unnamed(gentle(), *ANGLES, *RATES)
    table["true_airspeed"] = per_mps * table.pop("tas_mps")
    table[ny] = per_g * table.pop("ny_g")
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["V"].unit == unit
    assert "g/V per rad of bank" in " ".join(proposal.rationales["V"].reasons)
    assert proposal.mapping.channels["Ny"].unit == ("g" if per_g == 1.0 else "ft/s^2")


@pytest.mark.parametrize(("turn", "unit"), [(360.0, "deg"), (2.0 * np.pi, "rad")])
def test_a_heading_that_jumps_by_a_full_turn_gives_its_unit(turn, unit):
    assert turn_of(np.linspace(0.9, 1.2, 500) % 1.0 * turn) == unit
    assert turn_of(np.linspace(0.2, 0.8, 500) * turn) == ""


def test_a_heading_through_north_is_unwrapped_in_its_own_unit(tmp_path):
    channels = gentle()
    channels["psi"] = np.mod(channels["psi"] + 1e-3, 2.0 * np.pi)
    columns = columns_of(tmp_path, unnamed(channels, *ANGLES, *RATES))
    assert np.abs(np.diff(channels["psi"])).max() > 6.0
    proposal = propose(columns)
    assert_read_right(columns, proposal, channels)
    assert "psi jumps by 6.28 rad, a full turn" in " ".join(proposal.rationales["psi"].reasons)


def test_one_recorder_writes_all_its_lengths_in_feet(tmp_path):
    """Airspeed, altitude and lateral acceleration, of which N_z alone tells the unit."""
    channels = flight("f104a_sl_m0p8")
    t = channels["t"]
    table = unnamed({key: channels[key] for key in ("t", "beta", "phi", *RATES)})
    table |= {
        "NY_LATERAL_ACCEL": 32.174 * channels["Ny"],
        "NZ_NORMAL_ACCEL": 32.174 * (1.0 + 0.05 * np.sin(t)),
        "TAS": channels["V"] / 0.3048,
        "HP": 5000.0 + 10.0 * np.sin(t),
    }
    units = {k: s.unit for k, s in propose(columns_of(tmp_path, table)).mapping.channels.items()}
    assert (units["Ny"], units["V"], units["h"]) == ("ft/s^2", "ft/s", "ft")
