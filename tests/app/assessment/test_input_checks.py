"""Doubts about received samples: closed cases, real records and simulated flights."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from app.assessment.input_checks import Doubt, InputChecks, frozen_parts
from app.assessment.planned_test import PlannedTest
from core.channels import KEYS
from core.limits.limits import Envelope
from core.monitor.status import Level
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.types import Array, Flags
from tests.support import attas
from tests.support.places import RECORDS

DT = 0.02
RUDDER = KEYS.index("delta_r")
USUAL = np.array([0.09, 0.15, 0.17, 0.22, 0.02, 0.09])
PLANNED = PlannedTest.of(attas.TEST)
NOISE = np.random.default_rng(4).normal(0.0, 2e-3, (400, len(KEYS)))


def checks(limits: Envelope | None = PLANNED.limits, by_hand: bool = True) -> InputChecks:
    return InputChecks(PLANNED, USUAL, limits, by_hand)


def doubts(
    t: npt.NDArray, y: Array, looked: InputChecks | None = None, source: str = "A"
) -> list[Doubt]:
    """The doubts of samples that arrive when they are measured, each once."""
    looked = checks() if looked is None else looked
    found: dict[tuple[str | None, float], Doubt] = {}
    for when, row in zip(t.tolist(), y, strict=True):
        looked.push(when, when, row, source, False)
        found |= {(doubt.kind, doubt.t): doubt for doubt in looked.doubts}
    return [*found.values()]


def cautions(t: npt.NDArray, y: Array) -> list[str]:
    return [f"{doubt.kind}" for doubt in doubts(t, y) if doubt.level is Level.CAUTION]


def test_identical_samples_after_noise_are_frozen_after_a_second() -> None:
    y = np.concatenate([NOISE[:100], np.tile(NOISE[100], (60, 1))])
    t = np.arange(len(y)) * DT
    assert doubts(t[:151], y[:151]) == []
    (doubt,) = doubts(t, y)
    assert (doubt.kind, doubt.level, doubt.t) == ("frozen", Level.CAUTION, pytest.approx(2.0))


def test_identical_samples_of_a_source_without_noise_are_an_advisory() -> None:
    t = np.arange(200) * DT
    smooth = np.sin(t)[:, None] * USUAL
    smooth[120:] = smooth[120]
    smooth[:, PLANNED.controls] *= 10.0
    for y in (np.zeros((200, len(KEYS))), smooth):
        (doubt,) = doubts(t, y)
        assert (doubt.kind, doubt.level) == ("frozen", Level.ADVISORY)


@pytest.mark.parametrize(("key", "level"), [("Ny", Level.CAUTION), ("delta_r", Level.ADVISORY)])
def test_a_channel_that_keeps_its_value_for_longer_than_ever_is_frozen_each_time(
    key: str, level: Level
) -> None:
    y, t, c = NOISE.copy(), np.arange(400) * DT, KEYS.index(key)
    for begin in (100, 250):
        y[begin : begin + 80, c] = y[begin, c]
    found = doubts(t, y)
    assert [(d.kind, d.level, d.t) for d in found] == [
        ("frozen", level, pytest.approx(t[begin])) for begin in (100, 250)
    ]
    assert PLANNED.dictionary.channels[c].symbol in found[0].reason
    y[100:180, c] = y[250:330, c] = np.nan
    assert doubts(t, y) == []


@pytest.mark.parametrize(("noise", "moves"), [(2e-3, True), (2e-3, False), (0.0, True)])
def test_a_control_frozen_after_noise_is_a_caution_if_the_aircraft_moves(
    noise: float, moves: bool
) -> None:
    """Without noise it may be held, as by a step or at its stop."""
    t, y = np.linspace(0.0, 399 * DT, 400), NOISE.copy()
    y[:, RUDDER] = np.sin(t) if noise == 0.0 else y[:, RUDDER]
    y[200:, RUDDER] = y[200, RUDDER]
    y[250:, 2] += moves * 0.1 * np.sin(3.0 * (t[250:] - t[250]))
    (found,) = [d for d in doubts(t, y) if d.kind == "frozen"]
    is_sure = noise > 0.0 and moves
    assert found.level is (Level.CAUTION if is_sure else Level.ADVISORY)
    parts = frozen_parts(PLANNED.dictionary, t, y)
    expected = [(pytest.approx(4.0), ("delta_r",))] if is_sure else []
    assert [(part.start, part.channels) for part in parts] == expected


def test_a_control_at_a_stop_that_it_came_to_before_is_held_not_frozen() -> None:
    """A sensor without noise at the stop, with noise between; the aircraft answers each stroke."""
    t = np.arange(1400) * DT
    noise = np.random.default_rng(4).normal(0.0, 6e-3, (1400, len(KEYS)))
    y = noise + 0.1 * np.sin(t)[:, None]
    y[:, RUDDER] = np.clip(0.2 * np.sin(t) + noise[:, RUDDER], -0.1, 0.1)
    runs = np.flatnonzero(np.diff(y[:, RUDDER], prepend=0.0) != 0.0)
    assert np.diff(t[runs]).max() > 1.5
    assert [d for d in doubts(t, y) if d.kind == "frozen" and d.t > np.pi] == []
    y[1000:, RUDDER] = 0.03
    (frozen,) = [d for d in doubts(t, y) if d.kind == "frozen" and d.t > np.pi]
    assert (frozen.level, frozen.t) == (Level.CAUTION, pytest.approx(20.0))


def test_a_channel_may_rest_as_long_as_before_or_between_two_coarse_steps() -> None:
    t, y = np.arange(400) * DT, NOISE.copy()
    pulse = np.sin(np.clip(t - 2.0, 0.0, 2.0) * np.pi)
    y[:, KEYS.index("Ny")] = pulse
    y[:, KEYS.index("p")] = (np.arange(400) < 100) * (np.arange(400) % 2) * 0.01
    assert "frozen" not in [doubt.kind for doubt in doubts(t, y)]


def test_a_source_that_freezes_for_less_than_a_second_is_not_in_doubt() -> None:
    y = NOISE.copy()
    y[100:150] = y[100]
    assert doubts(np.arange(400) * DT, y) == []


@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-4, 3e-3])
def test_a_parked_aircraft_with_coarse_quantisation_raises_no_caution(noise: float) -> None:
    values = np.random.default_rng(1).normal(0.0, noise, (3000, len(KEYS))) if noise else 0.0
    y = np.round((values + np.zeros((3000, len(KEYS)))) / 1e-3) * 1e-3
    assert cautions(np.arange(3000) * DT, y) == []


def test_two_samples_of_one_time_contradict_once_the_source_goes_on() -> None:
    looked, t, y = checks(), np.arange(50) * DT, NOISE[:50]
    doubts(t, y, looked)
    other = y[49].copy()
    other[KEYS.index("Ny")] += 0.15
    looked.push(1.0, t[49], other, "B", False)
    assert looked.doubts == ()
    looked.push(1.0, 50 * DT, y[49], "A", False)
    (doubt,) = looked.doubts
    assert (doubt.kind, doubt.t) == ("contradiction", t[49])
    a, b = y[49, KEYS.index("Ny")], other[KEYS.index("Ny")]
    assert f"{a:.3g} g from A" in doubt.reason
    assert f"{b:.3g} g from B" in doubt.reason
    looked.push(2.1, 51 * DT, y[48], "A", False)
    assert looked.doubts == ()


def test_repetitions_rounding_and_half_samples_do_not_contradict() -> None:
    looked, t, y = checks(), np.arange(100) * DT, NOISE[:100]
    half = y.copy()
    half[:, :3] = np.nan
    for k in range(100):
        for row in (half[k], y[k], y[k].round(5), y[k] + NOISE[k + 200]):
            looked.push(t[k], t[k], row, "A", False)
            assert looked.doubts == ()


def test_a_source_that_is_set_back_does_not_contradict_itself() -> None:
    looked, t = checks(), np.arange(100) * DT
    doubts(t, NOISE[:100], looked)
    for k in range(15):
        looked.push(2.0 + t[k], t[k], NOISE[k] + 0.2, "A", False)
    looked.restart()
    assert doubts(t + 3.0, NOISE[100:200], looked) == []


def flights(test: DatasetRecipe, n: int) -> tuple[npt.NDArray, Array, Flags, Array]:
    """Times, flights with a long rest, whether each fails, and the largest in training."""
    trained = collect(replace(test, n_unsafe=40))
    usual = np.fmax.reduce(np.abs(np.concatenate([trained.unsafe, trained.safe])), axis=(0, 1))
    longer = replace(test.maneuver, lead_in_s=3.0, duration_s=test.maneuver.duration_s + 8.0)
    rollouts = LateralSimulator(replace(test, maneuver=longer)).rollouts(
        n, np.random.default_rng(3)
    )
    t = np.arange(rollouts.y.shape[1]) * test.dt
    return t, rollouts.y, rollouts.is_unsafe, usual


TESTS = {
    "F-16": DatasetRecipe(),
    "F-16 as flown": DatasetRecipe().as_flown(),
    "ATTAS": attas.TEST,
    "ATTAS without noise": replace(attas.TEST, noise=SensorNoise()),
}


@pytest.mark.parametrize("test", TESTS.values(), ids=TESTS)
def test_dead_surfaces_are_found_within_half_a_second_and_live_ones_never(
    test: DatasetRecipe,
) -> None:
    t, flown, fails, usual = flights(test, 40)
    planned = PlannedTest.of(test)
    for y, is_unsafe in zip(flown, fails, strict=True):
        looked = InputChecks(planned, usual, planned.limits, True)
        assert all(d.level is Level.ADVISORY for d in doubts(t, y, looked))
        if not is_unsafe:
            continue
        begins = t[(np.abs(y[:, RUDDER]) > 0.2 * planned.amplitudes[1]).argmax()]
        for dead in ([RUDDER], [*PLANNED.controls]):
            still = y.copy()
            still[:, dead] = y[0, dead]
            looked = InputChecks(planned, usual, planned.limits, True)
            found = [d for d in doubts(t, still, looked) if d.kind == "surfaces"]
            assert found[0].t - begins <= 0.5
            assert found[0].level is Level.CAUTION


def test_a_manoeuvre_begun_by_hand_ends_the_doubt_about_the_surfaces() -> None:
    t, y = np.arange(150) * DT, np.zeros((150, len(KEYS)))
    y[50:, 2] = 0.1 * np.sin(3.0 * (t[50:] - t[50]))
    looked = checks()
    assert "press G" in next(d.reason for d in doubts(t, y, looked) if d.kind == "surfaces")
    looked.push(3.0, 3.0, y[-1], "A", True)
    assert looked.doubts == ()
    assert "press G" not in doubts(t, y, checks(by_hand=False))[-1].reason


@pytest.mark.parametrize(
    ("name", "sign"),
    [
        ("attas_ail1", 1),
        ("attas_rud1", 1),
        ("citation_20190312_dutchroll", -1),
        ("citation_20190312_dutchroll_yd", -1),
    ],
)
def test_real_records_raise_no_caution_and_their_dead_surfaces_do(name: str, sign: int) -> None:
    if not (RECORDS / f"{name}.csv").exists():
        pytest.skip("the flight records are not beside this checkout")
    table = np.genfromtxt(RECORDS / f"{name}.csv", delimiter=",", names=True)
    y = np.column_stack([table[attas.COLUMNS[key]] for key in KEYS])
    y[:, PLANNED.controls] *= sign
    assert cautions(table["t_s"], y) == []
    dt = table["t_s"][1] - table["t_s"][0]
    k = slice(len(y) // 2, len(y) // 2 + round(3.0 / dt))
    frozen = y.copy()
    frozen[k, 3] = frozen[k.start, 3]
    assert cautions(table["t_s"], frozen) == ["frozen"]
    if sign == 1:
        stop = 0.9 * np.abs(y[:, RUDDER]).max()
        clipped = y + np.random.default_rng(1).normal(0.0, 5e-4, y.shape)
        clipped[:, RUDDER] = np.clip(clipped[:, RUDDER], -stop, stop)
        assert "frozen" not in cautions(3.0 * table["t_s"], clipped)
    y[:, PLANNED.controls] = y[0, PLANNED.controls]
    assert cautions(table["t_s"], y)[0] == "surfaces"
