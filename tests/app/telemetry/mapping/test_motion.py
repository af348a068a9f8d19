"""Check a mapping against the motion: signs, gravity, biases."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import ChannelSource
from app.telemetry.mapping.motion import LONG, motion, sideslip_balance
from app.telemetry.mapping.proposal import propose
from app.telemetry.mapping.signs import CONVENTION, find_signs
from app.telemetry.recording import Trace, Traces
from core.channels import KEYS
from core.simulation.aircraft import PublishedAircraft
from core.simulation.attitude import SurfaceSigns, surface_signs
from core.simulation.published import MODELS
from tests.support.repetition import examples
from tests.support.tables import columns_of, flight

MEASURED = (*KEYS, "phi", "theta", "psi", "V")
UNVERIFIED = "cannot be verified"


def traces_of(channels):
    t = channels["t"]
    return Traces({key: Trace(t, channels[key]) for key in channels if key != "t"})


def moves_of(channels):
    result = motion(traces_of(channels))
    assert result is not None
    return result


def proposed(folder, channels, **how):
    units = {"p": "rad/s", "r": "rad/s", "Ny": "g", "V": "m/s", "t": "s"}
    mapped_units = {key: units.get(key, "rad") for key in channels}
    columns = columns_of(folder, channels, units=mapped_units)
    return columns, propose(columns, **how)


def signs_of(proposal):
    return {key: source.sign for key, source in proposal.mapping.channels.items()}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("reversed_", [*KEYS, "all"])
def test_a_reversed_channel_is_found_on_every_published_aircraft(model, reversed_, tmp_path):
    channels = flight(model)
    keys = KEYS if reversed_ == "all" else (reversed_,)
    channels = channels | {key: -channels[key] for key in keys}
    expected = surface_signs(PublishedAircraft(model, n_states=4).uncertain_plant())
    _, proposal = proposed(tmp_path, channels, expected=expected)
    for key in KEYS:
        verified = UNVERIFIED not in proposal.rationales[key].reasons[-1]
        # the 747 only rolls by 0.8 deg/s
        assert verified or (key, model) == ("delta_a", "b747_40k_m0p8"), key
        if verified:
            assert signs_of(proposal)[key] == (-1 if key in keys else 1), key


@pytest.mark.parametrize("model", [name for name in MODELS if not name.startswith("b747")])
@pytest.mark.parametrize("reversed_", [("phi",), ("p", "delta_a")])
def test_only_a_bank_angle_that_contradicts_all_others_is_reversed(model, reversed_):
    """By the sideslip, where roll rate and aileron are reversed. The 747 barely rolls."""
    channels = flight(model) | {key: -flight(model)[key] for key in reversed_}
    expected = surface_signs(PublishedAircraft(model, n_states=4).uncertain_plant())
    signs = find_signs(moves_of(channels), expected)
    assert {key for key, evidence in signs.items() if evidence.sign < 0} == set(reversed_)


def test_numbers_beyond_any_motion_balance_nothing():
    channels = flight() | {key: 1e200 * flight()[key] for key in ("beta", "r")}
    assert sideslip_balance(moves_of(flight())).keys() == {"r", "Ny", "phi", "p"}
    assert sideslip_balance(moves_of(channels)) == {}


def test_a_reversed_bank_angle_is_proposed_reversed(tmp_path):
    channels = {key: x for key, x in flight().items() if key != "psi"}
    _, proposal = proposed(tmp_path, channels | {"phi": -channels["phi"]})
    assert {key for key, sign in signs_of(proposal).items() if sign < 0} == {"phi"}
    assert "with the attitude once the bank is reversed" in proposal.rationales["p"].reasons[-1]


@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from([*MODELS]),
    st.sampled_from([("psi",), ("phi", "theta", "psi"), ("beta",), ("beta", "phi", "psi", "V")]),
    st.lists(st.sampled_from(["beta", "Ny", "delta_a", "delta_r"]), max_size=2, unique=True),
)
def test_signs_found_from_fewer_channels_are_never_wrong(model, lacking, reversed_):
    channels = flight(model) | {key: -flight(model)[key] for key in reversed_}
    moves = moves_of({key: channels[key] for key in channels if key not in lacking})
    expected = surface_signs(PublishedAircraft(model, n_states=4).uncertain_plant())
    for key, evidence in find_signs(moves, expected).items():
        if evidence.proven:
            assert evidence.sign == (-1 if key in reversed_ else 1), (key, evidence.text)


def test_rates_follow_the_attitude_one_to_one():
    result = find_signs(moves_of(flight()))
    for key in ("p", "r"):
        assert result[key].sign == 1
        assert result[key].times == 1.0
        assert "agrees with the attitude: +1.0" in result[key].text


@pytest.mark.parametrize(("key", "angle"), [("p", "phi"), ("r", "psi")])
@pytest.mark.parametrize("which", [0, 1])
def test_a_rate_in_other_units_than_its_angle_is_noticed(key, angle, which):
    wrong = (key, angle)[which]
    result = find_signs(moves_of(flight() | {wrong: np.rad2deg(flight()[wrong])}))
    ratio = result[key].times if which == 0 else 1.0 / result[key].times
    assert ratio == pytest.approx(57.3, rel=0.1)


def test_units_that_contradict_each_other_are_suspect_and_not_changed(tmp_path):
    _, proposal = proposed(tmp_path, flight() | {"p": np.rad2deg(flight()["p"])})
    assert proposal.mapping.channels["p"] == ChannelSource("p", "rad/s")
    for key in ("p", "phi"):
        assert "the unit of one of them is wrong" in " ".join(proposal.rationales[key].reasons)
        assert proposal.rationales[key].confidence < 0.8


@pytest.mark.parametrize("aileron", [1, -1])
def test_the_aileron_is_compared_with_the_aircraft_at_hand(aileron, tmp_path):
    _, proposal = proposed(tmp_path, flight(), expected=SurfaceSigns(aileron, -1))
    assert signs_of(proposal)["delta_a"] == -aileron  # the ATTAS rolls left


def test_without_an_aircraft_positive_surfaces_turn_left():
    assert SurfaceSigns(-1, -1) == CONVENTION
    f16 = surface_signs(PublishedAircraft("f16_sl_h0_v502").uncertain_plant())
    assert f16 == CONVENTION


def test_sideslip_side_force_and_rudder_against_the_yaw_rate_mean_that_it_is_reversed():
    channels = {key: x for key, x in flight().items() if key != "psi"}
    result = find_signs(moves_of(channels | {"r": -channels["r"]}))
    assert {key for key, evidence in result.items() if evidence.sign < 0} == {"r"}


def test_a_still_aircraft_or_a_slow_recorder_shows_no_signs(tmp_path):
    still = {key: x if key == "t" else np.full(len(x), x[0]) for key, x in flight().items()}
    assert find_signs(moves_of(still)) == {}
    slow = {key: x[::16] for key, x in flight().items()}
    moves = motion(traces_of(slow))
    assert moves is None or find_signs(moves) == {}


@settings(max_examples=examples(20))
@given(st.integers(0, 2**32 - 1))
def test_noise_alone_proves_nothing(seed):
    rng = np.random.default_rng(seed)
    t = flight()["t"]
    noise = {key: 0.02 * rng.standard_normal(len(t)) for key in (*KEYS, "phi", "psi")}
    moves = moves_of({"t": t, **noise})
    assert find_signs(moves) == {}


def test_a_long_recording_is_judged_by_its_most_active_part():
    short = flight(dt=0.05)
    n = int(3 * LONG / 0.05)
    rng = np.random.default_rng(1)
    long = {key: 1e-4 * rng.standard_normal(n) for key in MEASURED} | {"t": 0.05 * np.arange(n)}
    for key in MEASURED:
        long[key][5000 : 5000 + len(short["t"])] += short[key]
    result = find_signs(moves_of(long | {"delta_r": -long["delta_r"]}))
    assert result["delta_r"].sign == -1
    assert result["beta"].sign == result["Ny"].sign == result["delta_a"].sign == 1


def test_channels_of_several_rates_are_compared():
    channels = traces_of(flight()).channels
    for stride, key in enumerate(KEYS, start=1):
        trace = channels[key]
        channels[key] = Trace(trace.t[::stride], trace.values[::stride])
    result = motion(Traces(channels))
    assert result is not None
    assert {key for key, evidence in find_signs(result).items() if evidence.proven} == set(KEYS)


@pytest.mark.parametrize("sign", [1, -1])
def test_gravity_in_a_lateral_acceleration_is_found_and_removed(sign, tmp_path):
    channels = flight("f104a_sl_m0p8")
    gravity = np.sin(channels["phi"]) * np.cos(channels["theta"])
    held = sign * (channels["Ny"] + gravity)
    columns, proposal = proposed(tmp_path, channels | {"Ny": held})
    assert proposal.mapping.channels["Ny"] == ChannelSource(derivation="Ny_without_gravity")
    assert proposal.mapping.channels["Ay"] == ChannelSource("Ny", "g", sign=sign)
    assert "Ny contains gravity: it follows +1" in proposal.rationales["Ny"].reasons[0]
    assert proposal.rationales["Ny"].confidence < proposal.rationales["beta"].confidence
    trace = apply_mapping(columns, proposal.mapping).channels["Ny"]
    assert trace.derived
    np.testing.assert_allclose(trace.values, channels["Ny"], atol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_specific_force_is_not_changed(model, tmp_path):
    _, proposal = proposed(tmp_path, flight(model))
    assert proposal.mapping.channels["Ny"] == ChannelSource("Ny", "g")
    assert "Ay" not in proposal.mapping.channels


def test_a_bias_in_the_quiet_first_seconds_is_proposed_with_its_reason(tmp_path):
    columns, proposal = proposed(tmp_path, flight() | {"Ny": flight()["Ny"] + 0.08})
    bias = proposal.mapping.channels["Ny"].bias
    assert bias == pytest.approx(0.08, abs=0.001)
    assert proposal.rationales["Ny"].reasons[-1] == (
        "removed a constant bias: its first 2 s have a mean of 0.0799 g and a standard deviation "
        "of 0.0022 g"
    )
    trace = apply_mapping(columns, proposal.mapping).channels["Ny"]
    np.testing.assert_allclose(trace.values, flight()["Ny"] + 0.08 - bias)


def test_a_bias_as_large_as_gravity_is_suspect(tmp_path):
    _, proposal = proposed(tmp_path, flight() | {"Ny": flight()["Ny"] + 1.0})
    text = proposal.rationales["Ny"].reasons[-1]
    assert "as large as gravity: check for a normal acceleration" in text
    assert proposal.rationales["Ny"].confidence < 0.5


@pytest.mark.parametrize("reversed_", [(), ("delta_r",), ("delta_a", "delta_r")])
def test_surfaces_are_judged_by_the_segments_in_which_they_turn_the_aircraft(reversed_, tmp_path):
    channels = flight()
    dt = channels["t"][1]
    check = np.arange(0.0, 40.0, dt)  # controls moved on the ground
    ground = {key: np.full(len(check), x[0]) for key, x in channels.items()}
    ground["delta_a"] = 0.4 * np.sin(1.3 * check)
    ground["delta_r"] = 0.3 * np.sin(0.9 * check)
    rng = np.random.default_rng(4)
    ground |= {k: ground[k] + 1e-3 * rng.standard_normal(len(check)) for k in ("p", "r", "beta")}
    channels = {key: np.concatenate([ground[key], x]) for key, x in channels.items()}
    channels["t"] = dt * np.arange(len(channels["t"]))
    channels |= {key: -channels[key] for key in reversed_}
    _, proposal = proposed(tmp_path, channels)
    for key in ("delta_a", "delta_r"):
        assert signs_of(proposal)[key] == (-1 if key in reversed_ else 1)
        assert "segments in which it moves" in " ".join(proposal.rationales[key].reasons)


@pytest.mark.parametrize("stability", [0.015, -0.015])
def test_a_stability_that_no_aircraft_has_shows_no_sign(stability):
    t = flight()["t"]
    beta = 0.3 * np.sin(0.9 * t) * np.sin(0.1 * t)
    r = stability * np.cumsum(beta) * (t[1] - t[0])
    assert "beta" not in find_signs(moves_of({"t": t, "beta": beta, "r": r}))
    assert find_signs(moves_of({"t": t, "beta": beta, "r": 100.0 * r}))["beta"].sign * stability > 0


@pytest.mark.parametrize("start", ["trim", "moving"])
def test_a_side_force_in_trim_or_in_motion_is_not_a_bias(start, tmp_path):
    channels = flight()
    if start == "trim":
        channels = channels | {"Ny": channels["Ny"] + 0.012}
    else:
        channels = {key: x[180:] for key, x in channels.items()}
    _, proposal = proposed(tmp_path, channels)
    assert proposal.mapping.channels["Ny"].bias == 0.0


@pytest.mark.parametrize("alike", [1, -1])
def test_two_ailerons_become_one_with_any_sign_convention(alike, tmp_path):
    channels = {key: x for key, x in flight().items() if key != "delta_a"}
    down = flight()["delta_a"]
    channels |= {"aileron_right": down, "aileron_left": alike * down}
    columns, proposal = proposed(tmp_path, channels)
    assert proposal.mapping.channels["delta_a"].derivation == "delta_a_of_both"
    assert proposal.mapping.channels["delta_a_left"].sign == -alike
    trace = apply_mapping(columns, proposal.mapping).channels["delta_a"]
    np.testing.assert_allclose(trace.values, down)


@pytest.mark.parametrize(
    ("key", "names", "right_share"), [("delta_a", "RL", -1.0), ("delta_r", "LR", 1.0)]
)
def test_two_surfaces_by_their_short_names_become_one(key, names, right_share, tmp_path):
    channels = {name: x for name, x in flight().items() if name != key}
    first, second = (f"D{key[-1].upper()}{side}" for side in names)
    channels |= {first: flight()[key] + 0.01, second: right_share * (flight()[key] - 0.01)}
    columns, proposal = proposed(tmp_path, channels)
    assert proposal.mapping.channels[key].derivation == f"{key}_of_both"
    trace = apply_mapping(columns, proposal.mapping).channels[key]
    np.testing.assert_allclose(trace.values, flight()[key], atol=1e-12)
    assert "left" in DERIVATIONS[f"{key}_of_both"].title.rpartition("positive ")[2]


@pytest.mark.parametrize("key", ["delta_a", "delta_r"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_one_side_is_used_for_both_if_the_other_was_not_recorded(key, side, tmp_path):
    channels = {name: x for name, x in flight().items() if name != key}
    channels[f"{'aileron' if key == 'delta_a' else 'rudder'}_{side}"] = flight()[key]
    columns, proposal = proposed(tmp_path, channels)
    assert proposal.mapping.channels[key].derivation == f"{key}_of_{side}"
    trace = apply_mapping(columns, proposal.mapping).channels[key]
    np.testing.assert_allclose(trace.values, flight()[key])  # the motion shows its sign


def test_rates_derived_from_the_attitude_are_not_proven_by_it(tmp_path):
    channels = {key: x for key, x in flight().items() if key not in ("p", "r")}
    _, proposal = proposed(tmp_path, channels)
    for key in ("p", "r"):
        assert len(proposal.rationales[key].reasons) == 1
        assert proposal.rationales[key].confidence < 0.7
