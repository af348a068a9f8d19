"""A recording: measured channels against time in SI units, and how they got there."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from core.channels import CHANNELS, KEYS

Array = npt.NDArray[np.float64]
ATTITUDE = ("phi", "theta", "psi")


class TelemetryError(ValueError):
    """Telemetry that cannot be used; one sentence: what was given, what is needed, what to do."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Telemetry of one manoeuvre as measured; a missing value is NaN, never a number.

    t: (n,) [s] finite, strictly increasing, n >= 2.
    y: (n, 6) in the order of core.channels.CHANNELS [rad, rad/s, rad/s, g, rad, rad].
    attitude: "phi", "theta", "psi" -> (n,) [rad], those that were recorded.
    condition: "V" [m/s], "h" [m] -> (n,), those that were recorded.
    columns: channel key -> what it was read or derived from.
    derived: keys of channels that were not measured but derived.
    notes: sentences on what was assumed and done, oldest first.
    """

    t: Array
    y: Array
    attitude: dict[str, Array] = field(default_factory=dict)
    condition: dict[str, Array] = field(default_factory=dict)
    columns: dict[str, str] = field(default_factory=dict)
    derived: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


def subtract_trim(recording: Recording, seconds: float) -> Recording:
    """Perturbations from trim: each channel less its mean over the first `seconds`, NaN left out.

    Linear aircraft models, and so the monitors trained on them, know perturbations only. Attitude
    stays as it was: it drives the display. Raises TelemetryError where the stretch is not inside
    the recording or a channel has no finite sample in it.
    """
    t, y = recording.t, recording.y
    if not 0.0 < seconds <= t[-1] - t[0]:
        raise TelemetryError(
            f"a trim stretch of {seconds:g} s was asked of a recording of {t[-1] - t[0]:g} s; "
            "give a length above zero and within the recording"
        )
    stretch = y[t - t[0] < seconds]
    unknown = [key for key, column in zip(KEYS, stretch.T, strict=True) if np.isnan(column).all()]
    if unknown:
        raise TelemetryError(
            f"{', '.join(unknown)} has no finite sample in the first {seconds:g} s, so its trim "
            "is unknown; lengthen the stretch or start the recording where the channel is alive"
        )
    trim = np.nanmean(stretch, axis=0)
    values = ", ".join(
        f"{c.key} {mean:.4g} {c.unit}" for c, mean in zip(CHANNELS, trim, strict=True)
    )
    note = f"Trim subtracted, the mean of the first {seconds:g} s: {values}."
    return replace(recording, y=y - trim, notes=(*recording.notes, note))
