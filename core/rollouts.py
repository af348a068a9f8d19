"""Labelled flights of any simulator, or flown ones: checked, and split by flight."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from math import isfinite

import numpy as np
import numpy.typing as npt

from core.channels import DICTIONARIES, Dictionary, known_channels
from core.computed import complete
from core.counted import counted
from core.limits.limits import IntervalLimits, Limits, Specification, envelope_of
from core.recipe import instead_of
from core.types import Array, Flags, Indices, real_numbers

LABEL = "labels of the rollouts"
"""Specification of rollouts whose failures are known by their label alone."""
SEPARATES = 0.995
"""A channel whose first sample ranks failing above safe flights this surely leaks the label."""
FEWEST_RANKED = 20
"""Flights of either kind needed to say that a channel leaks the label."""
MOST_NAMED = 20
"""Most flights left out to name."""
SAME_SIZE = 1e-3
"""Relative difference between files of one flight."""
UNLABELLED = -2
"""Label of a flight whose failure only the limits tell."""


class RolloutsError(ValueError):
    """Rollouts that cannot train a monitor."""


@dataclass(frozen=True)
class FlownManoeuvre:
    """A manoeuvre of a flown flight.

    flight: name of its recording.   digest: SHA-256 of the recording's file, which tells flights
    apart.   start, end: [s] in the recording's own time.   recording: its id, if it is stored.
    sizes: of the recording, see `is_same_flight`; empty if an earlier version stored it.
    """

    flight: str
    digest: str
    manoeuvre: str
    start: float
    end: float
    recording: str = ""
    sizes: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", tuple(self.sizes))


def is_same_flight(sizes: Sequence[float], others: Sequence[float]) -> bool:
    """Whether two recordings are of one flight, whatever their files.

    sizes, others: duration [s], then standard deviation and range of each measured channel, NaN if
    it was not recorded. Files may differ in sample rate, rounding, start and bias.
    """
    pairs = [(a, b) for a, b in zip(sizes, others, strict=False) if isfinite(a) and isfinite(b)]
    is_known = len(sizes) == len(others) and any(a > 0.0 for a, _ in pairs[1:])
    return is_known and all(abs(a - b) <= SAME_SIZE * max(a, b) for a, b in pairs)


@dataclass(frozen=True, eq=False)
class LabelledFlights:
    """Flights of one manoeuvre, sampled at dt [s] over one horizon.

    y: (n, n_samples, n_channels) SI units, N_y and N_z in g; NaN after the failure.
    fail_index: (n,) first sample that fails, n_samples for a safe flight.
    theta: (n, n_parameters), no columns if unknown.
    findings: what was left out or looks implausible, in words.
    flown: of each flight, None for a simulated one; empty if all are simulated.
    """

    y: Array
    fail_index: Indices
    theta: Array
    dt: float
    dictionary: Dictionary
    specification: Specification
    theta_names: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    flown: tuple[FlownManoeuvre | None, ...] = ()

    @property
    def fails(self) -> Flags:
        return self.fail_index < self.y.shape[1]

    @property
    def is_flown(self) -> Flags:
        flown = self.flown or (None,) * len(self.y)
        return np.array([each is not None for each in flown], bool)

    def some(self, which: Flags | Indices) -> "LabelledFlights":
        return replace(
            self,
            y=self.y[which],
            fail_index=self.fail_index[which],
            theta=self.theta[which],
            flown=self.flown and tuple(self.flown[k] for k in np.arange(len(self.y))[which]),
        )

    @classmethod
    def of(
        cls,
        y: npt.ArrayLike,
        *,
        dt: float,
        channels: Dictionary | Sequence[str],
        fail_index: npt.ArrayLike | None = None,
        limits: Limits | IntervalLimits | None = None,
        theta: npt.ArrayLike | None = None,
        theta_names: Sequence[str] = (),
        flown: Sequence[FlownManoeuvre | None] = (),
    ) -> "LabelledFlights":
        """Check flights and label them.

        y: (n, n_samples, n_channels) SI units, N_y and N_z in g; NaN after the end of a flight.
        Computed channels are computed, so they may be left out; those of flown flights are kept.
        channels: a dictionary, or keys of the built-in ones.
        fail_index: (n,) first sample that fails, -1 or n_samples for a safe flight. Without it, or
        where it is UNLABELLED, limits tell; with both, the label wins and `findings` count the
        disagreements.
        flown: of each flight, None for a simulated one; empty if all are simulated.
        RolloutsError if the flights cannot train a monitor.
        """
        try:
            y = np.ascontiguousarray(real_numbers(y, "y"))
        except ValueError as error:
            raise RolloutsError(str(error)) from None
        dictionary = channels if isinstance(channels, Dictionary) else dictionary_of(channels)
        widths = (len(dictionary), len(dictionary.measured))
        if y.ndim != 3 or y.shape[2] not in widths or min(y.shape[:2]) < 2:
            raise RolloutsError(
                f"y has shape {y.shape}: give (flights, samples, {widths[1]}), two or more "
                f"flights and samples, channels {', '.join(dictionary.measured)}"
            )
        if not np.isfinite(y).any():
            raise RolloutsError("y has no number that is finite: check what wrote the flights")
        if not dt > 0:
            raise RolloutsError(f"dt={dt} s was given: give a positive sample interval")
        y = _completed(y, dt, dictionary, [each is not None for each in flown])
        fail, findings = labels(y, fail_index, limits)
        _check_finite(y, fail, dictionary)
        theta = np.empty((len(y), 0)) if theta is None else np.array(theta, np.float64)
        if theta.ndim != 2 or len(theta) != len(y):
            raise RolloutsError(f"theta has shape {theta.shape}: give one row for each of {len(y)}")
        names = tuple(theta_names) or tuple(f"theta_{k}" for k in range(1, theta.shape[1] + 1))
        specification = LABEL if limits is None else limits
        about = dictionary, specification, names, (), tuple(flown)
        flights = cls(y, fail, theta, float(dt), *about)
        flights, cut = _of_one_length(flights)
        flights, repeated = _without_duplicates(flights)
        found = (*findings, *cut, *repeated, *doubts_of(flights))
        n_failed = int(flights.fails.sum())
        if n_failed < 2 or n_failed > len(flights.y) - 2:
            raise RolloutsError(
                f"{n_failed} of {len(flights.y)} flights fail: a monitor needs two or more failing "
                f"and two or more safe flights{''.join(f'; {text}' for text in found)}"
            )
        return replace(flights, findings=found)

    def split(self, shares: Sequence[float], seed: int = 0) -> list["LabelledFlights"]:
        """Disjoint parts by flight, with equal shares of failing flights.

        Simulated flights with the same parameters, and all manoeuvres of one flown flight, stay in
        one part.   shares: of each part, 1 in all.
        """
        rng, ends = np.random.default_rng(seed), np.cumsum(shares)
        setting = self.settings()
        part = np.empty(setting.max() + 1, np.int64)
        failing = np.zeros(len(part), bool)
        failing[setting[self.fails]] = True
        for kind in (failing, ~failing):
            those = rng.permutation(np.flatnonzero(kind))
            place = (np.arange(len(those)) + 0.5) / max(len(those), 1)
            part[those] = np.searchsorted(ends[:-1], place, side="right")
        return [self.some(part[setting] == k) for k in range(len(ends))]

    def settings(self) -> Indices:
        """(n,) number of the parameter setting, or of the flown flight."""
        setting = np.arange(len(self.y))
        if self.theta.shape[1]:
            setting = np.unique(self.theta, axis=0, return_inverse=True)[1].reshape(-1)
        if not self.flown:
            return setting
        numbers, seen = dict[str, int](), list[FlownManoeuvre]()
        for k, each in enumerate(self.flown):
            if each is None:
                continue
            if each.digest not in numbers:
                alike = (other for other in seen if is_same_flight(other.sizes, each.sizes))
                same = next(alike, None)
                numbers[each.digest] = numbers[same.digest] if same else len(numbers)
                seen.append(each)
            setting[k] = len(self.y) + numbers[each.digest]
        return np.unique(setting, return_inverse=True)[1].reshape(-1)


def dictionary_of(keys: Sequence[str]) -> Dictionary:
    """Dictionary of channels that the built-in ones know. RolloutsError names an unknown one."""
    keys = tuple(map(str, keys))
    for dictionary in DICTIONARIES.values():
        if dictionary.keys == keys:
            return dictionary
    known = known_channels()
    for key in keys:
        if key not in known:
            raise RolloutsError(
                f"channel {key!r} is unknown without a Dictionary that gives its unit: "
                f"{instead_of(key, known)}"
            )
    try:
        return Dictionary("own", tuple(known[key] for key in keys))
    except ValueError as error:
        raise RolloutsError(str(error)) from error


def _completed(y: Array, dt: float, dictionary: Dictionary, flown: Sequence[bool]) -> Array:
    """Flights with computed channels. RolloutsError where a formula gives no number.

    flown: flights whose channels were computed before their trim was removed; may be empty.
    """
    given, y = y, complete(dictionary, y, dt)
    if any(flown) and y is not given:
        y[np.array(flown)] = given[np.array(flown)]
    for c, formula in dictionary.formulas:
        unknown = ~np.isfinite(y[..., [c, *formula.inputs]])
        n = int((unknown[..., 0] & ~unknown[..., 1:].any(axis=2)).any(axis=1).sum())
        if n:
            channel = dictionary.channels[c]
            raise RolloutsError(
                f"{channel.key} = {channel.formula} is not a finite number in {n} of {len(y)} "
                "flights: keep divisors from 0 and roots of what is positive, for example by max"
            )
    return y


def _no_control(dictionary: Dictionary) -> list[str]:
    if dictionary.of_role("control"):
        return []
    return [
        "no channel has the role control, so fewer methods apply and the response "
        "of the aircraft is not checked: give a dictionary in which a channel has it"
    ]


def _check_finite(y: Array, fail: Indices, dictionary: Dictionary) -> None:
    """RolloutsError for infinite values up to the failure. fail: (n,) n_samples for none."""
    flown = np.arange(y.shape[1]) <= fail[:, np.newaxis]
    infinite = np.isinf(y) & flown[..., np.newaxis]
    flights = np.flatnonzero(infinite.any(axis=(1, 2)))
    if flights.size:
        key = dictionary.keys[infinite[flights[0]].any(axis=0).argmax()]
        raise RolloutsError(
            f"infinite values in {counted(flights.size, 'flight')}, the first in {key} of flight "
            f"{flights[0] + 1}: leave unknown values empty, and end a flight where its simulation "
            "diverges"
        )


def labels(
    y: Array, fail_index: npt.ArrayLike | None, limits: Limits | IntervalLimits | None
) -> tuple[Indices, list[str]]:
    """(n,) first failing sample, n_samples for none; and where labels and limits disagree.

    Arguments as in `LabelledFlights.of`.   RolloutsError.
    """
    n, n_samples = y.shape[:2]
    envelope = envelope_of(limits)
    measured = None
    if envelope is not None:
        if len(envelope.low) != y.shape[2]:
            raise RolloutsError("the limits are of other channels: give limits of these")
        over = envelope.exceeds(y)
        measured = np.where(over.any(axis=1), over.argmax(axis=1), n_samples)
    fail = np.full(n, UNLABELLED) if fail_index is None else np.array(fail_index, np.int64)
    if fail.shape != (n,):
        raise RolloutsError(f"fail_index has shape {fail.shape}: give one for each of {n} flights")
    if (fail < UNLABELLED).any() or (fail > n_samples).any():
        raise RolloutsError(
            f"fail_index is {fail.min()} to {fail.max()}, and a flight has {n_samples} samples: "
            "give the first failing sample or -1"
        )
    unlabelled = fail == UNLABELLED
    if measured is None and unlabelled.any():
        some = "" if unlabelled.all() else f" for {unlabelled.sum()} of {n} flights"
        raise RolloutsError(
            f"neither labels nor limits were given{some}: set a limit, or label the flights "
            "in their files, by fail_index"
        )
    fail = np.where(fail < 0, n_samples, fail)
    if measured is not None:
        fail = np.where(unlabelled, measured, fail)
    if measured is None:
        return fail, []
    apart = np.flatnonzero((fail < n_samples) != (measured < n_samples))
    earlier = np.flatnonzero((measured < fail) & (fail < n_samples))
    texts = []
    if len(apart):
        texts.append(
            f"label and limits disagree in {len(apart)} of {n} flights whether they fail: the "
            "label counts"
        )
    if len(earlier):
        texts.append(
            f"{len(earlier)} of {n} flights exceed a limit before their label says so: the label "
            "counts"
        )
    return fail, texts


def _of_one_length(flights: LabelledFlights) -> tuple[LabelledFlights, list[str]]:
    """Flights over the usual length of safe ones, without flights of unknown outcome."""
    missing = np.any(np.isnan(flights.y), axis=2)
    n_samples = flights.y.shape[1]
    length = np.where(missing.any(axis=1), missing.argmax(axis=1), n_samples)
    lengths, counts = np.unique(length[~flights.fails], return_counts=True)
    if not len(lengths):
        return flights, []
    horizon, texts = int(lengths[counts.argmax()]), []
    length_s = (horizon - 1) * flights.dt
    fail = np.minimum(flights.fail_index, horizon)
    fails = fail < horizon
    if late := int((flights.fails & ~fails).sum()):
        texts.append(
            f"counted as safe: {counted(late, 'flight')} that failed only after {length_s:g} s, "
            "the usual length of safe ones"
        )
    short = ~fails & (length < horizon)
    torn = fails & (length <= fail)
    for which, kind, why in (
        (short, "safe flight", f"ended before {length_s:g} s, so their outcome is unknown"),
        (torn, "failing flight", "had no value up to their failure"),
    ):
        if n := int(which.sum()):
            names = _names(flights, which)
            texts.append(f"left out, because they {why}: {counted(n, kind)}{names}")
    keep = ~(short | torn)
    y = np.ascontiguousarray(flights.y[keep, :horizon])
    y[np.arange(horizon) > fail[keep, np.newaxis]] = np.nan
    return replace(flights.some(keep), y=y, fail_index=fail[keep]), texts


def _names(flights: LabelledFlights, which: Flags) -> str:
    """The flown ones among these flights by name: ` (a.csv, b.csv and 7 more)`."""
    flown = [flights.flown[k] for k in np.flatnonzero(which)] if flights.flown else []
    names = [f"{each.manoeuvre} of {each.flight}" for each in flown if each is not None]
    if not names:
        return ""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f" ({', '.join(names[:MOST_NAMED])}{more})"


def unlike(y: Array) -> Flags:
    """(n,) whether no flight before it is the same.   y: (n, n_samples, n_channels)."""
    seen: set[bytes] = set()
    first = np.ones(len(y), bool)
    for k, each in enumerate(y):
        digest = sha256(np.ascontiguousarray(each).data).digest()
        first[k] = digest not in seen
        seen.add(digest)
    return first


def _without_duplicates(flights: LabelledFlights) -> tuple[LabelledFlights, list[str]]:
    keep = unlike(flights.y)
    n = int((~keep).sum())
    if not n:
        return flights, []
    return flights.some(keep), [f"duplicate flights left out: {n}"]


def doubts_of(flights: LabelledFlights) -> tuple[str, ...]:
    """What looks implausible in flights, in words."""
    doubts = _leaks(flights), _one_setting(flights), _no_control(flights.dictionary)
    return tuple(text for texts in (*doubts, _few_flights(flights)) for text in texts)


def _leaks(flights: LabelledFlights) -> list[str]:
    """Channels that tell failing from safe flights at the first sample."""
    fails = flights.fails
    if min(fails.sum(), (~fails).sum()) < FEWEST_RANKED:
        return []
    texts = []
    for c, channel in enumerate(flights.dictionary.channels):
        first = flights.y[:, 0, c]
        above = first[fails, np.newaxis] > first[~fails]
        equal = first[fails, np.newaxis] == first[~fails]
        share = float((above + 0.5 * equal).mean())
        if not 1 - SEPARATES < share < SEPARATES:
            texts.append(
                f"the first sample of {channel.key} tells failing from safe flights: it may be "
                "known only afterwards, leave the channel out"
            )
    return texts


def _one_setting(flights: LabelledFlights) -> list[str]:
    if not flights.theta.shape[1]:
        return []
    theta = flights.theta[~flights.is_flown]
    failing = np.unique(theta[flights.fails[~flights.is_flown]], axis=0)
    if len(failing) != 1 or len(np.unique(theta, axis=0)) == 1:
        return []
    return ["all failing flights have the same parameters: the promise holds for these only"]


def _few_flights(flights: LabelledFlights) -> list[str]:
    """That several failing manoeuvres are of one flown flight."""
    pairs = zip(flights.flown, flights.fails, strict=False)
    failing = [each.digest for each, fails in pairs if each is not None and fails]
    if len(failing) == len(set(failing)):
        return []
    return [
        f"the {len(failing)} flown failures are of {counted(len(set(failing)), 'flight')}: "
        "manoeuvres of one flight resemble each other, so they promise less than as many flights"
    ]
