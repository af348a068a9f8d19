"""Channels of any dictionary: mapped by exact name and unit, kept in SI, converted when read."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from app.telemetry.contents import Columns
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource, mapping_template
from app.telemetry.mapping.proposal import Proposal, propose
from app.telemetry.reading import columns_of as read_columns
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import KNOWN, TARGETS, as_mapped
from app.telemetry.timing.repair import repair
from app.telemetry.units import convert
from core.channels import LATERAL, LONGITUDINAL, SIX_DOF, Channel, Dictionary, channel
from tests.support.repetition import examples
from tests.support.tables import columns_of, flight

N = 200
T = 0.02 * np.arange(N)
TABLE = {
    "time_s": T,
    "Alpha": 5.0 + np.sin(T),
    "q [deg/s]": 10.0 * np.cos(T),
    "PITCH_ANGLE": 0.1 * np.sin(T),
    "normal acceleration": 9.80665 * (1.0 + 0.2 * np.sin(T)),
    "KTAS": 200.0 + np.sin(T),
    "delta_e_deg": np.sin(3.0 * T),
}
UNITS = {"Alpha": "deg", "PITCH_ANGLE": "rad", "normal acceleration": "m/s^2"}


def own(key: str, unit: str, symbol: str = "", label: str = "") -> Channel:
    return channel(key, symbol or key, unit, label or key, "output", "absolute")


def proposed(columns: Columns, *channels: Channel) -> Proposal:
    return propose(columns, dictionary=Dictionary("own", channels))


def test_a_longitudinal_csv_is_mapped_by_name_in_si_units(tmp_path: Path) -> None:
    path = tmp_path / "pitch.csv"
    head = ",".join(f"{name} ({UNITS[name]})" if name in UNITS else name for name in TABLE)
    np.savetxt(path, np.column_stack(list(TABLE.values())), delimiter=",", header=head, comments="")
    with read_columns(path) as columns:
        proposal = propose(columns, dictionary=LONGITUDINAL)
        traces = apply_mapping(columns, proposal.mapping)
    assert proposal.missing == ()
    assert {key: trace.unit for key, trace in traces.channels.items()} == {
        known.key: known.unit for known in LONGITUDINAL.channels
    }
    for key, values in {
        "alpha": np.radians(TABLE["Alpha"]),
        "q": np.radians(TABLE["q [deg/s]"]),
        "theta": TABLE["PITCH_ANGLE"],
        "Nz": TABLE["normal acceleration"] / 9.80665,
        "V": TABLE["KTAS"] * 1852.0 / 3600.0,
        "delta_e": np.radians(TABLE["delta_e_deg"]),
    }.items():
        np.testing.assert_allclose(traces.channels[key].values, values, rtol=1e-12, err_msg=key)
        assert proposal.rationales[key].confidence > 0.8
    assert proposal.notes == ()


def test_ten_channels_of_a_matlab_file_are_mapped_by_name(tmp_path: Path) -> None:
    names = ("α", "N_z", "wing load", "q", "Nx", "flap", "ζ_2", "mass", "δ_e", "throttle")
    units = ("rad", "g", "N", "rad/s", "g", "rad", "1", "kg", "rad", "1")
    channels = [
        own(f"{name} key" if name == "mass" else name, unit, name)
        for name, unit in zip(names, units, strict=True)
    ]
    y = np.random.default_rng(1).uniform(-1.0, 1.0, (N, 10))
    fields = (
        "alpha",
        "N_z",
        "wing_load",
        "q",
        "Nx",
        "flap",
        "zeta2",
        "mass",
        "delta_e",
        "throttle",
    )
    path = tmp_path / "flight.mat"
    savemat(path, {"t": T} | {name: y[:, k] for k, name in enumerate(fields)})
    greek = {"α": "alpha", "ζ_2": "zeta_2", "δ_e": "delta_e"}
    spelled = [own(greek.get(c.key, c.key), c.unit, c.symbol) for c in channels]
    with read_columns(path) as columns:
        proposal = proposed(columns, *spelled)
        traces = apply_mapping(columns, proposal.mapping)
    assert proposal.missing == ()
    for k, known in enumerate(spelled):
        np.testing.assert_array_equal(traces.channels[known.key].values, y[:, k])


@pytest.mark.parametrize(
    "name", ["γ̇ left", "Γ̇_LEFT", "bus/γ̇-left", "γ̇ left (deg/s)", "γ̇ left [deg/s]"]
)
def test_greek_and_spaces_match_whatever_case_path_and_unit(name: str, tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, name: np.sin(T)}, units={name: "deg/s"})
    proposal = proposed(columns, own("γ̇ left", "rad/s"))
    assert proposal.mapping.channels == {"γ̇ left": ChannelSource(name, "deg/s")}
    trace = apply_mapping(columns, proposal.mapping).channels["γ̇ left"]
    np.testing.assert_allclose(trace.values, np.radians(np.sin(T)), rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "reason"), [("kt", "unit kt in the file"), ("widgets", "'widgets'")]
)
def test_a_unit_that_does_not_fit_is_a_reason_not_to_map(
    unit: str, reason: str, tmp_path: Path
) -> None:
    columns = columns_of(tmp_path, {"t": T, "alpha": np.sin(T)}, units={"alpha": unit})
    for proposal in (propose(columns, dictionary=LONGITUDINAL), propose(columns, others=[ALPHA])):
        assert "alpha" not in proposal.mapping.channels
        assert reason in proposal.rationales["alpha"].reasons[0]


ALPHA = KNOWN["alpha"]


def test_nothing_is_guessed_from_the_values(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, "alpha": 12.0 * np.sin(T), "delta_e": 0.1 * np.sin(T)})
    proposal = propose(columns, dictionary=LONGITUDINAL)
    assert proposal.mapping.channels == {"delta_e": ChannelSource("delta_e", "rad")}
    assert "no unit is given" in proposal.rationales["alpha"].reasons[0]
    assert proposal.rationales["delta_e"].confidence < 0.7


def test_other_channels_do_not_change_a_lateral_proposal(tmp_path: Path) -> None:
    table = flight() | {"alpha_deg": 3.0 + np.sin(flight()["t"]), "Nz": np.cos(flight()["t"])}
    columns = columns_of(tmp_path, table)
    plain = propose(columns)
    more = propose(columns, others=KNOWN.values())
    assert more.mapping.channels.keys() - plain.mapping.channels.keys() == {"alpha", "Nz"}
    for key in TARGETS.keys() & plain.mapping.channels.keys():
        assert more.mapping.channels[key] == plain.mapping.channels[key]
        assert more.rationales[key] == plain.rationales[key]
    assert (more.missing, more.notes) == (plain.missing, plain.notes)


def test_lateral_physics_speaks_only_of_lateral_channels(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, TABLE, units=UNITS)
    proposal = propose(columns, others=KNOWN.values())
    assert proposal.notes == ()
    mapping = propose(columns, dictionary=LONGITUDINAL).mapping
    assert find_warnings(columns, mapping, apply_mapping(columns, mapping)) == {}


def test_a_symmetric_flight_of_six_degrees_of_freedom_maps_its_still_channels(
    tmp_path: Path,
) -> None:
    keys = SIX_DOF.keys
    still = {"beta", "p", "r", "phi", "Ny", "delta_a", "delta_r"}
    table = {key: np.zeros(N) if key in still else 0.1 * np.sin(T) for key in keys}
    table["V"] = 100.0 + np.sin(T)
    units = {known.key: known.unit for known in SIX_DOF.channels}
    columns = columns_of(tmp_path, {"t": T} | table, units=units)
    proposal = propose(columns, dictionary=SIX_DOF)
    assert proposal.missing == ()
    assert "beta" in propose(columns).missing
    assert set(apply_mapping(columns, proposal.mapping).channels) == set(keys)


def test_one_key_of_two_dictionaries_is_kept_in_si_and_read_in_each_unit(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, "load": 100.0 + T}, units={"load": "lbf"})
    units = "N", "lbf"
    mappings = [proposed(columns, own("load", unit)).mapping for unit in units]
    traces = [apply_mapping(columns, mapping).channels["load"] for mapping in mappings]
    assert [trace.unit for trace in traces] == ["N", "N"]
    np.testing.assert_array_equal(traces[0].values, traces[1].values)
    pounds, newtons = 100.0 + T, 4.448222 * (100.0 + T)
    np.testing.assert_allclose(convert(traces[0].values, "N", "N"), newtons, rtol=1e-12)
    np.testing.assert_allclose(convert(traces[0].values, "N", "lbf"), pounds, rtol=1e-12)


def test_one_key_of_two_quantities_takes_the_one_whose_unit_fits(tmp_path: Path) -> None:
    pressure, rate = own("q", "Pa"), KNOWN["q"]
    for unit, kept in (("psf", "Pa"), ("deg/s", "rad/s")):
        columns = columns_of(tmp_path / kept[:2], {"t": T, "q": 1.0 + T}, units={"q": unit})
        mapping = propose(columns, others=[pressure, rate]).mapping
        traces = apply_mapping(columns, mapping)
        assert traces.channels["q"].unit == kept
        assert repair(traces).quality.channels[0].implausible == 0


def test_a_surface_may_be_recorded_as_a_share_of_its_travel(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, "delta_e": np.sin(T)})
    for unit in ("", "1"):
        proposal = proposed(columns, own("delta_e", unit))
        assert proposal.mapping.channels == {"delta_e": ChannelSource("delta_e", "1")}
        trace = apply_mapping(columns, proposal.mapping).channels["delta_e"]
        np.testing.assert_array_equal(convert(trace.values, trace.unit, unit), np.sin(T))
        assert as_mapped(own("delta_e", unit)).unit == "1"


def test_an_own_name_shares_a_signal_with_the_same_quantity_only(tmp_path: Path) -> None:
    columns = columns_of(
        tmp_path, {"t": T, "pitch": 0.1 * np.sin(T), "bank": np.sin(T)}, units={"pitch": "deg"}
    )
    proposal = proposed(columns, own("pitch", "rad"), own("bank", "1"))
    channels = proposal.mapping.channels
    assert channels["pitch"] == channels["theta"] == ChannelSource("pitch", "deg")
    assert "phi" not in channels
    assert find_warnings(columns, proposal.mapping, None) == {}
    twice = Mapping(channels | {"alpha": channels["pitch"]}, proposal.mapping.times)
    assert "theta" in find_warnings(columns, twice, None)


def test_the_nearest_name_wins_and_others_are_alternatives(tmp_path: Path) -> None:
    table = {"t": T, "Q": 1.0 + T, "q": T, "bus/Q": 2.0 + T, "air/q": 3.0 + T}
    units = dict.fromkeys(("Q", "q", "bus/Q"), "rad/s") | {"air/q": "m"}
    columns = columns_of(tmp_path, table, units=units)
    proposal = propose(columns, others=[KNOWN["q"], own("q", "Pa")])
    assert proposal.mapping.channels == {"q": ChannelSource("q", "rad/s")}
    assert set(proposal.alternatives["q"]) == {"Q", "bus/Q"}
    assert proposal.rationales["q"].confidence == pytest.approx(0.95 * 0.85)


def test_a_missing_channel_has_its_names_as_the_reason_and_a_place_in_the_template(
    tmp_path: Path,
) -> None:
    columns = columns_of(tmp_path, {"t": T, "alpha": 0.1 * T})
    proposal = propose(columns, dictionary=LONGITUDINAL)
    assert proposal.missing == ("q", "theta", "Nz", "V", "delta_e")
    assert "pitch rate" in proposal.rationales["q"].reasons[0]
    template = mapping_template(
        proposal.mapping, columns.contents, proposal.missing, LONGITUDINAL.channels
    )
    assert set(template["channels"]) == set(LONGITUDINAL.keys)
    assert template["channels"]["delta_e"]["unit"] == "rad"


def test_a_confirmed_mapping_of_any_channels_is_recalled(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, "a": T, "b": T}, units={"a": "lbf"})
    remembered = Mapping(
        {"load": ChannelSource("a", "lbf", -1, 2.0), "gone": ChannelSource("z", "m")},
        {"": TimeSource("t")},
    )
    proposal = propose(columns, remembered)
    assert proposal.mapping.channels == {"load": ChannelSource("a", "lbf", -1, 2.0)}
    trace = apply_mapping(columns, proposal.mapping).channels["load"]
    np.testing.assert_allclose(trace.values, -4.448222 * T - 2.0, rtol=1e-12)
    assert Mapping.from_plain(remembered.to_plain()) == remembered


def test_a_wrong_unit_of_any_channel_is_refused_when_applied(tmp_path: Path) -> None:
    columns = columns_of(tmp_path, {"t": T, "a": T})
    for key, unit in (("load", "widgets"), ("alpha", "widgets"), ("alpha", ""), ("beta", "kt")):
        mapping = Mapping({key: ChannelSource("a", unit)}, {"": TimeSource("t")})
        with pytest.raises(TelemetryError, match=rf"unit of {key} \(a\)"):
            apply_mapping(columns, mapping)


def test_lateral_channels_are_those_of_the_targets() -> None:
    assert all(KNOWN[key] == TARGETS[key] for key in TARGETS)
    assert LATERAL.channels == tuple(TARGETS[key] for key in LATERAL.keys)


def test_an_own_channel_in_another_unit_is_displayed_the_same_when_mapped() -> None:
    for known in (own("load", "lbf"), own("speed", "kt"), own("alpha", "deg"), ALPHA):
        mapped = as_mapped(known)
        assert mapped.unit in ("N", "m/s", "rad")
        value = convert(np.array([3.0]), known.unit, mapped.unit)[0]
        assert value * mapped.display_factor == pytest.approx(3.0 * known.display_factor)
    assert as_mapped(ALPHA) == ALPHA
    assert as_mapped(own("load", "widgets")).unit == "widgets"


NAMES = st.text(st.sampled_from("aQq_θΔ .-/[()]°1"), min_size=1, max_size=8)
SPELLINGS = st.sampled_from(["", "rad", "deg/s", "lbf", "psf", "widgets", "%", "1", "degC", "mV"])


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.too_slow])
@given(
    st.dictionaries(NAMES, SPELLINGS, min_size=1, max_size=5),
    st.dictionaries(NAMES, SPELLINGS, min_size=1, max_size=5),
)
def test_any_proposal_can_be_applied_and_takes_only_units_that_fit(
    tmp_path_factory: pytest.TempPathFactory, signals: dict[str, str], keys: dict[str, str]
) -> None:
    table = {"time": T} | {name: np.sin(k * T) for k, name in enumerate(signals, 1)}
    columns = columns_of(tmp_path_factory.mktemp("any"), table, units=signals)
    dictionary = Dictionary("own", tuple(own(key, unit) for key, unit in keys.items()))
    proposal = propose(columns, dictionary=dictionary, others=KNOWN.values())
    mapping = Mapping.from_plain(proposal.mapping.to_plain())
    assert mapping == proposal.mapping
    if mapping.channels:
        traces = apply_mapping(columns, mapping)
        repaired = repair(traces)
        assert traces.channels.keys() == mapping.channels.keys()
        assert find_warnings(columns, mapping, traces).keys() <= mapping.channels.keys()
        for known in dictionary.channels:
            if known.key in traces.channels and known.key not in TARGETS:
                trace = repaired.traces.channels[known.key]
                assert convert(trace.values, trace.unit, known.unit) is not None
    for key in dictionary.keys:
        assert (key in mapping.channels) != bool(key in proposal.missing)
        assert proposal.rationales[key].reasons
