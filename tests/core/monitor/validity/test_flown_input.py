"""The flown input against fresh flights: its measures, its bounds, and how often it remarks."""

from dataclasses import replace

import numpy as np
import pytest

from core.channels import KEYS
from core.monitor.validity.flown_input import (
    LEVEL,
    MEASURES,
    SURFACES,
    FlownInput,
    FreshInputs,
    InputSupport,
    amplitude,
    amplitude_in_words,
    measures,
)
from core.simulation.maneuver import Doublet
from core.types import Array

DT, N_SAMPLES = 0.05, 121
RUDDER = KEYS.index("delta_r")
PLANNED = Doublet(amplitude_deg=-6.0, timing_jitter_s=0.1, amplitude_jitter=0.15)


def fly(doublet: Doublet, n: int, seed: int) -> Array:
    """(n, n_samples, 6) flights that move the rudder and nothing else."""
    rng = np.random.default_rng(seed)
    y = np.zeros((n, N_SAMPLES, len(KEYS)))
    y[..., list(SURFACES)] = doublet.pilot(DT, n, rng)
    y[..., list(SURFACES)] += 3e-4 * rng.standard_normal((n, N_SAMPLES, 2))
    return y


@pytest.fixture(scope="module")
def support() -> InputSupport:
    """Of 1600 fresh flights, of which each fourth one fails in the middle of its doublet."""
    fresh = FreshInputs(DT)
    for seed in (1, 2):
        y = fly(PLANNED, 800, seed)
        fails = np.where(np.arange(len(y)) % 4 == 0, 40, N_SAMPLES)
        fresh.add(y, fails)
    assert fresh.support is not None
    return fresh.support


def share_remarked(support: InputSupport, doublet: Doublet, n: int = 600) -> float:
    return float(
        np.mean([bool(support.judge(y, DT, False)[0].remarks) for y in fly(doublet, n, 7)])
    )


def test_measures_are_peak_other_side_and_time_beyond_half() -> None:
    y = np.zeros((1, 10, 6))
    y[0, :, RUDDER] = [0, -0.1, -0.2, -0.2, 0.05, 0.1, np.nan, 0, 0, 0.5]
    (found,) = measures(y, np.array([8]), 0.5, [RUDDER])
    np.testing.assert_allclose(found, [[0.2, 0.5, 4 * 0.5]])
    assert not measures(np.zeros((1, 10, 6)), np.array([9]), 0.5, [RUDDER]).any()


def test_the_surface_that_the_manoeuvre_moves_is_compared(support: InputSupport) -> None:
    assert support.surfaces.tolist() == [RUDDER]
    assert (len(support.safe), len(support.unsafe)) == (1200, 400)


def test_few_flights_like_those_planned_are_remarked_on(support: InputSupport) -> None:
    """At most the level of the peak and that of the shape together, by three standard errors."""
    share = share_remarked(support, PLANNED, 2_000)
    assert 0.005 < share <= 2 * LEVEL + 3 * np.sqrt(2 * LEVEL / 2_000)


@pytest.mark.parametrize(
    ("doublet", "least"),
    [
        (replace(PLANNED, amplitude_deg=-3.0), 0.95),
        (replace(PLANNED, amplitude_deg=-4.2), 0.26),
        (replace(PLANNED, amplitude_deg=-12.0), 0.95),
        (replace(PLANNED, half_s=2.0), 0.95),
    ],
)
def test_another_amplitude_or_length_is_remarked_on(
    doublet: Doublet, least: float, support: InputSupport
) -> None:
    """Seven tenths of the amplitude in .32, by the pilot's normal law, less three errors."""
    assert share_remarked(support, doublet) >= least


def test_a_remark_says_how_much_of_the_planned_amplitude_was_flown(support: InputSupport) -> None:
    exact = replace(PLANNED, timing_jitter_s=0.0, amplitude_jitter=0.0)
    planned = np.radians([0.0, 6.0])
    (like,) = support.judge(fly(exact, 1, 3)[0], DT, False, planned)
    assert like.remarks == ()
    assert like.share == pytest.approx(1.0, abs=0.02)
    half = fly(replace(exact, amplitude_deg=-3.0), 1, 3)[0]
    (flown,) = support.judge(half, DT, False, 0.8 * planned)
    assert flown.channel == "delta_r"
    share = flown.share or 0.0
    assert share == pytest.approx(0.5 / 0.8, abs=0.02)
    (remark,) = flown.remarks
    assert remark.startswith("rudder: largest deflection 3.0")
    assert (
        f"{100 * share:.0f} % of the planned amplitude; 98 % of fresh flights without an "
        "exceedance are between" in remark
    )
    (unknown,) = support.judge(half, DT, False)
    assert unknown.share is None
    assert " 50 % of the median of fresh flights; 98 %" in unknown.remarks[0]
    half[:, RUDDER] = np.nan
    assert support.judge(half, DT, False) == ()


def test_a_flight_that_exceeded_is_compared_up_to_there(support: InputSupport) -> None:
    """With those that did: in the middle of a doublet nobody has flown its second half."""
    y = fly(replace(PLANNED, timing_jitter_s=0.0, amplitude_jitter=0.0), 1, 3)[0]
    assert support.judge(y[:41], DT, True)[0].remarks == ()
    assert support.judge(y[:31], DT, False)[0].remarks
    (remark,) = support.judge(2.0 * y[:41], DT, True)[0].remarks
    assert "98 % of fresh flights that exceed a limit are between" in remark


def test_bounds_leave_out_as_many_as_the_level_says(support: InputSupport) -> None:
    """The peak of the 12th of 1200 flights, from below and from above, is the last within."""
    peaks, n = support.safe[:, 0, 0], len(support.safe)
    outside = [
        bool(support.judge(with_peak(float(peak)), DT, False)[0].remarks)
        for peak in (peaks[10], peaks[11], peaks[n - 12], peaks[n - 11])
    ]
    assert outside == [True, False, False, True]


def with_peak(peak: float) -> Array:
    """A doublet of the planned shape with this peak [rad]."""
    y = fly(replace(PLANNED, timing_jitter_s=0.0, amplitude_jitter=0.0), 1, 3)[0]
    return y * (peak / np.abs(y[:, RUDDER]).max())


def test_too_few_fresh_flights_remark_on_nothing(support: InputSupport) -> None:
    few = replace(support, safe=support.safe[::100])
    assert few.judge(with_peak(1.0), DT, False)[0].remarks == ()


def test_a_section_comes_back_and_one_that_makes_no_sense_is_refused(support: InputSupport) -> None:
    again = InputSupport.from_section(support.to_section())
    assert again.safe.tobytes() == support.safe.tobytes()
    assert again.unsafe.tobytes() == support.unsafe.tobytes()
    assert not support.to_section().required
    for wrong in (
        {"safe": support.safe[::-1]},
        {"planned": support.usual * 0},
        {"planned": support.usual[:0]},
        {"safe": support.safe * np.nan},
        {"unsafe": support.unsafe[:, :, : len(MEASURES) - 1]},
        {"surfaces": np.array([0])},
    ):
        section = support.to_section()
        with pytest.raises(ValueError, match="input"):
            InputSupport.from_section(section._replace(arrays={**section.arrays, **wrong}))


def test_the_amplitude_of_a_manoeuvre_is_that_of_its_main_surface() -> None:
    rudder, aileron = FlownInput("delta_r", 0.077, 0.1), FlownInput("delta_a", 0.06, 0.05)
    assert amplitude([aileron, rudder]) == pytest.approx(0.77)
    assert amplitude([]) is None
    assert amplitude([FlownInput("delta_r", 0.077, None)]) is None
    assert amplitude_in_words([0.77]) == ", on a manoeuvre of 77 % of the planned amplitude"
    assert (
        amplitude_in_words([0.77, 1.02])
        == ", on manoeuvres of 77 to 102 % of the planned amplitude"
    )
    assert amplitude_in_words([]) == ""
