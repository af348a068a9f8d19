"""The table and files of a study."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from app.recipes.recipes import to_plain
from core.evaluation.baselines import BASELINES
from core.evaluation.study import MethodResult, StudyResult
from core.whole_file import write_whole

SHOWN = (0.05, 0.1, 0.2, 0.3)
SHARES = ("miss_rate", "miss_interval", "power", "power_interval")


def write_study(result: StudyResult, out: Path) -> str:
    """Write study.json and the figures into `out`; return the table to print.

    All files are complete before the first is put in place.
    """
    from app.report.studies import study_figures as figures

    files = {
        "study.json": json.dumps(summary(result), indent=1).encode(),
        **figures.example_flights(result),
        **figures.render(figures.study_curves(result), "miss_and_power"),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_whole(out / name, content)
    return f"{table(result)}\nwritten: {', '.join(str(out / name) for name in files)}"


def summary(result: StudyResult) -> dict[str, Any]:
    """The study as plain data: recipe, unsafe rate, ranking, curves of every method."""
    return {
        "recipe": to_plain(result.recipe),
        "unsafe_rate": result.unsafe_rate,
        "lead_s": result.monitor.lead,
        "ranking": result.ranking,
        "methods": {
            name: {
                "epsilon": method.epsilons.tolist(),
                **{share: getattr(method, share).tolist() for share in SHARES},
                "misses": method.misses.tolist(),
                "n_unsafe": method.n_unsafe[:, 0].tolist(),
                "false_alerts": method.false_alerts.tolist(),
                "n_safe": method.n_safe[:, 0].tolist(),
            }
            for name, method in result.methods.items()
        },
        "others": _assumptions(result),
    }


def table(result: StudyResult) -> str:
    """The printed table: miss rate and power at a few epsilons, methods by rank."""
    recipe = result.recipe
    epsilons = next(iter(result.methods.values())).epsilons
    rows = sorted({int(np.abs(epsilons - shown).argmin()) for shown in SHOWN})
    lines = [
        f"{recipe.n_monitors} monitors of {recipe.dataset.n_unsafe} unsafe rollouts "
        f"({result.unsafe_rate:.0%} of flights unsafe), {recipe.n_test} fresh test flights each, "
        f"{recipe.monitor.calibration} calibration, {recipe.monitor.scaling} units, "
        f"warning lead time {result.monitor.lead:g} s",
        "miss rate / safe flights without a false alarm, each with its 95 % interval; best mean "
        "share first",
        "",
        f"{'method':27}" + "".join(f"{f'epsilon {epsilons[row]:.2f}':^36}" for row in rows),
    ]
    for name in result.ranking:
        method = result.methods[name]
        lines.append(f"{name:27}" + "".join(f"{_cell(method, row):^36}" for row in rows))
    lines += [
        "",
        "rules of others, calibrated like the monitors, each alert up to the lead counted",
        *(f"{name:27}assumes that {text}" for name, text in _assumptions(result).items()),
    ]
    return "\n".join(lines)


def _assumptions(result: StudyResult) -> dict[str, str]:
    return {name: BASELINES[name].assumption for name in result.methods if name in BASELINES}


def _cell(method: MethodResult, row: int) -> str:
    miss, power = method.miss_rate[row], method.power[row]
    (miss_low, miss_high), (low, high) = method.miss_interval[row], method.power_interval[row]
    return f"{miss:.2f} [{miss_low:.2f} {miss_high:.2f}] / {power:.2f} [{low:.2f} {high:.2f}]"
