"""Measured exceedances: judged from the channels alone, whatever the monitor says of them."""

import numpy as np

from app.messages import Judged, MeasuredExceedance
from core.channels import KEYS
from core.monitor.validity import exceeds
from core.types import Array


def exceedance(limits: Array | None, y: Array, recorded: Array) -> MeasuredExceedance | None:
    """Which limit a sample exceeds: from trim, as recorded, or both; None where it exceeds none.

    limits: (6,), None where they are not known.   y: (6,) from trim.   recorded: (6,), trim
    included. Of several channels the one furthest beyond its limit is named.
    """
    if limits is None:
        return None
    if exceeds(limits, y):
        judged: Judged = "both" if exceeds(limits, recorded) else "from_trim"
        return _named(limits, y, judged)
    if recorded is y:
        return None
    return _named(limits, recorded, "recorded") if exceeds(limits, recorded) else None


def _named(limits: Array, y: Array, judged: Judged) -> MeasuredExceedance:
    worst = int(np.nan_to_num(np.abs(y) / limits, posinf=0.0).argmax())
    return MeasuredExceedance(
        channel=KEYS[worst],
        value=float(y[worst]),
        limit=float(limits[worst]),
        judged=judged,
    )
