"""Limits on what is not measured, and on what lasts, trained by the command and streamed."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from app.assessment.batches import Batch, ChannelReader
from app.assessment.recorded import on_grid
from app.cli import main
from app.telemetry.limit_texts import computed_channel, specified
from app.telemetry.recording import TelemetryError, Trace, Traces
from app.telemetry.rollouts import RolloutFile, read_dictionary, read_rollouts
from app.telemetry.timing.repair import repair
from core.channels import LATERAL, Dictionary, channel
from core.computed import Computed, complete, lasting
from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.limits.limits import IntervalLimits, Limits, SafeInterval
from core.monitor import Monitor, load, train
from core.rollouts import LabelledFlights, RolloutsError
from core.types import Array, Indices
from tests.support import short_period
from tests.support.short_period import DT, N_SAMPLES

RNG = np.random.default_rng
DICTIONARY = Dictionary(
    "rolling pull-out",
    (
        channel("alpha", "α", "rad", "angle of attack", "output", "absolute"),
        channel("q", "q", "rad/s", "pitch rate"),
        channel("Nz", "N_z", "g", "normal acceleration", "output", "absolute"),
        channel("p", "p", "rad/s", "roll rate"),
        channel("delta_e", "δ_e", "rad", "elevator", "control", "absolute"),
        channel("delta_a", "δ_a", "rad", "aileron", "control", "absolute"),
    ),
)
LOAD = "load [kN*m] = 40*Nz + 30*abs(p)"
LIMIT = 172.0
NOISE = np.array([1e-3, 2e-3, 0.01, 5e-3, 5e-4, 5e-4])
WITH_LOAD = DICTIONARY.plus(computed_channel(LOAD))


def pull_out(rng: np.random.Generator, n: int) -> tuple[Array, Array, Indices]:
    """theta (n, 3), y (n, 81, 6), and the first sample over the limit, -1 for none.

    theta: shares of the nominal stiffness, roll damping, and of the inputs.   The label comes from
    the true load, the channels carry noise.
    """
    theta = rng.normal(1.0, 0.15, (n, 3))
    stiffness, damping, size = 6.0 * theta[:, 0], 2.5 * theta[:, 1], theta[:, 2]
    pull, roll = 0.5 + 0.1 * rng.standard_normal(n), 1.1 + 0.1 * rng.standard_normal(n)
    alpha, q, p = np.full(n, 0.05), np.zeros(n), np.zeros(n)
    elevator, aileron = np.zeros(n), np.zeros(n)
    y = np.empty((n, N_SAMPLES, 6))
    for k in range(N_SAMPLES):
        t, h = k * DT, DT / 5
        columns = [alpha, q, 1.0 + 20.0 * (alpha - 0.05), p, elevator - 0.02, aileron]
        y[:, k] = np.column_stack(columns)
        pulled = -0.07 * size * ((t >= pull) & (t < pull + 1.6))
        rolled = 0.12 * size * ((t >= roll) & (t < roll + 1.0))
        for _ in range(5):
            elevator = elevator + h * 20.0 * (pulled - elevator)
            aileron = aileron + h * 20.0 * (rolled - aileron)
            alpha = alpha + h * (q - 0.9 * (alpha - 0.05) - 0.02 * p * p)
            q = q + h * (-stiffness * (alpha - 0.05) - 1.2 * q - 9.0 * elevator)
            p = p + h * (-damping * p + 25.0 * aileron)
    over = 40.0 * y[..., 2] + 30.0 * np.abs(y[..., 3]) >= LIMIT
    fail_index = np.where(over.any(axis=1), over.argmax(axis=1), -1)
    return theta, y + NOISE * rng.standard_normal(y.shape), fail_index


def written(path: Path, y: Array, **more: object) -> Path:
    arrays = {"y": y, "dt": DT, "channels": DICTIONARY.keys, **more}
    arrays["units"] = [known.unit for known in DICTIONARY.channels]
    np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
    return path


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    theta, y, fail_index = pull_out(RNG(1), 1800)
    path = tmp_path_factory.mktemp("own") / "pull_out.npz"
    return written(path, y, theta=theta, fail_index=fail_index)


@pytest.fixture(scope="module")
def by_load(source: Path) -> Monitor:
    """Trained by the command on a limit on the load, which the file does not hold."""
    out = source.with_suffix(".fwm")
    limit = ["--channel", LOAD, "--limit", f"load=..{LIMIT}kN*m"]
    assert main(["train", "--rollouts", str(source), *limit, "--out", str(out)]) == 0
    return load(out)


# --- a load that is not measured ------------------------------------------------------------------


def test_a_limit_on_a_load_that_is_not_measured_keeps_the_promise(by_load: Monitor) -> None:
    _, y, fail_index = pull_out(RNG(2), 2000)
    fresh = LabelledFlights.of(y, dt=DT, channels=WITH_LOAD, fail_index=fail_index)
    assert by_load.dictionary.keys == WITH_LOAD.keys
    counts = evaluate(by_load, fresh.y, fresh.fail_index, np.array([0.1]))
    error = np.sqrt(0.1 * 0.9 * (1 / counts.n_unsafe + 1 / len(by_load.alphas)))
    assert counts.n_unsafe > 300
    assert counts.miss_rate[0] <= 0.1 + 3 * error
    assert counts.power[0] > 0.8
    assert counts.safe_withdrawn[0] <= 0.06 * counts.n_safe


def test_a_stream_of_measured_channels_assesses_as_the_whole_flight(by_load: Monitor) -> None:
    _, y, _ = pull_out(RNG(3), 1)
    whole = complete(by_load.dictionary, y, DT)[0]
    np.testing.assert_array_equal(whole[:, 6], 40.0 * y[0, :, 2] + 30.0 * np.abs(y[0, :, 3]))
    stream, computed, streamed = by_load.stream(), Computed(by_load.dictionary), []
    for k, sample in enumerate(y[0]):
        received = np.append(sample, np.nan)
        computed.fill(k * DT, received)
        p_value = stream.update(k * DT, received).p_value
        streamed.append(np.nan if p_value is None else p_value)
    np.testing.assert_array_equal(streamed, by_load.p_values(whole))
    assert np.isfinite(streamed).sum() > 40


def test_a_file_without_the_load_is_scored_by_the_command_line(
    by_load: Monitor, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, flights, fail_index = pull_out(RNG(6), 40)
    y = short_period.resting_first(flights[int(np.flatnonzero(fail_index >= 0)[0])])
    monitor, flight = tmp_path / "load.fwm", tmp_path / "flight.csv"
    by_load.save(monitor)
    table = pd.DataFrame(y, columns=[f"{c.key} [{c.unit}]" for c in DICTIONARY.channels])
    table.insert(0, "t [s]", DT * np.arange(len(y)))
    table.to_csv(flight, index=False)
    assert main(["score", str(monitor), str(flight), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "LIMIT EXCEEDED" in printed
    assert "(load " in printed
    table.drop(columns="p [rad/s]").to_csv(flight, index=False)
    assert main(["score", str(monitor), str(flight), "--out", str(tmp_path / "out")]) != 0
    assert "needs p, which" in capsys.readouterr().err


def test_inputs_on_two_clocks_are_computed_on_the_slower_one() -> None:
    fast, slow = np.arange(400) * np.float64(0.02), np.arange(160) * np.float64(0.05)
    clocks = {"Nz": fast, "alpha": slow, "q": slow, "p": slow, "delta_e": slow, "delta_a": slow}
    traces = Traces({key: Trace(t, 1.0 + 0.1 * t, key) for key, t in clocks.items()})
    grid = on_grid(repair(traces), DT, WITH_LOAD.measured, WITH_LOAD)
    load = grid.judged.channels["load"]
    np.testing.assert_array_equal(load.t, slow)
    np.testing.assert_allclose(load.values, 70.0 * (1.0 + 0.1 * slow), atol=0.05)
    y = grid.recording.y
    np.testing.assert_allclose(y[:, 6], 40.0 * y[:, 2] + 30.0 * np.abs(y[:, 3]), atol=1e-9)


def test_a_live_source_is_asked_for_the_inputs_and_not_for_the_load() -> None:
    reader = ChannelReader(dictionary=WITH_LOAD)
    assert "load" not in reader.names
    needed = WITH_LOAD.sources(["load"])
    reader.check(Batch(0, {"t": [0.0], "Nz": [1.0], "p": [0.2]}), needed)
    (sample,) = reader.samples(Batch(1, {"t": [0.05], "Nz": [2.0], "p": [-0.1]}))
    assert sample.y[6] == 83.0
    with pytest.raises(TelemetryError, match="missing channels: p;"):
        reader.check(Batch(0, {"t": [0.0], "Nz": [1.0]}), needed)
    (sample,) = reader.samples(Batch(2, {"t": [0.1], "Nz": [2.0], "load": [3.0]}))
    assert np.isnan(sample.y[6])


def test_the_certificate_names_the_computed_load(by_load: Monitor, tmp_path: Path) -> None:
    file, page = tmp_path / "load.fwm", tmp_path / "certificate.html"
    by_load.save(file)
    assert main(["certificate", str(file), "--out", str(page)]) == 0
    assert f"below {LIMIT:g} kN*m" in page.read_text()


def test_another_aircraft_is_invalid_where_a_channel_is_computed(by_load: Monitor) -> None:
    _, y, fail_index = pull_out(RNG(4), 60)
    y = y[fail_index < 0]
    foreign = y.copy()
    foreign[..., 1] *= -1.0
    n = np.full(len(y), y.shape[1])
    own = by_load.first_withdrawn(complete(WITH_LOAD, y, DT), n) < n
    assert own.mean() <= 0.15
    assert (by_load.first_withdrawn(complete(WITH_LOAD, foreign, DT), n) < n).all()


# --- what lasts -----------------------------------------------------------------------------------


def test_a_limit_on_what_lasts_fails_only_the_flights_that_stay_over_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, y = short_period.fly(RNG(1), 1800)
    path, out = tmp_path / "pitch.npz", tmp_path / "pitch.fwm"
    keys = short_period.DICTIONARY.keys
    np.savez(path, y=y, dt=DT, channels=keys, units=["rad", "rad/s", "g", "rad"])
    limit = ["--limit", "Nz=-1.0..2.6g for 200 ms"]
    assert main(["train", "--rollouts", str(path), *limit, "--out", str(out), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    monitor = load(out)
    assert monitor.dictionary.keys == (*keys, "Nz_above_0.2s", "Nz_below_0.2s")
    assert monitor.envelope is not None
    assert monitor.envelope.high.tolist()[4:] == [2.6, np.inf]
    assert monitor.envelope.low.tolist()[4:] == [-np.inf, -1.0]
    np.testing.assert_allclose(monitor.envelope.rest[4:], 1.0, atol=0.02)
    over = (y[..., 2] >= 2.6).astype(int)
    under = (y[..., 2] <= -1.0).astype(int)
    # five samples in a row, 0.2 s from the first to the last
    lasted = [
        any("1" * 5 in "".join(map(str, row)) for row in (high, low))
        for high, low in zip(over, under, strict=True)
    ]
    flights = facts["evaluation"]["unsafe_rate"]
    assert flights == pytest.approx(np.mean(lasted))
    assert 0.05 < np.mean(lasted) < 0.9 * over.any(axis=1).mean()
    at = facts["evaluation"]["at_epsilon"]
    assert at["misses"] <= 0.25 * facts["evaluation"]["n_unsafe"]


def read_of(dictionary: Dictionary, y: Array) -> RolloutFile:
    return RolloutFile(y, DT, dictionary)


def test_a_limit_and_one_on_what_lasts_hold_side_by_side() -> None:
    y = np.ones((4, 30, 4))
    texts = ["Nz=..3", "Nz=..2 for 0.1 s", "Nz=0.. for 0.1 s", "q=0.5 for 1s"]
    dictionary, limits, _ = specified(read_of(short_period.DICTIONARY, y), [], texts)
    assert isinstance(limits, IntervalLimits)
    assert limits.intervals == {
        "Nz": SafeInterval(None, 3.0, 1.0),
        "Nz_above_0.1s": SafeInterval(None, 2.0, 1.0),
        "Nz_below_0.1s": SafeInterval(0.0, None, 1.0),
        "q_above_1s": SafeInterval(None, 0.5),
        "q_below_1s": SafeInterval(-0.5, None),
    }
    held = dictionary.channels[5]
    assert (held.formula, held.unit, held.role) == ("-lasting(-Nz, 0.1)", "g", "output")


def test_what_lasts_of_a_channel_with_a_space_is_computed() -> None:
    own = Dictionary("own", (channel("pitch rate", "q", "rad/s", "pitch rate"),))
    own = own.plus(lasting(own.channels[0], 0.1, "below"))
    y = np.array([[1.0, 3.0, 2.0, 0.0, 1.0]])[..., np.newaxis]
    assert complete(own, y, DT)[0, :, 1].tolist() == [1.0, 3.0, 3.0, 3.0, 2.0]


def test_lateral_magnitudes_stay_magnitudes_and_lasting_ones_extend_the_dictionary() -> None:
    y = np.zeros((4, 30, 6))
    assert specified(read_of(LATERAL, y), [], ["Ny=0.5"]) == (LATERAL, Limits(Ny=0.5), ())
    dictionary, *_ = specified(read_of(LATERAL, y), [], ["Ny=0.5 for 0.2s"])
    assert (dictionary.name, len(dictionary)) == ("own", 8)


# --- files and Python -----------------------------------------------------------------------------


def test_a_dictionary_file_holds_formulas_and_the_source_does_not(
    tmp_path: Path, source: Path
) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(
        "key,unit,role,formula\nNz,g,output,\np,rad/s,output,\n"
        'load,kN*m,,"max(40*Nz, 3) + 30*abs(p)"\ndelta_a,rad,control,\n'
    )
    given = read_dictionary(file)
    dictionary = given.dictionary
    assert dictionary.measured == ("Nz", "p", "delta_a")
    assert dictionary.channels[2].reference == "absolute"
    read = read_rollouts(source, given)
    flights = LabelledFlights.of(
        read.y, dt=read.dt, channels=dictionary, fail_index=read.fail_index
    )
    nz, p, held, _ = np.moveaxis(flights.y, 2, 0)
    np.testing.assert_array_equal(held, np.maximum(40 * nz, 3) + 30 * np.abs(p))


def test_python_takes_measured_channels_or_all() -> None:
    _, y, _ = pull_out(RNG(5), 400)
    limits = IntervalLimits(WITH_LOAD, {"load": SafeInterval(high=LIMIT, rest=40.0)})
    whole = complete(WITH_LOAD, y, DT)
    one, other = (
        Dataset.from_rollouts(given, dt=DT, channels=WITH_LOAD, limits=limits)
        for given in (y, whole)
    )
    assert one.digest() == other.digest()
    assert one.dictionary.to_plain()["channels"][-1]["formula"] == "40*Nz + 30*abs(p)"
    assert train(one).dictionary == WITH_LOAD


def test_a_formula_without_a_value_is_refused_with_the_flights_it_concerns() -> None:
    _, y, _ = pull_out(RNG(5), 20)
    y[:3, 10:, 2] = -1.0
    y[3:, :, 2] = 1.0
    y[4, 20:] = np.nan
    own = DICTIONARY.plus(computed_channel("root = sqrt(Nz)"))
    with pytest.raises(RolloutsError, match=r"root = sqrt\(Nz\) .* in 3 of 20"):
        LabelledFlights.of(y, dt=DT, channels=own, fail_index=np.full(20, -1))


# --- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        (["--channel", "load [kN] = 0.7*Nzz", "--limit", "load=..12"], "did you mean Nz?"),
        (["--channel", "load [kNN] = Nz", "--limit", "load=..12"], "'kNN' is not a known unit"),
        (["--channel", "load", "--limit", "load=..12"], "write it as KEY [UNIT] = FORMULA"),
        (["--channel", "Nz = 2*q"], "two channels have the key 'Nz'"),
        (["--channel", "load [kN] = Nz", "--limit", "load=..12kt"], "not a unit of this quantity"),
        (["--limit", "Nz=..2 for ever"], "0.2 s"),
        (["--limit", "Nz=..2 for 20 s"], "at most 10 seconds"),
        (["--limit", "Nz=..2 for 3 m"], "not a unit of this quantity"),
        (["--limit", "Nz= for 0.2 s"], "no limit was given"),
        (["--limit", "load=..12"], "channel 'load' is unknown"),
    ],
)
def test_what_cannot_be_computed_is_one_clear_error(
    rest: list[str], words: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "none.fwm"
    assert main(["train", "--rollouts", str(source), *rest, "--out", str(out)]) != 0
    error = capsys.readouterr().err
    assert words in error
    assert len(error.strip().splitlines()) == 1
    assert not out.exists()


def test_a_computed_channel_without_rollouts_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["train", "--channel", "load = p"]) != 0
    assert "--rollouts" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "key", "unit", "formula"),
    [
        ("load [kN] = 0.7*Nz", "load", "kN", "0.7*Nz"),
        ("wing load[N*m]=Nz", "wing load", "N*m", "Nz"),
        ("λ = [pitch rate]", "λ", "1", "[pitch rate]"),
    ],
)
def test_a_computed_channel_is_a_key_a_unit_and_a_formula(
    text: str, key: str, unit: str, formula: str
) -> None:
    known = computed_channel(text)
    assert (known.key, known.unit, known.formula) == (key, unit, formula)


@pytest.mark.parametrize("text", ["", "=Nz", "[kN] = Nz", "load [kN", "load kN] = Nz"])
def test_what_is_no_computed_channel_says_how_to_write_one(text: str) -> None:
    with pytest.raises(TelemetryError, match="KEY"):
        computed_channel(text)
