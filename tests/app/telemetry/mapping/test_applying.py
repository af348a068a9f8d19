import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.recordings.answers import channel_bands
from app.telemetry.mapping.applying import applicable, apply_mapping, time_zero
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from tests.support.tables import columns_of

T = {"": TimeSource("t", "s")}


def mapping(times=None, **channels):
    return Mapping(channels, T if times is None else times)


def table(n=50, **signals):
    return {"t": 0.1 * np.arange(n), **signals}


@given(
    st.sampled_from([1, -1]),
    st.floats(-1.0, 1.0),
    st.lists(st.floats(-20.0, 20.0), min_size=2, max_size=6),
)
def test_a_value_is_sign_times_converted_minus_bias(tmp_path_factory, sign, bias, numbers):
    columns = columns_of(tmp_path_factory.mktemp("a"), {"t": range(len(numbers)), "b": numbers})
    source = ChannelSource("b", "deg", sign, bias)
    trace = apply_mapping(columns, mapping(beta=source)).channels["beta"]
    np.testing.assert_array_equal(trace.values, sign * (np.array(numbers) * (np.pi / 180)) - bias)
    np.testing.assert_array_equal(trace.t, np.arange(len(numbers)))
    assert (trace.source, trace.derived, trace.group) == ("b", False, "")


@given(
    st.floats(-1e3, 1e3).filter(bool),
    st.floats(-1e3, 1e3),
    st.sampled_from([1, -1]),
    st.lists(st.integers(-(2**15), 2**15 - 1), min_size=2, max_size=6),
)
def test_raw_counts_are_scaled_in_the_unit_of_the_source(
    tmp_path_factory, scale, offset, sign, counts
):
    columns = columns_of(tmp_path_factory.mktemp("a"), {"t": range(len(counts)), "b": counts})
    source = ChannelSource("b", "deg", sign, 0.25, scale=scale, offset=offset)
    values = apply_mapping(columns, mapping(beta=source)).channels["beta"].values
    degrees = np.array(counts) * scale + offset
    np.testing.assert_array_equal(values, sign * (degrees * (np.pi / 180)) - 0.25)


def test_bits_are_read_before_the_scale(tmp_path):
    counts = np.arange(64.0)
    columns = columns_of(tmp_path, table(64, b=counts))
    source = ChannelSource("b", "deg", scale=0.5, offset=1.0, bits="2-4")
    traces = apply_mapping(columns, mapping(beta=source))
    np.testing.assert_allclose(
        np.degrees(traces.channels["beta"].values), (counts // 2 % 8) * 0.5 + 1.0
    )
    assert traces.notes[0] == "Scaled: beta = 0.5 * bits 2-4 + 1."


def test_bits_of_a_signal_with_fractions_are_refused(tmp_path):
    columns = columns_of(tmp_path, table(4, beta_deg=[0.0, 1.5, np.nan, 2.0]))
    source = ChannelSource("beta_deg", "deg", bits="5-16 signed")
    with pytest.raises(TelemetryError, match="whole numbers; beta_deg has fractions"):
        apply_mapping(columns, mapping(beta=source))


def test_words_without_a_normal_status_have_a_reason(tmp_path):
    columns = columns_of(tmp_path, table(3, word=[0, 1 << 29, 2 << 29], ok=[0, 0, 3 << 29]))
    lost, kept = (ChannelSource(name, "g", bits="11-29 bnr") for name in ("word", "ok"))
    channels = apply_mapping(columns, mapping(Ny=lost, beta=replace(kept, unit="deg"))).channels
    assert "normal operation" in channels["Ny"].why_missing
    assert channels["beta"].why_missing == ""


def test_one_bit_is_also_read_as_a_number():
    read = Mapping.from_plain({"channels": {"beta": {"signal": "b", "bits": 7}}})
    assert read.channels["beta"].bits == "7"


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"offset": 1.0}, "'beta' of 'channels' .* `scale`"),
        ({"scale": "x"}, "'scale' of 'beta' of 'channels' is 'x': give a number"),
        ({"bits": 7.5}, "'bits' of 'beta' of 'channels' is 7.5: give a bit such as 7"),
        ({"unit": 5}, "'unit' of 'beta' of 'channels' is 5: give text"),
        ({"sign": 2}, "'sign' of 'beta' of 'channels' is 2: give 1 or -1"),
        ({"units": "deg"}, "'units' of 'beta' of 'channels' is unknown"),
    ],
)
def test_an_invalid_entry_is_named_with_what_it_needs(entry, expected):
    with pytest.raises(TelemetryError, match=expected) as refused:
        Mapping.from_plain({"channels": {"beta": {"signal": "b"} | entry}})
    assert "Value error" not in str(refused.value)


def test_a_mapping_without_a_scale_is_written_as_before():
    plain = mapping(beta=ChannelSource("b", "deg", -1, 0.25)).to_plain()
    assert [*plain["channels"]["beta"]] == ["signal", "unit", "sign", "bias", "derivation"]
    scaled = mapping(beta=ChannelSource("b", "deg", scale=0.5, bits="1-4"))
    assert scaled.to_plain()["channels"]["beta"].items() >= {"scale": 0.5, "bits": "1-4"}.items()
    assert Mapping.from_plain(json.loads(json.dumps(scaled.to_plain()))) == scaled


def test_an_offset_without_a_scale_is_ambiguous():
    given = {"channels": {"beta": {"signal": "b", "unit": "deg", "offset": 3.0}}}
    with pytest.raises(TelemetryError, match=r"`scale` \(1.0 for none\) .* or `bias`"):
        Mapping.from_plain(given)
    given["channels"]["beta"]["scale"] = 1.0
    assert Mapping.from_plain(given) == mapping({}, beta=ChannelSource("b", "deg", offset=3.0))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"scale": 0.0}, "scale of 0: give a finite number other than zero"),
        ({"scale": np.inf}, "scale of inf"),
        ({"scale": np.nan}, "scale of nan"),
        ({"scale": "2"}, "give a number"),
        ({"scale": 2.0, "offset": np.nan}, "offset of nan: give a finite number"),
        ({"bits": "16-5"}, "least significant first"),
        ({"signal": "", "derivation": "beta_from_velocity", "scale": 2.0}, "only a signal has"),
    ],
)
def test_a_scaling_that_gives_no_value_is_refused(wrong, message, tmp_path):
    entry = {"signal": "b", "unit": "rad"} | wrong
    with pytest.raises(TelemetryError, match=message) as refusal:
        Mapping.from_plain({"channels": {"beta": entry}})
    assert "beta" in str(refusal.value)
    if entry["signal"] and entry.get("scale") != "2":
        columns = columns_of(tmp_path, table(b=np.ones(50)))
        with pytest.raises(TelemetryError, match=message):
            apply_mapping(columns, mapping(beta=ChannelSource(**entry)))


def test_a_mapping_file_of_version_0_1_0_is_read():
    now = mapping(beta=ChannelSource("b", "deg", -1, 0.25))
    earlier = now.to_plain()
    earlier["channels"]["beta"]["offset"] = earlier["channels"]["beta"].pop("bias")
    assert Mapping.from_plain(earlier) == now


def test_values_without_conversion_stay_memory_mapped(tmp_path):
    columns = columns_of(tmp_path, table(b=np.ones(50)))
    channels = apply_mapping(columns, mapping(beta=ChannelSource("b", "rad"))).channels
    assert isinstance(channels["beta"].values.base, np.memmap)


def test_channels_of_a_group_share_their_times_and_others_do_not(tmp_path):
    columns = columns_of(
        tmp_path,
        {"fast//t": np.arange(9.0), "fast//p": np.ones(9), "fast//r": np.ones(9)}
        | {"slow//t2": np.arange(3.0) * 1000, "slow//b": np.ones(3)},
    )
    times = {"fast": TimeSource("t", "s"), "slow": TimeSource("t2", "ms")}
    mapped = mapping(
        times,
        p=ChannelSource("p", "rad/s"),
        r=ChannelSource("r", "rad/s"),
        beta=ChannelSource("b", "rad"),
    )
    channels = apply_mapping(columns, mapped).channels
    assert channels["p"].t is channels["r"].t
    np.testing.assert_array_equal(channels["beta"].t, [0.0, 1.0, 2.0])
    assert (channels["p"].group, channels["beta"].group) == ("fast", "slow")
    assert list(channels) == ["beta", "p", "r"]


@pytest.mark.parametrize(
    ("time", "zero"),
    [
        (TimeSource("t", "s"), "15:35:50"),
        (TimeSource("elapsed", "s"), ""),
        (TimeSource(rate=10.0), ""),
    ],
)
def test_the_zero_of_the_times_is_that_of_the_clock_they_are_read_from(tmp_path, time, zero):
    signals = table(b=np.ones(50), elapsed=np.arange(50.0))
    contents = replace(columns_of(tmp_path, signals, times={"": "t"}).contents, start="15:35:50")
    assert time_zero(contents, mapping({"": time}, beta=ChannelSource("b", "rad"))) == zero
    assert time_zero(contents, mapping({"": time})) == ""


def test_infinities_are_missing(tmp_path):
    columns = columns_of(tmp_path, table(3, b=[np.inf, 1.0, np.nan]))
    values = apply_mapping(columns, mapping(beta=ChannelSource("b", "rad"))).channels["beta"].values
    np.testing.assert_array_equal(values, [np.nan, 1.0, np.nan])


def test_notes_list_conversions_signs_biases_and_derivations(tmp_path):
    columns = columns_of(tmp_path, table(b=np.ones(50), d=np.ones(50), v=np.ones(50)))
    mapped = mapping(
        beta=ChannelSource(derivation="beta_from_velocity"),
        delta_r=ChannelSource("d", "deg", sign=-1, bias=0.25),
        v=ChannelSource("v", "m/s"),
        V=ChannelSource("b", "kt"),
    )
    traces = apply_mapping(columns, mapped)
    assert traces.notes == (
        "Converted: delta_r from deg, V from kt.",
        "Sign reversed: delta_r.",
        "Bias removed: delta_r 14.3 deg.",
        "Derived, not measured: beta (sideslip as the arc sine of lateral velocity over airspeed, "
        "from v, b as V).",
    )
    assert traces.channels["beta"].derived


WRONG = {
    "no channel": (mapping(), "no channel: map signals to beta, p"),
    "no such signal": (
        mapping(beta=ChannelSource("AOSS", "deg")),
        "takes beta from 'AOSS', .* choose one of t, b, short//t2",
    ),
    "no unit": (mapping(beta=ChannelSource("b")), r"unit of beta \(b\): '' is not a known unit"),
    "another unit": (
        mapping(beta=ChannelSource("b", "deg/s")),
        r"unit of beta \(b\): 'deg/s' is not a unit of this quantity, which is in rad",
    ),
    "no time": (
        mapping({}, beta=ChannelSource("b", "rad")),
        "'b' has no time: choose a signal as the time of the table",
    ),
    "no time of the group": (
        mapping(beta=ChannelSource("c", "rad")),
        "'c' has no time: choose a signal as the time of the group 'short'",
    ),
    "no such time": (
        mapping({"": TimeSource("clock")}, beta=ChannelSource("b", "rad")),
        "takes time from 'clock'",
    ),
    "time in degrees": (
        mapping({"": TimeSource("t", "deg")}, beta=ChannelSource("b", "rad")),
        "unit of the time t: 'deg' is not a unit",
    ),
    "time of another group": (
        mapping({"": TimeSource("t2")}, beta=ChannelSource("b", "rad")),
        "beta comes from 'b' with 50 values, but its time has 3",
    ),
    "unknown derivation": (
        mapping(beta=ChannelSource(derivation="magic")),
        "beta cannot be derived by 'magic': choose beta_from_velocity",
    ),
    "derivation of another": (
        mapping(phi=ChannelSource("b", "rad"), r=ChannelSource(derivation="p_from_attitude")),
        "r cannot be derived by 'p_from_attitude': choose r_from_attitude",
    ),
    "lacking": (
        mapping(beta=ChannelSource(derivation="beta_from_velocity"), V=ChannelSource("b", "m/s")),
        "beta is derived from v and V, but v is not mapped",
    ),
}


@pytest.mark.parametrize(("wrong", "message"), WRONG.values(), ids=WRONG)
def test_a_mapping_that_does_not_fit_is_refused_by_name(wrong, message, tmp_path):
    content = table(b=np.ones(50)) | {"short//t2": np.arange(3.0), "short//c": np.ones(3)}
    columns = columns_of(tmp_path, content)
    message = message.replace("short//", "")
    with pytest.raises(TelemetryError, match=message) as refusal:
        apply_mapping(columns, wrong)
    assert str(refusal.value).isprintable()


def test_small_plots_hold_the_extremes_of_all_rows(tmp_path):
    values = np.random.default_rng(0).standard_normal(10_000)
    values[[77, 5000]] = 9.0, -9.0
    values[:50] = np.nan
    columns = columns_of(tmp_path, table(10_000, b=values))
    plots = channel_bands(apply_mapping(columns, mapping(beta=ChannelSource("b", "mrad"))))
    assert list(plots) == ["beta"]
    plot = plots["beta"]
    assert len(plot["t"]) == len(plot["low"]) == len(plot["high"]) == 120
    assert (plot["unit"], plot["min"], plot["max"]) == ("rad", -0.009, 0.009)
    assert min(plot["low"]) == -0.009
    assert max(plot["high"]) == 0.009
    assert all(0.0 <= t <= 1000.0 for t in plot["t"])
    json.dumps(plots, allow_nan=False)


@pytest.mark.parametrize("n", [2, 5, 119, 120, 121, 1000])
def test_small_plots_are_no_longer_than_asked_or_recorded(n, tmp_path):
    columns = columns_of(tmp_path, table(n, b=np.full(n, np.nan)))
    traces = apply_mapping(columns, mapping(beta=ChannelSource("b", "rad")))
    plot = channel_bands(traces, 60)["beta"]
    assert len(plot["t"]) == min(n, 60)
    assert plot["low"] == [None] * min(n, 60)
    assert plot["min"] is plot["max"] is None


def test_one_wrong_channel_does_not_hide_the_others(tmp_path):
    columns = columns_of(tmp_path, table(b=np.ones(50), v=np.ones(50)))
    mapped = mapping(
        beta=ChannelSource(derivation="beta_from_velocity"),
        p=ChannelSource("b", "furlongs"),
        r=ChannelSource(derivation="r_from_attitude"),
        V=ChannelSource("b", "kt"),
        v=ChannelSource("v", "ft/s"),
    )
    with pytest.raises(TelemetryError):
        apply_mapping(columns, mapped)
    assert list(applicable(columns, mapped).channels) == ["beta", "V", "v"]


@given(st.sampled_from([*TARGETS]), st.text(max_size=8), st.text(max_size=8), st.text(max_size=8))
def test_any_mapping_is_applied_or_refused_as_telemetry(tmp_path_factory, key, signal, unit, way):
    columns = columns_of(tmp_path_factory.mktemp("any"), table(3, b=np.ones(3)))
    for source in (ChannelSource(signal, unit), ChannelSource(derivation=way or "x")):
        if source.signal or source.derivation:
            assert applicable(columns, mapping(**{key: source})).channels == {}


def test_nothing_is_derived_from_implausible_values(tmp_path):
    speed = np.full(100, 100.0)
    speed[50] = 1e30
    table = {"t": 0.1 * np.arange(100), "v": np.full(100, 5.0), "V": speed}
    columns = columns_of(tmp_path, table)
    applied = apply_mapping(
        columns,
        Mapping(
            {
                "v": ChannelSource("v", "m/s"),
                "V": ChannelSource("V", "m/s"),
                "beta": ChannelSource(derivation="beta_from_velocity"),
            },
            {"": TimeSource("t")},
        ),
    )
    assert np.flatnonzero(np.isnan(applied.channels["beta"].values)).tolist() == [50]
    assert applied.channels["V"].values[50] == 1e30, "which the quality is to tell"
