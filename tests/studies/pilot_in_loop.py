"""Monitors trained with and without a pilot in the loop, on pilots of several kinds.

Per lead, training and pilot, over FITS monitors: share of failing flights missed while valid, and
withdrawn in time, then miss among those not withdrawn with its standard error between monitors, and
the share of safe flights without an alert and withdrawn. The last column is the miss without
validity. Run: .venv/bin/python -m tests.studies.pilot_in_loop
"""

import sys
from dataclasses import replace

import numpy as np

from core.evaluation.rates import evaluate
from core.limits.limits import Limits
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import collect, fresh
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.maneuver import MANEUVERS
from core.simulation.pilot import Crossover, OpenLoop, Pilot

FITS, N_UNSAFE, FLIGHTS, EPSILON = 12, 200, 1000, 0.1
USUAL = Crossover()
PILOTS: dict[str, Pilot] = {
    "open loop": OpenLoop(),
    "usual": USUAL,
    "low gain": replace(USUAL, crossover_rad_s=1.0),
    "high gain": replace(USUAL, crossover_rad_s=2.5),
    "slow": replace(USUAL, delay_s=0.35),
    "PIO-prone": replace(USUAL, crossover_rad_s=5.0, delay_s=0.4),
}
DOUBLET = DatasetRecipe(n_unsafe=N_UNSAFE).as_flown()
CAPTURE = replace(
    DOUBLET,
    pilot=USUAL,
    specification=Limits(beta=0.07),
    maneuver=replace(MANEUVERS["sideslip_capture"], timing_jitter_s=0.1, amplitude_jitter=0.15),
)


def study(planned: DatasetRecipe, trained: list[str], lead: float) -> None:
    for name in trained:
        rows: dict[str, list[tuple[float, ...]]] = {}
        for seed in range(FITS):
            recipe = replace(planned, pilot=PILOTS[name], seed=seed)
            dataset = collect(recipe)
            bare = train(dataset, MonitorRecipe(t_early=lead))
            monitor = train(dataset, MonitorRecipe(t_early=lead), fresh=fresh(recipe))
            for flown, pilot in PILOTS.items():
                if planned.maneuver.captured and isinstance(pilot, OpenLoop):
                    continue
                flights = replace(planned, pilot=pilot).simulator()
                y, fail, _ = flights.rollouts(FLIGHTS, np.random.default_rng(10_000 + seed))
                at = np.array([EPSILON])
                counts, without = evaluate(monitor, y, fail, at), evaluate(bare, y, fail, at)
                kept = counts.n_unsafe - counts.withdrawn[0]
                row = (
                    counts.n_unsafe,
                    counts.misses[0],
                    counts.withdrawn[0],
                    kept,
                    counts.quiet[0],
                    counts.safe_withdrawn[0],
                    counts.n_safe,
                    without.misses[0],
                    without.quiet[0],
                )
                rows.setdefault(flown, []).append(row)
        for flown, counted in rows.items():
            each = np.array(counted, float)
            n, misses, withdrawn, kept, quiet, safe_out, safe, bare_misses, bare_quiet = each.sum(0)
            share = misses / max(kept, 1.0)
            between = (each[:, 1] - share * each[:, 3]) / max(kept, 1.0)
            error = np.sqrt((between**2).sum() * FITS / (FITS - 1))
            print(
                f"{lead:.2f} s  {name:10s} {flown:10s} fail {n / (n + safe):.2f}  missed "
                f"{misses / n:.3f} withdrawn {withdrawn / n:.3f}  miss of the rest {share:.3f} "
                f"+- {error:.3f}  quiet {quiet / safe:.3f} withdrawn {safe_out / safe:.3f}  "
                f"without validity: missed {bare_misses / n:.3f} quiet {bare_quiet / safe:.3f}",
                flush=True,
            )


if __name__ == "__main__":
    for lead in map(float, sys.argv[1:] or ("0.25", "0.5")):
        study(DOUBLET, ["open loop", "usual"], lead)
        study(CAPTURE, ["usual"], lead)
