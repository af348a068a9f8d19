"""Batches of one sample and of many: the same samples, bit for bit, or the same refusal."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.assessment.batches import ChannelReader, Names, decode_batch
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from core.channels import KEYS, LATERAL, channel
from core.conditions import CONDITION_KEYS
from tests.support.tables import columns_of

MAPPED = Mapping(
    {"beta": ChannelSource("aos", "deg", -1, 0.1), "p": ChannelSource("p", "rad/s")},
    {"": TimeSource("t")},
)
VALUES: tuple[Any, ...] = (0.0, -0.0, 0.25, 3, None, 1e9)


@pytest.mark.parametrize("t", [1.7e12, -1.7e15, 1.7e18])
def test_no_flight_begins_with_a_time_that_is_no_second(t: float) -> None:
    batch = decode_batch(f'{{"t": [0.0, {t}], "beta": [0, 0]}}')
    with pytest.raises(TelemetryError, match=r"is implausible: send times in seconds"):
        ChannelReader(None).check(batch, ("beta",))


COUNTED = Mapping(
    {
        "beta": ChannelSource("aos", "deg", -1, 0.1, scale=0.5, offset=-3.0, bits="2-6 signed"),
        "p": ChannelSource("p", "rad/s", scale=1e-3),
    },
    {"": TimeSource("t")},
)


def test_raw_counts_are_those_of_a_recording(tmp_path) -> None:
    counts = np.arange(50.0)
    columns = columns_of(tmp_path, {"t": counts, "aos": counts, "p": counts})
    recorded = apply_mapping(columns, COUNTED).channels
    rows = {"t": counts.tolist(), "aos": counts.tolist(), "p": counts.tolist()}
    samples = ChannelReader(COUNTED).samples(decode_batch(json.dumps(rows)))
    for key in ("beta", "p"):
        y = [sample.y[KEYS.index(key)] for sample in samples]
        np.testing.assert_allclose(y, recorded[key].values, rtol=0, atol=1e-15)


def test_a_condition_is_scaled_as_the_channel_of_its_name() -> None:
    height = channel("altitude", "h", "ft", "altitude")
    source = ChannelSource("alt", "ft", scale=4.0, offset=100.0, bits="1-16")
    mapping = Mapping(MAPPED.channels | {"altitude": source}, MAPPED.times)
    reader = ChannelReader(mapping, {"altitude": "alt"}, LATERAL.plus(height))
    (sample,) = reader.samples(decode_batch('{"t": 0.0, "beta": 0.1, "alt": 2475}'))
    assert sample.condition is not None
    assert sample.condition[CONDITION_KEYS.index("altitude")] == pytest.approx(3048.0)
    assert sample.y[-1] == pytest.approx(10000.0)


@pytest.mark.parametrize("mapping", [None, MAPPED, COUNTED], ids=["own names", "mapped", "counts"])
def test_samples_sent_alone_are_those_sent_together(mapping: Mapping | None) -> None:
    reader, generator = ChannelReader(mapping), np.random.default_rng(0)
    names = ("aos", "p", "mach") if mapping else (*KEYS, "phi", "theta", "mach")
    picks = generator.integers(len(VALUES), size=(60, len(names)))
    rows = [dict(zip(names, [VALUES[k] for k in row], strict=True)) for row in picks]
    together = reader.samples(
        decode_batch(
            repr({"t": [*range(60)], **{n: [row[n] for row in rows] for n in names}})
            .replace("'", '"')
            .replace("None", "null")
        )
    )
    for t, (row, expected) in enumerate(zip(rows, together, strict=True)):
        text = repr({"t": t, **row}).replace("'", '"').replace("None", "null")
        (alone,) = reader.samples(decode_batch(text))
        assert alone.y.tobytes() == expected.y.tobytes()
        assert repr((alone.t, *alone[2:])) == repr((expected.t, *expected[2:]))
        assert (alone.condition or ())[1:] == (None,) * (len(CONDITION_KEYS) - 1)


@pytest.mark.parametrize("is_mapped", [False, True], ids=["own names", "mapped"])
def test_a_condition_that_is_a_channel_is_read_in_its_unit(is_mapped: bool) -> None:
    height = channel("altitude", "h", "ft", "altitude")
    source = {"altitude": ChannelSource("alt", "ft")}
    mapping = Mapping(MAPPED.channels | source, MAPPED.times) if is_mapped else None
    names: Names | None = {"altitude": "alt"} if is_mapped else None
    reader = ChannelReader(mapping, names, LATERAL.plus(height))
    name = "alt" if is_mapped else "altitude"
    (sample,) = reader.samples(decode_batch(f'{{"t": 0.0, "beta": 0.1, "{name}": 10000.0}}'))
    assert sample.condition is not None
    assert sample.condition[CONDITION_KEYS.index("altitude")] == pytest.approx(3048.0)
    assert sample.y[-1] == pytest.approx(10000.0)


def test_a_computed_channel_that_is_sent_is_not_read_of_one_sample_nor_of_many() -> None:
    load = replace(channel("load", "load", "N", "load"), largest=10.0, formula="2*beta")
    reader = ChannelReader(dictionary=LATERAL.plus(load))
    batches = [
        decode_batch('{"t": 0.0, "beta": 0.25, "load": 99.0}'),
        decode_batch('{"t": [0.0, 0.1], "beta": [0.25, 0.25], "load": [99, 99]}'),
    ]
    for batch in batches:
        sample = reader.samples(batch)[0]
        assert (sample.y[0], sample.y[-1], sample.reason) == (0.25, 0.5, "")
        assert reader.unread(batch) == ["load"]


@pytest.mark.parametrize("value", ['"x"', "true", "[]", "[1, 2]", "1" + 400 * "0"])
def test_what_is_no_number_is_refused_of_one_sample_too(value: str) -> None:
    with pytest.raises(TelemetryError):
        ChannelReader().samples(decode_batch(f'{{"t": 0.0, "beta": {value}}}'))


@pytest.mark.parametrize("content", ["", b"", " \n"])
def test_an_empty_batch_is_called_empty(content: str | bytes) -> None:
    with pytest.raises(TelemetryError, match="the batch is empty: send an object"):
        decode_batch(content)


@pytest.mark.parametrize("content", ["{}", '{"sequence": 3}'])
def test_a_batch_without_values_is_called_empty_and_what_to_send_is_named(content: str) -> None:
    with pytest.raises(TelemetryError, match="the batch is empty: send 't' in s"):
        ChannelReader().samples(decode_batch(content))
