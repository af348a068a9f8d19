"""Requirements in signal temporal logic against their definition and against RTAMT."""

import warnings
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest

from app.telemetry.units import PLAIN
from core.channels import Dictionary, channel
from core.computed import complete
from core.formulas import FormulaError
from core.limits.temporal import Node, Requirement
from core.types import Array

KEYS = ("x", "y", "z")
DT, N = 0.5, 60
FLIGHTS = np.random.default_rng(7).normal(0.0, 1.0, (5, N, 3)).cumsum(axis=1) / 3.0

PUBLISHED = {
    # ARCH-COMP falsification: automatic transmission and chasing cars, with other numbers
    "AT1": "always[0:10] x < 1.2",
    "AT2": "always[0:5] y < 0.8",
    "AT5": "always[0:10] ((not (x > 0.5) and eventually[0.5:1] (x > 0.5)) implies "
    "eventually[0.5:1] (always[0:2.5] (x > 0.3)))",
    "AT6": "(always[0:15] (y < 1)) implies (always[0:4] (x < 0.7))",
    "CC1": "always[0:20] (y - x <= 1.5)",
    "CC2": "always[0:7] (eventually[0:3] (y - x >= 0.15))",
    "CC3": "always[0:8] ((always[0:2] (y - x <= 0.5)) or (eventually[0:2] (z - y >= 0.4)))",
    "CC4": "always[0:6.5] (eventually[0:3] (always[0:2] (z - y >= 0.1)))",
    # Nickovic and Yamaguchi, RTAMT: request and grant
    "response": "always[0:10] ((x >= 0.3) implies (eventually[0:5] (y >= 0.3)))",
    "since": "always[0:8] ((y >= 0.3) implies ((x >= -1) since[0:4] (z >= 0.3)))",
    "until": "(x >= -1) until[2:6] (y >= 0.5)",
    "past": "always[0:8] (once[0.5:3] (x >= 0.5) or historically[0:2] (z <= 0.2))",
}


@pytest.fixture(scope="module")
def rtamt() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of its parser library
        return pytest.importorskip("rtamt")


@pytest.mark.parametrize("text", PUBLISHED.values(), ids=PUBLISHED)
def test_robustness_is_that_of_rtamt_where_the_flight_decides_it(text: str, rtamt: Any) -> None:
    low, high = Requirement.parse(text, KEYS).robustness(FLIGHTS, DT)
    for y, least, largest in zip(FLIGHTS, low, high, strict=True):
        peer = rtamt.StlDiscreteTimeSpecification()
        peer.set_sampling_period(500, "ms", 0.1)
        for key in (*KEYS, "out"):
            peer.declare_var(key, "float")
        peer.spec = f"out = {text}"
        peer.parse()
        columns = dict(zip(KEYS, y.T.tolist(), strict=True))
        out = peer.evaluate({"time": (np.arange(N) * DT).tolist(), **columns})
        rho = np.array([value for _, value in out])
        decided = least == largest
        assert decided.sum() > N // 4
        assert rho[decided] == pytest.approx(largest[decided])


def defined(node: Node, y: Array, k: int, known: int) -> tuple[float, float]:
    """Robustness at sample k by definition, with samples after `known` unknown: least, largest."""

    def at(part: Node, i: int) -> tuple[float, float]:
        past = node.kind in ("historically", "since")
        if i < 0:
            there = inf if node.kind == "historically" else -inf
            return there, there
        assert not past or i <= k
        return (-inf, inf) if i >= len(y) else defined(part, y, i, known)

    def both(pick: Callable[..., float], of: list[tuple[float, float]]) -> tuple[float, float]:
        return pick(low for low, _ in of), pick(high for _, high in of)

    if node.formula is not None:
        columns = np.repeat(y[k][:, np.newaxis], 2, axis=1)
        value = float(node.formula.values(columns, lambda *_: columns[0])[0])
        return (value, value) if k <= known else (-inf, inf)
    if node.kind == "not":
        low, high = defined(node.parts[0], y, k, known)
        return -high, -low
    if node.kind == "and":
        return both(min, [defined(part, y, k, known) for part in node.parts])
    last = len(y) if node.last == inf else round(node.last / DT)
    steps, sign = range(round(node.first / DT), last + 1), -1 if node.kind in PAST else 1
    if len(node.parts) == 1:
        return both(min, [at(node.parts[0], k + sign * i) for i in steps])
    held, reached = node.parts
    ways = [
        both(min, [at(reached, k + sign * i), *(at(held, k + sign * j) for j in range(i))])
        for i in steps
    ]
    return both(max, ways)


PAST = ("historically", "since")
MORE = [
    *PUBLISHED.values(),
    "eventually[0:3] x > 1",
    "always (historically[0:1] (x > 0.4) -> y < 0.5)",
    "not (once[0:2] x > 1) or z > 0 since y > 0.3",
    "always[0:0] x > -0.5 and always (y < 1.5)",
]


@pytest.mark.parametrize("text", MORE)
def test_a_flight_fails_at_the_first_sample_after_which_nothing_can_save_it(text: str) -> None:
    requirement = Requirement.parse(text, KEYS)
    y = FLIGHTS[:, :24]
    found = requirement.first_violation(y, DT)
    for one, first in zip(y, found.tolist(), strict=True):
        violated = [k for k in range(24) if defined(requirement.node, one, 0, k)[1] <= 0.0]
        assert first == (violated[0] if violated else 24)


def test_a_missing_sample_neither_violates_nor_satisfies() -> None:
    y = np.zeros((1, 10, 3))
    y[0, 4:] = np.nan
    low, high = Requirement.parse("always[0:4] x < 1", KEYS).robustness(y, DT)
    assert (low[0, 0], high[0, 0]) == (-inf, 1.0)


@pytest.mark.parametrize(
    "text",
    [
        "always (abs(x) < 1 or historically[0:1] (y > 0 and z < 1))",
        "always (once[0:2] x > 0.5 implies not (y > 1))",
    ],
)
def test_a_requirement_that_looks_back_is_a_channel_with_the_same_robustness(text: str) -> None:
    requirement = Requirement.parse(text, KEYS)
    assert requirement.formula is not None
    own = Dictionary("own", tuple(channel(key, key, PLAIN, key) for key in KEYS))
    one = replace(channel("rho", "rho", PLAIN, "rho"), formula=requirement.formula)
    rho = complete(own.plus(one), FLIGHTS, DT)[..., -1]
    body = Requirement(text, requirement.node.parts[0])
    assert rho == pytest.approx(body.robustness(FLIGHTS, DT)[0])
    first = np.where((rho <= 0.0).any(axis=1), (rho <= 0.0).argmax(axis=1), N)
    assert first.tolist() == requirement.first_violation(FLIGHTS, DT).tolist()


@pytest.mark.parametrize("text", [*PUBLISHED.values(), "always once[1:2] x > 0"])
def test_a_requirement_that_needs_later_samples_is_no_channel(text: str) -> None:
    assert Requirement.parse(text, KEYS).formula is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("always x", "<, <=, > or >= is needed"),
        ("always[2:1] x > 0", "write always[1:2]"),
        ("eventually x > 0", "write eventually[0:5]"),
        ("x > 0", "write always (...)"),
        ("always x > 0 and y < 1", "write always (...)"),
        ("x > 0 implies eventually[0:2] y < 1", "write always (...)"),
        ("x > 0 until y > 0", "write until[0:5]"),
        ("always (x > 0 y > 0)", ") is needed"),
        ("always (x + 1) > w", "not a channel"),
        ("x > 0 y", "and, or, implies, until or since is needed"),
        ("not " * 400 + "x > 0", "nested too deeply"),
        ("(" * 500 + "x > 0", "nested too deeply"),
        ("x > 0 and " * 300 + "x > 0", "at most 2000"),
        ("", "it ends too early"),
    ],
)
def test_what_is_no_requirement_is_one_clear_error(text: str, words: str) -> None:
    with pytest.raises(FormulaError) as error:
        Requirement.parse(text, KEYS)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "can_fail"),
    [
        ("eventually[0:4] (a > 2)", True),
        ("eventually[0:4.1] (a > 2)", False),
        ("always[0:300] (a < 2)", True),
        ("always (a > 2 implies eventually[0:3] a < 1)", True),
        ("always (a > 2 implies eventually[0:5] a < 1)", False),
        ("always[2:4] (eventually[0:3] a < 1)", False),
        ("a < 2 until[0:300] a > 3", True),
        ("always once[0:9] a < 1", True),
    ],
)
def test_times_beyond_the_flights_that_leave_nothing_to_violate_are_refused(
    text: str, can_fail: bool
) -> None:
    """Flights of 4 s."""
    requirement = Requirement.parse(text, ["a"])
    with nullcontext() if can_fail else pytest.raises(FormulaError, match="flights of 4 s"):
        requirement.check_can_fail(81, 0.05)


def test_times_between_two_samples_are_refused() -> None:
    requirement = Requirement.parse("eventually[0.1:0.3] x > 0", KEYS)
    with pytest.raises(FormulaError, match="contains no sample"):
        requirement.robustness(FLIGHTS, DT)
