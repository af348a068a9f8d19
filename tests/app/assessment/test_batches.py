"""Batches of one sample and of many: the same samples, bit for bit, or the same refusal."""

from typing import Any

import numpy as np
import pytest

from app.assessment.batches import ChannelReader, decode_batch
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from core.channels import KEYS

MAPPED = Mapping(
    {"beta": ChannelSource("aos", "deg", -1, 0.1), "p": ChannelSource("p", "rad/s")},
    {"": TimeSource("t")},
)
VALUES: tuple[Any, ...] = (0.0, -0.0, 0.25, 3, None, 1e9)


@pytest.mark.parametrize("mapping", [None, MAPPED], ids=["own names", "mapped"])
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
        assert (alone.condition or ())[1:] == (None, None)


@pytest.mark.parametrize("value", ['"x"', "true", "[]", "[1, 2]", "1" + 400 * "0"])
def test_what_is_no_number_is_refused_of_one_sample_too(value: str) -> None:
    with pytest.raises(TelemetryError):
        ChannelReader().samples(decode_batch(f'{{"t": 0.0, "beta": {value}}}'))
