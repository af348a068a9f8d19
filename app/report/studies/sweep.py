"""The table and plain data of a lead-time study."""

from collections.abc import Mapping
from typing import Any

from app.recipes.recipes import to_plain
from core.evaluation.certificate import USELESS
from core.evaluation.lead_sweep import (
    CEILING,
    CEILING_FLIGHTS,
    FALSE_ALARMS,
    Cell,
    PlannedTestSweep,
    SweepRecipe,
)


def rows_of(name: str, test: PlannedTestSweep, recipe: SweepRecipe) -> list[dict[str, Any]]:
    """One row of numbers for each cell and mean reaction time [s]; columns as in the guide."""
    rows = []
    for (method, _), cell in test.cells.items():
        known = {"test": name, "earliest_s": test.earliest_s}
        for key, value in _plain(method, cell).items():
            bounds = zip(("low", "high"), value, strict=True) if key.endswith("interval") else ()
            known |= {key.replace("interval", side): bound for side, bound in bounds}
            known |= {} if isinstance(value, list) else {key: value}
        shares = zip(
            recipe.reactions_s, cell.prevented_share, cell.prevented_alike_share, strict=True
        )
        rows += [
            known | {"reaction_s": at, "prevented": float(share), "prevented_alike": float(alike)}
            for at, share, alike in shares
        ]
    return rows


def in_words(tests: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> str:
    """One table for each planned test, one line for each lead and method; hopeless leads."""
    promised = {"average": "on average", "95%": "with 95 % confidence"}[recipe.guarantee]
    lines = [
        f"{recipe.n_monitors} monitors of {recipe.n_unsafe} failures each, epsilon "
        f"{recipe.epsilon:g} {promised}, {recipe.n_test} fresh flights each",
        "missed: share of failing flights; no alert: safe flights without a false alarm (in "
        "brackets with exactly epsilon missed); prevented: share of failing flights, by mean "
        f"reaction to the alert (in brackets with alerts on {FALSE_ALARMS:.0%} of safe flights)",
    ]
    if recipe.ceiling:
        lines.append(
            "ceiling: information limit from a posterior of all derivatives, with exactly epsilon "
            f"missed of {CEILING_FLIGHTS // 2} failures"
        )
    reactions = "".join(f"{f'{reaction:g} s':>13}" for reaction in recipe.reactions_s)
    for name, test in tests.items():
        lines += [
            "",
            f"{name}: {test.unsafe_share:.0%} of flights fail, 1 in 20 of these within "
            f"{test.earliest_s:.2f} s of the first input",
            f"  {'lead':>6}  {'method':26} {'missed':>7} {'no alert':>16}   prevented{reactions}",
        ]
        lines += [_line(method, cell) for (method, _), cell in test.cells.items()]
        lines += _hopeless(test)
    return "\n".join(lines)


def _line(method: str, cell: Cell) -> str:
    shares = zip(cell.prevented_share, cell.prevented_alike_share, strict=True)
    prevented = "".join(f"{f'{share:.2f} ({alike:.2f})':>13}" for share, alike in shares)
    no_alert = f"{cell.power:.3f} ({cell.power_at_epsilon.mean():.3f})"
    return (
        f"  {cell.lead:4.2f} s  {method:26} {cell.miss_rate:7.3f} {no_alert:>16}            "
        f"{prevented}"
    )


def _hopeless(test: PlannedTestSweep) -> list[str]:
    """Advice for leads at which no method lets safe flights pass."""
    if not (leads := hopeless_leads(test)):
        return []
    return [
        "  no method lets safe flights pass "
        f"{', '.join(f'{lead:g}' for lead in leads)} s ahead: use a shorter warning lead time, or "
        "clear the point before it is flown"
    ]


def hopeless_leads(test: PlannedTestSweep) -> list[float]:
    """Leads [s] at which almost no safe flight passes with any method."""
    best: dict[float, float] = {}
    for (method, _), cell in test.cells.items():
        if method != CEILING:
            best[cell.lead] = max(best.get(cell.lead, 0.0), float(cell.power))
    return [lead for lead, power in best.items() if power < USELESS]


def summary(tests: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> dict[str, Any]:
    """The study as plain data: recipe, and the cells of every planned test; times [s]."""
    return {
        "recipe": to_plain(recipe),
        "false_alarms_alike": FALSE_ALARMS,
        "tests": {
            name: {
                "earliest_s": test.earliest_s,
                "unsafe_share": test.unsafe_share,
                "hopeless_s": hopeless_leads(test),
                "cells": [_plain(method, cell) for (method, _), cell in test.cells.items()],
            }
            for name, test in tests.items()
        },
    }


def _plain(method: str, cell: Cell) -> dict[str, Any]:
    return {
        "method": method,
        "lead": cell.lead,
        "n_unsafe": int(cell.n_unsafe.sum()),
        "n_safe": int(cell.n_safe.sum()),
        "miss_rate": cell.miss_rate,
        "miss_interval": cell.miss_interval.tolist(),
        "power": cell.power,
        "power_interval": cell.power_interval.tolist(),
        "power_at_epsilon": float(cell.power_at_epsilon.mean()),
        "prevented": cell.prevented_share.tolist(),
        "prevented_alike": cell.prevented_alike_share.tolist(),
    }
