import numpy as np
import pytest

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.magnitudes import extent_of
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.mapping.proposal import propose
from app.telemetry.recording import TelemetryError
from tests.support.clocks import COUNTS, EVEN, N
from tests.support.tables import columns_of

SWING = 0.1 * np.sin(EVEN)


def times_of(folder, table, **how):
    proposal = propose(columns_of(folder, table, **how))
    return proposal.mapping.times, proposal.rationales


@pytest.mark.parametrize(("name", "values", "unit"), COUNTS.values(), ids=COUNTS)
def test_steps_and_origin_of_a_time_show_its_unit(name, values, unit, tmp_path):
    times, rationales = times_of(tmp_path, {"beta": SWING, name: values})
    assert times == {"": TimeSource(name, unit)}
    assert "unit not given: " in rationales["t:"].reasons[1]


@pytest.mark.parametrize(
    ("name", "given", "unit"),
    [("t_ms", "", "ms"), ("time", "us", "us"), ("Time (sec)", "", "s"), ("time_h", "", "h")],
)
def test_a_given_unit_is_used(name, given, unit, tmp_path):
    times, rationales = times_of(tmp_path, {name: EVEN, "beta": SWING}, units={name: given})
    assert times == {"": TimeSource(name, unit)}
    assert f"its unit is given as {unit}" in rationales["t:"].reasons[1]


def test_a_unit_with_an_unusual_sample_rate_is_doubted(tmp_path):
    _, rationales = times_of(tmp_path, {"t_h": EVEN, "beta": SWING})
    assert rationales["t:"].confidence < 0.6
    assert "one sample every 72 s" in rationales["t:"].reasons[1]


def test_a_declared_time_is_used(tmp_path):
    table = {"g//time": EVEN, "g//stamp": 1e6 * EVEN, "g//beta": SWING}
    times, rationales = times_of(tmp_path, table, times={"g": "stamp"}, units={"stamp": "us"})
    assert times == {"g": TimeSource("stamp", "us")}
    assert rationales["t:g"].confidence > 0.95


def test_an_unnamed_time_is_found_by_its_even_steps(tmp_path):
    table = {"beta": SWING, "column 1": EVEN, "x": np.cumsum(np.abs(SWING)) ** 2}
    times, rationales = times_of(tmp_path, table)
    assert times == {"": TimeSource("column 1", "s")}
    assert rationales["t:"].confidence < 0.6


@pytest.mark.parametrize(
    "values",
    [
        np.arange(float(N)),
        np.zeros(N),
        np.full(N, np.nan),
        np.random.default_rng(1).standard_normal(N),
        np.cumsum(np.random.default_rng(1).exponential(size=N)),
    ],
    ids=["counter", "constant", "empty", "noise", "uneven"],
)
def test_a_group_without_a_time_is_not_used_with_a_reason(values, tmp_path):
    untimed = {"a//beta": SWING, "a//row": values}
    times, rationales = times_of(tmp_path / "both", untimed | {"b//t": EVEN, "b//p": SWING})
    assert times.keys() == {"b"}
    assert rationales["t:a"].confidence == 0.0
    assert rationales["t:a"].reasons[0].endswith(": beta, row")
    times, rationales = times_of(tmp_path / "alone", untimed)
    assert times == {}
    assert rationales["t:a"].reasons[0].startswith("no signal is a time: choose one")


@pytest.mark.parametrize(
    ("clock", "why"),
    [
        (np.zeros(N), f"t_s is 0 in all {N} rows"),
        (np.full(N, np.nan), f"all {N} rows of t_s are empty"),
    ],
    ids=["constant", "empty"],
)
def test_a_constant_or_empty_time_is_reported_as_the_cause(clock, why, tmp_path):
    columns = columns_of(tmp_path, {"t_s": clock, "beta_rad": SWING})
    proposal = propose(columns)
    why += ", so it cannot be the time: choose another signal as the time"
    assert proposal.rationales["t:"].reasons[0].startswith(why)
    assert f"the name beta_rad suggests sideslip, but the signal has no time: {why}" in (
        proposal.rationales["beta"].reasons
    )
    taken = Mapping({"beta": ChannelSource("beta_rad", "rad")}, {"": TimeSource("t_s", "s")})
    for mapping in (proposal.mapping, taken):
        with pytest.raises(TelemetryError, match=why):
            apply_mapping(columns, mapping)


def test_a_clock_in_whole_seconds_is_refused_with_the_needed_rate(tmp_path):
    clock = np.floor(np.arange(N) / 25.0)
    columns = columns_of(tmp_path, {"time": clock, "beta_rad": SWING})
    proposal = propose(columns)
    why = "25 rows share each time of time: give the sample rate"
    assert proposal.rationales["t:"].reasons[0].startswith(f"{why}, about 25 Hz")
    with pytest.raises(TelemetryError, match=why):
        apply_mapping(columns, proposal.mapping)


def test_a_declared_time_that_does_not_run_is_not_used(tmp_path):
    table = {"clock": np.zeros(N), "t_s": EVEN, "beta_rad": SWING}
    columns = columns_of(tmp_path, table, times={"": "clock"})
    assert propose(columns).mapping.times == {"": TimeSource("t_s", "s")}


def test_a_name_alone_does_not_make_a_time(tmp_path):
    table = {"time": np.zeros(N), "elapsed": EVEN, "beta": SWING}
    assert times_of(tmp_path, table)[0] == {"": TimeSource("elapsed", "s")}


def test_clocks_that_repeat_step_back_and_miss_are_still_clocks(tmp_path):
    clock = EVEN.copy()
    clock[50:55] = clock[50]
    clock[200:] -= 1.0
    clock[300:310] = np.nan
    assert times_of(tmp_path, {"time": clock, "beta": SWING})[0] == {"": TimeSource("time", "s")}


def test_every_group_has_its_own_time_and_one_without_is_left_out(tmp_path):
    table = {
        "imu//timestamp": 1e6 * EVEN, "imu//gyro_x": SWING, "imu//gyro_z": SWING,
        "adc//t_s": EVEN[::4], "adc//beta": SWING[::4],
        "events//rudder": SWING[:3], "one//x": [1.0],
    }  # fmt: skip
    proposal = propose(columns_of(tmp_path, table))
    assert proposal.mapping.times == {
        "imu": TimeSource("timestamp", "us"),
        "adc": TimeSource("t_s", "s"),
    }
    signals = {key: source.signal for key, source in proposal.mapping.channels.items()}
    assert signals == {"beta": "beta", "p": "gyro_x", "r": "gyro_z"}
    assert proposal.rationales["t:events"].reasons[0].endswith(": rudder")
    assert "fewer than two rows" in proposal.rationales["t:one"].reasons[0]


def test_a_spike_is_not_a_peak():
    values = 0.05 * np.sin(np.arange(5000.0))
    values[[100, 4000]] = 9999.0, -9999.0
    assert extent_of(values).peak == pytest.approx(0.05, rel=0.01)
    assert extent_of(values).highest == 9999.0


def test_the_extent_of_few_or_no_values():
    assert extent_of(np.array([1.0, -3.0])).peak == 3.0
    assert extent_of(np.array([np.nan, np.inf])).peak == 0.0
    assert extent_of(np.array([np.nan, np.inf])).empty
    assert extent_of(np.empty(0)).empty
    assert not extent_of(np.ones(5)).still
    assert extent_of(np.ones(500)).still
