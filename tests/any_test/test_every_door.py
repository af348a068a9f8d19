"""A pitch manoeuvre through every door: file, REST, live push, journal, recording, report."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import httpx2
import numpy as np
import pandas as pd
import pytest

from app.assessment.batches import Batch, ChannelReader
from app.assessment.recorded import in_units
from app.cli import main
from app.jobs.training import train_and_test, train_on_flights
from app.telemetry.limit_texts import computed_channel
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import repair
from core.channels import Dictionary, channel
from core.computed import complete
from core.dataset import Dataset
from core.limits.limits import IntervalLimits, SafeInterval
from core.monitor import Monitor, MonitorRecipe
from core.planned_test.collection import collect
from core.rollouts import LabelledFlights
from core.types import Array, Indices
from tests.support import short_period
from tests.support.api import served
from tests.support.own_pitch import small_test, thing
from tests.support.patience import until
from tests.support.short_period import DICTIONARY, DT, REST, resting_first

TEN = Dictionary(
    "ten channels",
    (
        *(
            channel(f"x {k}", f"ξ_{k}", "m/s^2", f"noise {k}", "condition", "absolute")
            for k in range(6)
        ),
        *DICTIONARY.channels,
    ),
)
COMPUTED = DICTIONARY.plus(*map(computed_channel, ("load = Nz", "held = lasting(load, 0.1)")))
"""No source sends the load, which is limited, nor what lasts of it."""


class Own(NamedTuple):
    """A server with a monitor of its own channels, its file, and flights that it has not seen."""

    url: str
    id: str
    monitor: Monitor
    file: Path
    y: Array
    fail_index: Indices

    @property
    def limited(self) -> str:
        """Key of the channel with a limit."""
        return limited_of(self.monitor.dictionary)

    def flight(self, fails: bool) -> Array:
        """At rest first; without NaN."""
        k = int(np.flatnonzero((self.fail_index < self.y.shape[1]) == fails)[0])
        return complete(self.monitor.dictionary, resting_first(self.y[k]), DT)


def limited_of(dictionary: Dictionary) -> str:
    return "load" if dictionary == COMPUTED else "Nz"


def flights(dictionary: Dictionary, n: int, seed: int) -> LabelledFlights:
    rng = np.random.default_rng(seed)
    y = short_period.with_channels(short_period.fly(rng, n)[1], len(dictionary.measured), rng)
    interval = SafeInterval(low=-1.1, high=2.9, rest=1.0)
    limits = IntervalLimits(dictionary, {limited_of(dictionary): interval})
    return LabelledFlights.of(y, dt=DT, channels=dictionary, limits=limits)


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("data")) as (url, _):
        yield url


def stored(url: str, monitor: Monitor) -> str:
    """Id of a monitor that the server was given."""
    answer = httpx2.post(f"{url}/api/v1/monitors?name=own", content=monitor.to_bytes(), headers={
        "Content-Type": "application/octet-stream"})  # fmt: skip
    return answer.raise_for_status().json()["id"]


def trained(dictionary: Dictionary, simulated: bool) -> Monitor:
    """On flights of these channels: given ones, or those of a simulator."""
    if simulated:
        test = small_test(thing, n_unsafe=400, max_rollouts=5_000)
        training = train_and_test(collect(test), MonitorRecipe(), 500, lambda *_: None, test=test)
        return training.monitor
    dataset = Dataset.from_flights(flights(dictionary, 1600, 1))
    return train_on_flights(dataset, MonitorRecipe(), False, lambda *_: None).monitor


@pytest.fixture(
    scope="module",
    params=[(DICTIONARY, False), (TEN, False), (COMPUTED, False), (DICTIONARY, True)],
    ids=["pitch", "ten channels", "computed", "own simulator"],
)
def own(url: str, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Own:
    dictionary, simulated = request.param
    monitor = trained(dictionary, simulated)
    file = tmp_path_factory.mktemp("own") / "pitch.fwm"
    monitor.save(file)
    rng = np.random.default_rng(8)
    y = short_period.with_channels(short_period.fly(rng, 40)[1], len(dictionary.measured), rng)
    y = complete(dictionary, y, DT)
    limits = monitor.specification
    assert isinstance(limits, IntervalLimits)
    fail_index = limits.envelope.first_exceedance(y)
    return Own(url, stored(url, monitor), monitor, file, y, fail_index)


def times(n: int) -> list[float]:
    return (DT * np.arange(n)).round(6).tolist()


def as_telemetry(own: Own, y: Array) -> dict[str, list[float]]:
    """What a source sends: without computed channels."""
    dictionary = own.monitor.dictionary
    channels = {key: y[:, dictionary.index(key)].tolist() for key in dictionary.measured}
    return {"t": times(len(y)), **channels}


def get(url: str) -> Any:
    return httpx2.get(url).raise_for_status().json()


def flown(own: Own, y: Array, trim: str) -> str:
    """The address of an ended live flight with these samples."""
    body = {"source": {"kind": "live", "trim": trim}, "monitor": own.id}
    answer = httpx2.post(f"{own.url}/api/v1/flights", json=body).raise_for_status()
    flight = f"{own.url}/api/v1/flights/{answer.json()['id']}"
    telemetry = as_telemetry(own, y)
    for first in range(0, len(y), 20):
        batch = {key: values[first : first + 20] for key, values in telemetry.items()}
        httpx2.post(f"{flight}/samples", json=batch).raise_for_status()
    httpx2.post(f"{flight}/end").raise_for_status()
    return flight


def test_scored_at_once_is_what_the_library_says(own: Own) -> None:
    y = own.flight(fails=True)
    answer = httpx2.post(f"{own.url}/api/v1/monitors/{own.id}/score", json=as_telemetry(own, y))
    answer.raise_for_status()
    said = [sample["p_value"] for sample in answer.json()["assessments"]]
    expected = own.monitor.assess(np.array(times(len(y))), y).p_value
    np.testing.assert_array_equal(np.array(said, float), expected)


def test_a_channel_of_another_dictionary_is_refused_by_name(own: Own) -> None:
    telemetry = as_telemetry(own, own.y[0]) | {"beta": [0.0] * own.y.shape[1]}
    answer = httpx2.post(f"{own.url}/api/v1/monitors/{own.id}/score", json=telemetry)
    assert answer.status_code == 422
    assert "no channel 'beta'" in answer.text


@pytest.mark.parametrize("trim", ["none", "detected"])
def test_a_failing_flight_is_an_alarm_with_its_channel_and_limit(own: Own, trim: str) -> None:
    y = own.flight(fails=True)
    flight = flown(own, y, trim)
    ended = get(flight)
    (exceeded,) = ended["exceedances"]
    assert exceeded["channel"] == own.limited
    nz = own.monitor.dictionary.index("Nz")
    beyond = np.flatnonzero((y[:, nz] <= -1.1) | (y[:, nz] >= 2.9))
    assert exceeded["first_t"] == pytest.approx(beyond[0] * DT)
    assert exceeded["limit"] == (2.9 if y[beyond[0], nz] > 0 else -1.1)
    record = get(f"{flight}/assessments")["frames"]
    assert len(record) == len(y)
    assert len(record[0]["y"]) == len(own.monitor.dictionary)
    assert ended["status"] == "alarm"
    if trim == "detected":
        assert {frame["state"] for frame in record[: REST - 5]} == {"warming_up"}
        assert any(frame["state"] == "ok" for frame in record[REST:])


def test_a_safe_flight_is_quiet_and_valid(own: Own) -> None:
    record = get(f"{flown(own, own.flight(fails=False), 'detected')}/assessments")["frames"]
    states = [frame["state"] for frame in record]
    assert "invalid" not in states
    assert states.count("ok") > 40


def test_the_recording_of_a_flight_is_scored_as_it_was_shown(own: Own) -> None:
    flight = flown(own, own.flight(fails=True), "detected")
    shown = get(f"{flight}/assessments")["frames"]
    until(lambda: get(flight)["recording"] is not None)
    address = f"{own.url}/api/v1/recordings/{get(flight)['recording']}"
    body = {"monitor": own.id}
    scoring = httpx2.post(f"{address}/scorings", json=body).raise_for_status().json()
    assert [each["key"] for each in scoring["channels"]] == [*own.monitor.dictionary.keys]
    frames = get(f"{address}/scorings/{scoring['id']}/assessments")["frames"]
    of_manoeuvre = [frame for frame in shown if frame["p_value"] is not None]
    assert of_manoeuvre
    scored = {round(frame["t"], 6): frame["p_value"] for frame in frames}
    assert [scored[round(frame["t"], 6)] for frame in of_manoeuvre] == [
        frame["p_value"] for frame in of_manoeuvre
    ]
    assert scoring["manoeuvres"][0]["exceedance"]["channel"] == own.limited
    tiles = get(f"{address}/scorings/{scoring['id']}/tiles")
    assert list(tiles["channels"]) == [*own.monitor.dictionary.keys]
    for form in ("csv", "parquet", "mat"):
        export = f"{address}/scorings/{scoring['id']}/export?format={form}"
        assert own.limited.encode() in httpx2.get(export).raise_for_status().content
    report = httpx2.get(f"{address}/scorings/{scoring['id']}/report").raise_for_status()
    dictionary = own.monitor.dictionary
    assert dictionary.channels[dictionary.index(own.limited)].label in report.text


def test_a_flight_is_replayed_from_its_journal(own: Own) -> None:
    flight = flown(own, own.flight(fails=True), "detected")
    source = {"kind": "journal", "flight_id": flight.rsplit("/", 1)[1]}
    body = {"source": source, "monitor": own.id}
    answer = httpx2.post(f"{own.url}/api/v1/flights", json=body).raise_for_status().json()
    replay = f"{own.url}/api/v1/flights/{answer['id']}"
    httpx2.post(f"{replay}/transport", json={"action": "speed", "value": 10}).raise_for_status()
    until(lambda: get(replay)["head"] not in (None, -1))
    httpx2.post(f"{replay}/end").raise_for_status()


def test_a_file_is_scored_by_the_command_line(
    own: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = own.flight(fails=True)
    units = {"rad": ("deg", np.degrees(1.0)), "rad/s": ("deg/s", np.degrees(1.0))}
    columns = {"t [s]": times(len(y))}
    for known, values in zip(own.monitor.dictionary.channels, y.T, strict=True):
        if known.formula:
            continue
        unit, factor = units.get(known.unit, (known.unit, 1.0))
        columns[f"{known.key} [{unit}]"] = (values * factor).tolist()
    file = tmp_path / "flight.csv"
    pd.DataFrame(columns).to_csv(file, index=False)
    out = tmp_path / "out"
    assert main(["score", str(own.file), str(file), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "LIMIT EXCEEDED" in printed
    assert f"({own.limited} " in printed
    strips = len(own.monitor.dictionary) + 1
    assert (out / "scored.svg").read_text().count('class="frame"') == strips
    table = pd.read_csv(out / "assessments.csv", comment="#")
    assert len(table) == len(y)


@pytest.mark.parametrize("n", [1, 3, 32])
def test_failures_known_by_label_alone_have_a_risk_and_no_limit(url: str, n: int) -> None:
    names = [f"größe {k} α" for k in range(n - 1)]
    dictionary = Dictionary(
        "labelled",
        (
            *(channel(key, "α", "m", f"output {key}", "output", "absolute") for key in names),
            channel("δ", "δ", "rad", "stick", "control", "absolute"),
        ),
    )
    rng = np.random.default_rng(3)
    whole = short_period.fly(rng, 800)[1]
    y = short_period.with_channels(whole, n, rng)
    fail = short_period.LIMITS.envelope.first_exceedance(whole)
    labelled = LabelledFlights.of(y, dt=DT, channels=dictionary, fail_index=fail)
    recipe = MonitorRecipe(epsilon=0.5)
    monitor = train_on_flights(Dataset.from_flights(labelled), recipe, False, print).monitor
    flight = flown(Own(url, stored(url, monitor), monitor, Path(), y, fail), y[0], "none")
    assert get(flight)["exceedances"] == []
    frames = get(f"{flight}/assessments")["frames"]
    assert len(frames) == len(y[0])
    expected = monitor.assess(np.array(times(len(y[0]))), y[0]).p_value
    said = np.array([frame["p_value"] for frame in frames], float)
    np.testing.assert_array_equal(said, expected)


def test_a_missing_channel_is_named_and_not_calm(own: Own) -> None:
    body = {"source": {"kind": "live", "trim": "none"}, "monitor": own.id}
    answer = httpx2.post(f"{own.url}/api/v1/flights", json=body).raise_for_status().json()
    flight = f"{own.url}/api/v1/flights/{answer['id']}"
    telemetry = as_telemetry(own, own.flight(fails=False))
    first = {key: values[:20] for key, values in telemetry.items() if key != "q"}
    refused = httpx2.post(f"{flight}/samples", json=first)
    assert refused.status_code == 422
    assert "missing channels: q" in refused.text
    httpx2.post(f"{flight}/samples", json={k: v[:20] for k, v in telemetry.items()})
    second = {key: values[20:40] for key, values in telemetry.items() if key != "q"}
    httpx2.post(f"{flight}/samples", json=second).raise_for_status()
    httpx2.post(f"{flight}/end").raise_for_status()
    frames = get(f"{flight}/assessments")["frames"]
    assert {frame["state"] for frame in frames[20:]} == {"invalid"}
    assert "q is missing" in frames[-1]["reason"]


def test_a_value_beyond_the_largest_plausible_one_is_missing_live_and_recorded() -> None:
    bounded = replace(channel("q", "q", "rad/s", "pitch rate"), largest=2.0)
    dictionary = Dictionary("bounded", (bounded, channel("heading", "ψ", "rad", "heading")))
    reader = ChannelReader(dictionary=replace(dictionary, channels=(
        bounded, replace(dictionary.channels[1], largest=None))))  # fmt: skip
    (live,) = reader.samples(Batch(None, {"t": [0.0], "q": [2.5], "heading": [6.0]}))
    assert np.isnan(live.y[0])
    assert live.y[1] == 6.0
    trace = Trace(np.arange(3.0), np.array([0.1, 2.5, 0.2]), unit="rad/s")
    recorded = in_units(repair(Traces({"q": trace})), dictionary)
    np.testing.assert_array_equal(recorded.traces.channels["q"].values, [0.1, np.nan, 0.2])


def test_an_own_angle_has_no_bound_unless_it_is_given() -> None:
    plain = {"name": "own", "channels": [{"key": "heading", "unit": "rad"}]}
    assert Dictionary.from_plain(plain).channels[0].largest is None
