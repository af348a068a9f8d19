"""The whole proposal: mapped signals, confidence and reasons."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.recordings.answers import channel_bands
from app.telemetry.contents import open_columns
from app.telemetry.mapping.applying import applicable, apply_mapping
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.mapping.proposal import propose
from app.telemetry.scaling import Scaling
from app.telemetry.units import factor
from core.channels import KEYS
from tests.support.places import RECORDS
from tests.support.repetition import examples
from tests.support.tables import columns_of, flight

PLAIN = {
    "t": "t_s", "beta": "beta_rad", "p": "p_radps", "r": "r_radps", "Ny": "ay_g",
    "delta_a": "da_rad", "delta_r": "dr_rad", "phi": "phi_rad", "theta": "theta_rad",
    "psi": "psi_rad", "V": "V_mps",
}  # fmt: skip
# key -> (name, unit in the file, unit it is recorded in)
WAYS: dict[str, list[tuple[str, str, str]]] = {
    "t": [("t_s", "", "s"), ("Time", "ms", "ms"), ("timestamp_us", "", "us"), ("IRIG", "", "s")],
    "beta": [("beta_rad", "", "rad"), ("AOSS", "°", "deg"), ("SideSlip_deg", "", "deg")],
    "p": [("p_radps", "", "rad/s"), ("ROLLRATE", "DEG/S", "deg/s"), ("gyro_x", "dps", "deg/s")],
    "r": [("r_radps", "", "rad/s"), ("YawRate [deg/s]", "", "deg/s")],
    "Ny": [("ay_g", "", "g"), ("lat_acc", "m/s²", "m/s^2"), ("NY_CG", "ft/s2", "ft/s^2")],
    "delta_a": [("da_rad", "", "rad"), ("AIL_POS", "deg", "deg")],
    "delta_r": [("dr_rad", "", "rad"), ("Seitenruder", "Grad", "deg"), ("rudder_deg", "", "deg")],
    "phi": [("phi_rad", "", "rad"), ("Bank (deg)", "", "deg")],
    "theta": [("theta_rad", "", "rad"), ("Pitch", "deg", "deg")],
    "psi": [("psi_rad", "", "rad"), ("heading", "deg", "deg")],
    "V": [("V_mps", "", "m/s"), ("KTAS", "", "kt"), ("true_airspeed", "ft/s", "ft/s")],
}
SIGNED = (*KEYS,)
DECOYS = {
    "pressure": 101325.0, "rpm": 5000.0, "temperature": 15.0, "rudder_trim_cmd": 0.1,
    "roll_cmd": 0.3, "p_static_pa": 9e4, "alpha_rad": 0.05, "latitude": 52.0, "q_radps": 0.05,
}  # fmt: skip


def record(name):
    path = RECORDS / name
    if not path.exists():
        pytest.skip(f"the flight records are not in {RECORDS}")
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {column: table[column] for column in table.dtype.names or ()}


def plain_table(**changes):
    return {PLAIN[key]: values for key, values in (flight() | changes).items()}


@pytest.mark.parametrize("name", ["attas_ail1.csv", "attas_rud1.csv"])
def test_the_attas_records_are_mapped_in_full_and_with_confidence(name, tmp_path):
    table = record(name)
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.missing == ()
    channels = proposal.mapping.channels
    assert {key: source.signal for key, source in channels.items()} == {
        key: PLAIN[key] for key in PLAIN if key not in ("t", "psi")
    }
    assert all(source == ChannelSource(source.signal, source.unit) for source in channels.values())
    assert proposal.mapping.times == {"": TimeSource("t_s", "s")}
    assert all(proposal.rationales[key].confidence >= 0.85 for key in (*channels, "t:"))
    traces = apply_mapping(open_columns(tmp_path), proposal.mapping)
    np.testing.assert_array_equal(traces.channels["Ny"].values, table["ay_g"])
    assert traces.notes == ()


@pytest.mark.parametrize(
    "name", ["citation_20190312_dutchroll.csv", "citation_20190312_dutchroll_yd.csv"]
)
def test_the_citation_records_lack_sideslip_and_have_reversed_surfaces(name, tmp_path):
    proposal = propose(columns_of(tmp_path, record(name)))
    assert proposal.missing == ("beta",)
    reasons = " ".join(proposal.rationales["beta"].reasons)
    assert "the name beta_rad suggests sideslip, but all its" in reasons
    assert "can be derived from v and V" in reasons
    signs = {key: source.sign for key, source in proposal.mapping.channels.items()}
    assert signs == {"p": 1, "r": 1, "Ny": 1, "delta_a": -1, "delta_r": -1, "phi": 1, "theta": 1,
                     "V": 1}  # fmt: skip
    rudder, aileron = (proposal.rationales[key] for key in ("delta_r", "delta_a"))
    assert "positive rudder yaws the nose right here" in rudder.reasons[-1]
    assert "reversed like the rudder" in aileron.reasons[-1]
    assert rudder.confidence > 0.85
    assert 0.4 < aileron.confidence < 0.7


@settings(max_examples=examples(40), suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_names_units_signs_and_order_of_the_columns_change_nothing(tmp_path_factory, data):
    units, table, truth = {}, {}, flight()
    for key in data.draw(st.permutations(list(truth))):
        name, unit, recorded = data.draw(st.sampled_from(WAYS[key]))
        target = {"t": "s", "V": "m/s", "p": "rad/s", "r": "rad/s", "Ny": "g"}.get(key, "rad")
        sign = data.draw(st.sampled_from((1, -1))) if key in SIGNED else 1
        table[name] = sign * truth[key] / factor(recorded, target)
        units[name] = unit
    columns = columns_of(tmp_path_factory.mktemp("ways"), table, units=units)
    proposal = propose(columns)
    traces = apply_mapping(columns, proposal.mapping)
    assert set(traces.channels) == set(truth) - {"t"}
    for key, trace in traces.channels.items():
        assert not trace.derived
        np.testing.assert_allclose(trace.t, truth["t"], rtol=1e-12)
        np.testing.assert_allclose(trace.values, truth[key], rtol=1e-12, atol=1e-15)
        assert proposal.rationales[key].confidence > 0.75


@pytest.mark.parametrize("degrees", [False, True], ids=["radians", "degrees"])
@pytest.mark.parametrize("metric", [False, True], ids=["g", "m/s2"])
def test_units_that_are_not_given_are_inferred_from_the_numbers_and_named_so(
    degrees, metric, tmp_path
):
    names = {key: key for key in flight()} | {
        "t": "time", "Ny": "lat_acc", "delta_a": "aileron", "delta_r": "rudder"
    }  # fmt: skip
    table = {}
    for key, values in flight().items():
        turned = np.rad2deg(values) if degrees and key not in ("t", "Ny", "V") else values
        table[names[key]] = 9.80665 * turned if metric and key == "Ny" else turned
    columns = columns_of(tmp_path, table)
    proposal = propose(columns)
    for key, trace in apply_mapping(columns, proposal.mapping).channels.items():
        np.testing.assert_allclose(trace.values, flight()[key], rtol=1e-12, err_msg=key)
        assert any(
            "unit not given: values up to" in reason for reason in proposal.rationales[key].reasons
        )
    # 131 could be knots, were it not for the balance of sideslip
    assert 0.5 < proposal.rationales["V"].confidence < 0.8


def test_a_sideslip_that_reaches_8_is_in_degrees(tmp_path):
    table = plain_table()
    table["beta"] = table.pop("beta_rad") * 8.0 / np.abs(flight()["beta"]).max()
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["beta"].unit == "deg"
    assert any("are taken as deg" in reason for reason in proposal.rationales["beta"].reasons)


def test_a_unit_with_implausible_values_is_not_used(tmp_path):
    table = plain_table(beta=100.0 * flight()["beta"])
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels["beta"].unit == "deg"
    assert proposal.rationales["beta"].confidence < 0.8
    assert "are implausible: taken as deg" in " ".join(proposal.rationales["beta"].reasons)


def test_an_inferred_unit_of_a_rate_is_checked_against_the_attitude(tmp_path):
    table = plain_table()
    table["roll_rate"] = 0.03 * table.pop("p_radps") / np.abs(flight()["p"]).max()
    table["phi_rad"] = 0.03 * table["phi_rad"] / np.abs(flight()["p"]).max() / 57.29578
    columns = columns_of(tmp_path, table)
    proposal = propose(columns)
    assert proposal.mapping.channels["p"].unit == "deg/s"
    reasons = " ".join(proposal.rationales["p"].reasons)
    assert "taken as deg/s, because then p is 1.01 times d(phi)/dt" in reasons


@pytest.mark.parametrize("name", DECOYS)
def test_a_decoy_changes_no_channel(name, tmp_path):
    table = plain_table()
    before = propose(columns_of(_folder(tmp_path, "before"), table))
    noise = np.random.default_rng(5).standard_normal(len(table["t_s"]))
    after = propose(columns_of(_folder(tmp_path, "after"), {name: DECOYS[name] * (1 + 0.01 * noise)}
                               | table))  # fmt: skip
    assert after == before


def _folder(path, name):
    (path / name).mkdir()
    return path / name


@pytest.mark.parametrize("key", KEYS)
def test_a_decoy_does_not_replace_a_missing_channel(key, tmp_path):
    table = plain_table()
    del table[PLAIN[key]]
    table = {"phi_rad": table["phi_rad"], "t_s": table["t_s"]} | {
        name: level * np.cos(table["t_s"]) for name, level in DECOYS.items()
    }
    proposal = propose(columns_of(tmp_path, table))
    assert key in proposal.missing or proposal.mapping.channels[key].derivation
    assert set(proposal.mapping.channels) == {"phi", "p"}


@pytest.mark.parametrize("key", ["beta", "p", "r", "Ny"])
@pytest.mark.parametrize("value", [0.0, 0.3, np.nan], ids=["zero", "constant", "empty"])
def test_a_constant_or_empty_signal_is_not_a_moving_channel(key, value, tmp_path):
    table = plain_table(**{key: np.full(len(flight()["t"]), value)})
    for angle in ("phi_rad", "psi_rad"):
        del table[angle]
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.missing == (key,)
    assert PLAIN[key] in proposal.rationales[key].reasons[0]
    assert proposal.rationales[key].confidence == 0.0


@pytest.mark.parametrize("key", ["delta_a", "delta_r"])
def test_a_surface_may_be_constant(key, tmp_path):
    table = plain_table(**{key: np.zeros(len(flight()["t"]))})
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.channels[key] == ChannelSource(PLAIN[key], "rad")
    assert "sign cannot be verified" in proposal.rationales[key].reasons[-1]


def test_few_rows_are_not_called_dead(tmp_path):
    table = {name: values[:2] * 0.0 + (name == "t_s") * np.arange(2) for name, values in
             plain_table().items()}  # fmt: skip
    assert propose(columns_of(tmp_path, table)).missing == ()


def test_each_signal_is_given_once_and_the_others_are_alternatives(tmp_path):
    table = plain_table() | {"beta_raw_rad": flight()["beta"], "p_2_radps": flight()["p"]}
    proposal = propose(columns_of(tmp_path, table))
    signals = [source.signal for source in proposal.mapping.channels.values()]
    assert len(signals) == len(set(signals))
    assert proposal.mapping.channels["beta"].signal == "beta_rad"
    assert proposal.alternatives["beta"] == ("beta_raw_rad",)
    assert "beta_raw_rad would also fit" in proposal.rationales["beta"].reasons


def test_airspeed_and_lateral_velocity_with_one_letter_are_distinguished(tmp_path):
    table = plain_table()
    table["V"] = table.pop("V_mps")
    table["v"] = table["V"] * np.sin(flight()["beta"])
    del table["beta_rad"]
    columns = columns_of(tmp_path, table, units={"V": "m/s", "v": "m/s"})
    proposal = propose(columns)
    assert proposal.mapping.channels["V"].signal == "V"
    assert proposal.mapping.channels["v"].signal == "v"
    assert proposal.mapping.channels["beta"] == ChannelSource(derivation="beta_from_velocity")
    assert proposal.rationales["beta"].confidence < proposal.rationales["v"].confidence
    trace = apply_mapping(columns, proposal.mapping).channels["beta"]
    assert trace.derived
    np.testing.assert_allclose(trace.values, flight()["beta"], rtol=1e-12, atol=1e-15)


def test_a_missing_channel_lists_its_possible_derivations(tmp_path):
    table = {PLAIN[key]: flight()[key] for key in ("t", "beta", "Ny")}
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.missing == ("p", "r", "delta_a", "delta_r")
    assert "can be derived from phi" in " ".join(proposal.rationales["p"].reasons)
    assert "can be derived from psi" in " ".join(proposal.rationales["r"].reasons)


def test_derivations_are_offered_beside_measured_channels(tmp_path):
    proposal = propose(columns_of(tmp_path, plain_table()))
    assert proposal.derivable == {"p": ("p_from_attitude",), "r": ("r_from_attitude",)}
    assert not any(source.derivation for source in proposal.mapping.channels.values())


@pytest.fixture
def confirmed():
    return Mapping(
        {
            "beta": ChannelSource("left_vane", "deg", sign=-1, bias=0.01),
            "delta_r": ChannelSource("dr_rad", "rad", sign=-1),
            "Ny": ChannelSource(derivation="Ny_without_gravity"),
            "Ay": ChannelSource("inertial", "m/s^2"),
            "phi": ChannelSource("phi_rad", "rad"),
        },
        {"": TimeSource("t_s", "s")},
    )


def test_a_confirmed_mapping_applies_where_its_signals_exist(confirmed, tmp_path):
    table = plain_table() | {"left_vane": -np.rad2deg(flight()["beta"]), "inertial": flight()["Ny"]}
    proposal = propose(columns_of(tmp_path, table), confirmed, aircraft="PH-LAB")
    assert confirmed.channels.items() <= proposal.mapping.channels.items()
    assert proposal.mapping.channels["r"] == ChannelSource("r_radps", "rad/s")
    for key in confirmed.channels:
        assert "as confirmed for PH-LAB" in proposal.rationales[key].reasons[0]
    # the motion contradicts what was confirmed; it is commented on, not changed
    assert "according to the motion it is reversed" in proposal.rationales["delta_r"].reasons[-1]
    assert proposal.rationales["delta_r"].confidence < 0.7 < proposal.rationales["beta"].confidence


def test_channels_missing_from_a_confirmed_mapping_are_proposed(confirmed, tmp_path):
    proposal = propose(columns_of(tmp_path, plain_table()), confirmed)
    assert proposal.mapping.channels["beta"] == ChannelSource("beta_rad", "rad")
    assert proposal.mapping.channels["Ny"] == ChannelSource("ay_g", "g")
    assert proposal.mapping.channels["delta_r"].sign == -1
    assert "Ay" not in proposal.mapping.channels
    assert "the file has no signal inertial" in proposal.rationales["Ay"].reasons[0]


def test_a_unit_that_changed_since_it_was_confirmed_is_suspect(tmp_path):
    known = Mapping({"beta": ChannelSource("beta", "rad")}, {"": TimeSource("t_s", "s")})
    table = plain_table()
    table["beta"] = table.pop("beta_rad")
    proposal = propose(columns_of(tmp_path, table, units={"beta": "deg"}), known)
    rationale = proposal.rationales["beta"]
    assert rationale.confidence <= 0.5
    assert "the file now gives deg where rad was confirmed" in rationale.reasons[1]


def counted(tmp_path, scalings=None, units=None):
    """A table in counts of 2^-12 with an offset of 100 counts."""
    table = plain_table()
    return columns_of(
        tmp_path,
        {name: x if name == "t_s" else x * 4096 - 100 for name, x in table.items()},
        scalings=scalings,
        units=units,
    )


def test_a_scale_that_the_file_declares_is_proposed_and_its_unit_known_by_it(tmp_path):
    scaling = Scaling(2**-12, 100 * 2**-12)
    names = [name for name in plain_table() if name != "t_s"]
    known = propose(columns_of(tmp_path / "plain", plain_table()))
    columns = counted(tmp_path / "counts", dict.fromkeys(names, scaling))
    proposal = propose(columns)
    assert proposal.mapping.channels.keys() == known.mapping.channels.keys()
    for key, source in proposal.mapping.channels.items():
        expected = known.mapping.channels[key]
        assert (source.signal, source.unit) == (expected.signal, expected.unit)
        assert source.signal == "" or source.scaling == scaling
    reasons = proposal.rationales["beta"].reasons
    assert any("0.000244140625 * raw + 0.0244140625" in reason for reason in reasons)
    beta = apply_mapping(columns, proposal.mapping).channels["beta"].values
    np.testing.assert_allclose(beta, plain_table()[PLAIN["beta"]], atol=1e-12)
    raw = Mapping({"beta": replace(proposal.mapping.channels["beta"], scale=1.0, offset=0.0)},
                  proposal.mapping.times)  # fmt: skip
    warnings = find_warnings(columns, raw, apply_mapping(columns, raw))
    assert any("the file declares 0.000244140625 * raw" in text for text in warnings["beta"])


def test_a_confirmed_scale_is_not_doubted_and_helps_to_find_other_units(tmp_path):
    scale = {"scale": 2**-12, "offset": 100 * 2**-12}
    known = propose(columns_of(tmp_path / "plain", plain_table())).mapping
    channels = {
        key: replace(source, **scale) if source.signal else source
        for key, source in known.channels.items()
    }
    proposal = propose(counted(tmp_path / "counts"), Mapping(channels, known.times))
    assert proposal.mapping.channels == channels
    assert min(proposal.rationales[key].confidence for key in KEYS) > 0.95


def test_a_scale_that_changed_since_it_was_confirmed_is_suspect(tmp_path):
    columns = counted(tmp_path, {"beta_rad": Scaling(2**-11)})
    confirmed = ChannelSource("beta_rad", "rad", scale=2**-12)
    proposal = propose(columns, Mapping({"beta": confirmed}, {"": TimeSource("t_s", "s")}))
    assert proposal.mapping.channels["beta"] == confirmed
    rationale = proposal.rationales["beta"]
    assert rationale.confidence <= 0.5
    assert "the file declares 0.00048828125 * raw for beta_rad" in rationale.reasons[1]


def test_two_parts_of_one_word_are_not_doubted(tmp_path):
    table = plain_table()
    phi, p = (np.round(table.pop(PLAIN[key]) * 2**11).astype(int) & 0xFFF for key in ("phi", "p"))
    columns = columns_of(tmp_path, table | {"word": phi | p << 12})
    source = ChannelSource("word", "rad", scale=2**-11, bits="1-12 signed")
    channels = {"phi": source, "p": replace(source, unit="rad/s", bits="13-24 signed")}
    known = propose(columns, Mapping(channels, {"": TimeSource("t_s", "s")}))
    assert {key: known.mapping.channels[key] for key in channels} == channels
    for key in (*KEYS, "phi"):
        assert known.rationales[key].confidence > 0.9, known.rationales[key]
    warnings = find_warnings(columns, known.mapping, apply_mapping(columns, known.mapping))
    assert not {*channels} & {*warnings}
    same = {"phi": source, "p": replace(source, unit="rad/s")}
    warnings = find_warnings(columns, Mapping(same, known.mapping.times), None)
    assert any("also mapped" in text for text in warnings["p"])


def test_the_same_file_is_proposed_the_same(tmp_path):
    columns = columns_of(tmp_path, plain_table())
    assert propose(columns) == propose(columns)


def test_a_file_without_channels_gives_a_reason_for_each(tmp_path):
    table = {"t_s": np.arange(50.0), "cabin_pressure": np.arange(50.0)}
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.missing == KEYS
    assert proposal.mapping.channels == {}
    assert "no signal name suggests sideslip" in proposal.rationales["beta"].reasons


WILD = st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e308, -1e308, np.nan, np.inf, -np.inf, 9999.0])


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.too_slow])
@given(st.data(), st.integers(2, 300))
def test_any_numbers_under_known_names_are_proposed_of_and_applied(tmp_path_factory, data, n):
    table = {}
    for key in data.draw(st.lists(st.sampled_from([*WAYS]), min_size=1, unique=True)):
        name, _, _ = data.draw(st.sampled_from(WAYS[key]))
        few = data.draw(st.lists(WILD | st.floats(), min_size=1, max_size=8))
        table[name] = np.resize(few, n)
    if data.draw(st.booleans()):
        table["t_s"] = 0.05 * np.arange(n)
    columns = columns_of(tmp_path_factory.mktemp("wild"), table)
    proposal = propose(columns)
    assert all(0.0 <= rationale.confidence <= 1.0 for rationale in proposal.rationales.values())
    if proposal.mapping.channels and proposal.mapping.times:
        traces = apply_mapping(columns, proposal.mapping)
        assert all(not np.isinf(trace.values).any() for trace in traces.channels.values())
    json.dumps(channel_bands(applicable(columns, proposal.mapping)), allow_nan=False)


def test_a_note_names_the_checks_without_airspeed_or_attitude(tmp_path):
    assert propose(columns_of(tmp_path / "all", plain_table())).notes == ()
    table = plain_table()
    table["VCAS"] = table.pop(PLAIN["V"])
    for key in ("phi", "psi"):
        del table[PLAIN[key]]
    airspeed, bank, heading = propose(columns_of(tmp_path / "few", table)).notes
    assert "VCAS" in airspeed
    assert "flight condition" in airspeed
    assert "roll rate" in bank
    assert "yaw rate" in heading


@pytest.mark.parametrize("unit", ["", "rad"], ids=["inferred", "given"])
def test_a_normalised_command_is_doubted_beside_one_that_reaches_1(unit: str, tmp_path):
    table = plain_table()
    names = {key: f"{key}_position" for key in ("delta_a", "delta_r")}
    for key, peak in (("delta_a", 1.0), ("delta_r", 0.7)):
        values = table.pop(PLAIN[key])
        table[names[key]] = np.clip(1.2 * values / np.abs(values).max(), -1.0, 1.0) * peak
    units: dict[str, str] = dict.fromkeys(names.values(), unit)
    columns = columns_of(tmp_path, table, units=units)
    proposal = propose(columns)
    warnings = find_warnings(columns, proposal.mapping, apply_mapping(columns, proposal.mapping))
    for key in names:
        assert proposal.mapping.channels[key].unit == "rad"
        assert proposal.rationales[key].confidence < 0.75
        assert "normalised" in proposal.rationales[key].reasons[-1]
        assert any("normalised" in text for text in warnings[key])
