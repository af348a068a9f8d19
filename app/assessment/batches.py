"""Batches of sources: JSON objects, read into channels by the flight's mapping."""

import collections.abc as abc
from collections.abc import Collection
from dataclasses import dataclass
from math import isfinite
from operator import gt
from typing import Any, NamedTuple

import msgspec
import numpy as np

from app.assessment.grid import Sample
from app.telemetry.mapping.applying import derivation_order
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.readers.journal import TIMES
from app.telemetry.recording import ATTITUDE, TelemetryError
from app.telemetry.scaling import Scaling
from app.telemetry.targets import TARGETS, largest_plausible, target_of
from app.telemetry.units import convert
from core.channels import LATERAL, Dictionary
from core.computed import Computed
from core.conditions import CONDITION_KEYS, CONDITIONS, ConditionKey

MOST_SAMPLES = 1_000
"""Most samples per batch: more would delay other flights."""
DEEPEST = 4
WITH_MEMORY = ("p_from_attitude", "r_from_attitude")
"""Derivations by slopes, which need future samples."""

Values = dict[str, list[Any]]
Names = abc.Mapping[ConditionKey, str]
NAN = float("nan")
_NUMBER = {float: float, int: float}
_FLOATS = {float}
_decoder = msgspec.json.Decoder()

MOST_S = 1e11
"""No source has later times [s]; since 1970 in ms or finer, they are."""


class Batch(NamedTuple):
    """A batch of a source.

    sequence: its number; None if the source gives none.   single: its values, if it is one sample
    that consists of numbers alone; else None.
    """

    sequence: int | None
    values: Values
    single: abc.Mapping[str, float] | None = None


def decode_batch(content: bytes | str) -> Batch:
    """Read a batch: {"sequence": n, name: value or list of values, ...}. TelemetryError.

    Members of nested objects get names like a/b.
    """
    try:
        plain = _decoder.decode(content)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        reason = f"not JSON ({error})" if content.strip() else "empty"
        raise TelemetryError(
            f"the batch is {reason}: send an object such as "
            '{"sequence": 1, "t": 0.02, "beta": 0.01, ...}, with null, not NaN, for unknown values'
        ) from None
    if not isinstance(plain, dict):
        raise TelemetryError(
            "the batch is not a JSON object: send names with a list of values each"
        )
    sequence = plain.pop("sequence", None)
    if sequence is not None and (type(sequence) is not int or not 0 <= sequence <= 2**53):
        raise TelemetryError(f"sequence is {str(sequence)[:40]!r}: number the batches 0, 1, 2 ...")
    if {*map(type, plain.values())} == _FLOATS:
        return Batch(sequence, {name: [value] for name, value in plain.items()}, plain)
    values: Values = {}
    _flatten(plain, "", values, DEEPEST)
    return Batch(sequence, values)


def sequence_of(content: bytes | str) -> int | None:
    """Sequence number of a message that may not be a batch; None if it has none."""
    try:
        plain = _decoder.decode(content)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError):
        return None
    sequence = plain.get("sequence") if isinstance(plain, dict) else None
    return sequence if type(sequence) is int else None


def _flatten(plain: dict[str, Any], prefix: str, values: Values, depth: int) -> None:
    for name, value in plain.items():
        if isinstance(value, dict):
            if depth == 0:
                raise TelemetryError(f"{prefix}{name} is nested too deeply: send flatter objects")
            _flatten(value, f"{prefix}{name}/", values, depth - 1)
        elif isinstance(value, list):
            if len(value) > MOST_SAMPLES:
                raise TelemetryError(
                    f"{prefix}{name} has {len(value)} samples: send at most {MOST_SAMPLES}"
                )
            values[prefix + name] = value
        else:
            values[prefix + name] = [value]


@dataclass(frozen=True)
class _Direct:
    """A channel taken from one signal: value * scale + shift.   bits: of its words."""

    name: str
    scale: float = 1.0
    shift: float = 0.0
    bits: str = ""

    def __call__(self, values: Values, n: int) -> list[float]:
        numbers = _numbers(values, self.name, n)
        if self.is_plain:
            return numbers
        if self.bits:
            numbers = Scaling(bits=self.bits)(np.array(numbers)).tolist()
        return [value * self.scale + self.shift for value in numbers]

    @property
    def is_plain(self) -> bool:
        """Whether values need no conversion."""
        return self.scale == 1.0 and self.shift == 0.0 and not self.bits


class ChannelReader:
    """Turns batches into samples by a mapping; without one, names are our keys in SI units.

    conditions: names of the channels of the flight condition in a batch; by default their own.
    They are in SI units, or in those of the channel that is read from the same name.
    dictionary: of the samples.
    TelemetryError for a mapping that cannot read live samples.
    """

    def __init__(
        self,
        mapping: Mapping | None = None,
        conditions: Names | None = None,
        dictionary: Dictionary = LATERAL,
    ) -> None:
        self.mapping, self.conditions = mapping, conditions or {}
        self._channels, self._computed = dictionary.channels, Computed(dictionary)
        self._bounds = tuple(map(largest_plausible, dictionary.channels))
        self._keys = (*dictionary.keys, *ATTITUDE)
        self._time: _Direct | None = None
        self._direct = {key: _Direct(key) for key in (*dictionary.measured, *ATTITUDE)}
        self._derived: dict[str, ChannelSource] = {}
        if mapping is not None:
            self._time = _time_of(mapping)
            self._direct = {
                key: _direct(key, source, dictionary)
                for key, source in mapping.channels.items()
                if source.signal
            }
            self._derived = {key: mapping.channels[key] for key in derivation_order(mapping)}
        self._sources = {c.key: ChannelSource(c.key, c.unit) for c in dictionary.channels}
        if mapping is not None:
            self._sources = {source.signal: source for source in mapping.channels.values()}
        self._conditions = [
            _condition(key, self.conditions.get(key, key), self._sources) for key in CONDITION_KEYS
        ]
        self._condition_names = frozenset(read.name for read in self._conditions)
        self._read = {*([self._time.name] if self._time else TIMES), *self._names}
        self._columns = [self._direct.get(key) for key in self._keys]
        plain = [read.name for read in self._columns if read and read.is_plain]
        self._plain_names = plain if len(plain) == len(self._columns) else []
        self._unknown = [NAN] * len(plain)
        for key, source in self._derived.items():
            if source.derivation in WITH_MEMORY:
                raise TelemetryError(
                    f"{key} is derived by slopes, which need future samples: in a live flight the "
                    "source must send it"
                )
            _check_units(key, source, dictionary)

    @property
    def _names(self) -> list[str]:
        return [read.name for read in (*self._direct.values(), *self._conditions)]

    @property
    def names(self) -> list[str]:
        """Names that a batch contains: time, then each signal that is read."""
        time = self._time.name if self._time else TIMES[0]
        return [time, *(direct.name for direct in self._direct.values())]

    def condition_of(self, key: ConditionKey) -> tuple[str, str]:
        """Name of a channel of the flight condition in a batch, and its unit there."""
        name = self.conditions.get(key, key)
        source = self._sources.get(name)
        return name, (source and source.unit) or CONDITIONS[key].unit

    def unread(self, batch: Batch) -> list[str]:
        """Names in a batch that are not read, in its order."""
        if batch.values.keys() <= self._read:
            return []
        return [name for name in batch.values if name not in self._read]

    def check(self, batch: Batch, needed: Collection[str]) -> None:
        """TelemetryError if a flight cannot begin with this batch."""
        samples = self.samples(batch)
        latest = max(samples, key=lambda sample: abs(sample.t)).t
        if abs(latest) > MOST_S:
            raise TelemetryError(f"a time of {latest:.4g} s is implausible: send times in seconds")
        lacking = [
            channel.key
            for c, channel in enumerate(self._channels)
            if channel.key in needed and all(np.isnan(sample.y[c]) for sample in samples)
        ]
        if not lacking:
            return
        odd = next((sample.reason for sample in samples if sample.reason), "")
        from_ = {key: d.name for key, d in self._direct.items()}
        named = ", ".join(
            key if from_.get(key, key) == key else f"{key} ({from_[key]})" for key in lacking
        )
        sent = ", ".join([*batch.values][:20]) or "nothing"
        raise TelemetryError(
            f"{odd}: check its unit"
            if odd
            else f"missing channels: {named}; the batch contains {sent}: "
            "send all channels of the monitor by these names, or start the flight with a recording "
            "that maps yours"
        )

    def samples(self, batch: Batch) -> list[Sample]:
        """The samples of a batch, in its order; implausible values are missing. TelemetryError."""
        values = batch.values
        samples = self._samples(batch)
        if not self._condition_names.isdisjoint(values):
            n = len(samples)
            columns = [
                read(values, n) if read.name in values else None for read in self._conditions
            ]
            return [
                sample._replace(condition=tuple(column and column[k] for column in columns))
                for k, sample in enumerate(samples)
            ]
        return samples

    def _samples(self, batch: Batch) -> list[Sample]:
        """The samples without the flight condition."""
        values = batch.values
        times = self._times(values)
        n = len(times)
        if n == 1 and not self._derived:
            return [self._sample(times[0], self._row(batch))]
        channels = {
            key: read(values, n) for key, read in self._direct.items() if read.name in values
        }
        if self._derived:
            self._derive(channels, times)
        unknown = [NAN] * n
        columns = [channels.get(key, unknown) for key in self._keys]
        rows = zip(times, zip(*columns, strict=True), strict=True)
        return [self._sample(t, row) for t, row in rows]

    def _sample(self, t: float, row: tuple[float, ...]) -> Sample:
        """A sample of the channels, then the attitude; implausible values are missing."""
        n, bounds = len(self._channels), self._bounds
        y, reason, sent = np.array(row[:n]), "", None
        if any(map(gt, map(abs, row), bounds)):
            for c, channel in enumerate(self._channels):
                if abs(row[c]) > bounds[c]:
                    text = f"{channel.key} of {row[c]:.4g} {channel.unit} is implausible"
                    reason, y[c] = reason or text, NAN
            sent = np.array(row[:n])
        self._computed.fill(t, y)
        phi, theta, psi = row[n:]
        return Sample(t, y, (phi, theta, psi), reason, sent=sent)

    def _row(self, batch: Batch) -> tuple[float, ...]:
        """The only sample of a batch: the channels, then ATTITUDE."""
        if self._plain_names and batch.single is not None:
            return tuple(map(batch.single.get, self._plain_names, self._unknown))
        return tuple([read(batch.values, 1)[0] if read else NAN for read in self._columns])

    def _times(self, values: Values) -> list[float]:
        mapped = self._time.name if self._time else None
        name = mapped or next(filter(values.__contains__, TIMES), TIMES[0])
        given = values.get(name)
        if not values:
            raise TelemetryError(f"the batch is empty: send {name!r} in s, and each channel")
        if not given:
            sent = ", ".join([*values][:20])
            raise TelemetryError(f"the batch has no time {name!r}, only {sent}: add it, in s")
        if self._time is None or self._time.is_plain:
            times = _numbers(values, name, len(given))
        else:
            times = self._time(values, len(given))
        if not all(map(isfinite, times)):
            raise TelemetryError(f"{name} has a missing or infinite value: send each sample's time")
        return times

    def _derive(self, channels: dict[str, list[float]], times: list[float]) -> None:
        t = np.array(times)
        for key, source in self._derived.items():
            way = DERIVATIONS[source.derivation]
            helps = way.helps if channels.keys() >= {*way.helps} else ()
            if any(need not in channels for need in way.needs):
                continue
            inputs = {need: np.array(channels[need]) for need in (*way.needs, *helps)}
            derived = source.sign * way.apply(t, inputs) - source.bias
            channels[key] = derived.tolist()


def _direct(key: str, source: ChannelSource, dictionary: Dictionary) -> _Direct:
    what = f"{key} ({source.signal})"
    try:
        mapped = target_of(key, source.unit).unit
    except TelemetryError as error:
        raise TelemetryError(f"unit of {what}: {error}") from None
    scale, shift = _scaled(source, mapped, what)
    scale, shift = source.sign * scale, source.sign * shift - source.bias
    channel = dictionary.by_key.get(key)
    if channel is not None and channel.unit != mapped:
        factor, zero = _factor(mapped, channel.unit, what)
        scale, shift = factor * scale, factor * shift + zero
    return _Direct(source.signal, scale, shift, source.bits)


def _scaled(source: ChannelSource, target: str, what: str) -> tuple[float, float]:
    """Scale and shift from the numbers of a source to a unit."""
    if problem := source.scaling.problem():
        raise TelemetryError(f"{what} {problem}")
    scale, shift = _factor(source.unit, target, what)
    return scale * source.scale, scale * source.offset + shift


def _condition(key: ConditionKey, name: str, sources: abc.Mapping[str, ChannelSource]) -> _Direct:
    """A channel of the flight condition. sources: by the names that channels are read from."""
    source, own = sources.get(name), CONDITIONS[key].unit
    if source is None or not source.unit or not own:
        return _Direct(name)
    return _Direct(name, *_scaled(source, own, f"{key} ({name})"), source.bits)


def _check_units(key: str, source: ChannelSource, dictionary: Dictionary) -> None:
    """TelemetryError for a derived channel if it or an input is not in the usual unit."""
    way = DERIVATIONS[source.derivation]
    for part in (key, *way.needs, *way.helps):
        channel = dictionary.by_key.get(part)
        if channel is not None and channel.unit != TARGETS[part].unit:
            raise TelemetryError(
                f"{key} cannot be derived in a live flight, because the monitor has {part} in "
                f"{channel.unit}, not in {TARGETS[part].unit}: the source must send {key}"
            )


def _time_of(mapping: Mapping) -> _Direct:
    sources = [source for source in mapping.times.values() if source.signal]
    if len(sources) != 1:
        raise TelemetryError(
            f"the mapping has {len(sources)} time signals: a live flight needs exactly one"
        )
    (source,) = sources
    scale, shift = _factor(source.unit, "s", f"the time {source.signal}")
    return _Direct(source.signal, scale, shift)


def _factor(unit: str, target: str, what: str) -> tuple[float, float]:
    try:
        zero, unity = convert(np.array([0.0, 1.0]), unit, target).tolist()
    except TelemetryError as error:
        raise TelemetryError(f"unit of {what}: {error}") from None
    return unity - zero, zero


def _numbers(values: Values, name: str, n: int) -> list[float]:
    """n numbers, NaN for null and absent ones. TelemetryError."""
    given = values.get(name)
    if given is None:
        return [NAN] * n
    if len(given) != n:
        raise TelemetryError(
            f"{name} has {len(given)} samples but the time has {n}: send equally many"
        )
    if {*map(type, given)} == _FLOATS:
        return given
    try:
        return [NAN if v is None else _NUMBER[type(v)](v) for v in given]
    except (KeyError, OverflowError):
        raise TelemetryError(
            f"{name} contains a non-number: send a number or null per sample"
        ) from None
