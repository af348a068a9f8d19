"""The command that says how early planned tests can be warned of, by which method, at what cost."""

import argparse
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

from app.commands.options.destinations import check_file
from app.commands.output.progress import progress_bar
from app.commands.output.tables import add_table_options, names, print_table, recipe_of
from core.evaluation.certificate import USELESS
from core.evaluation.lead_sweep import (
    CEILING,
    CEILING_FLIGHTS,
    FALSE_ALARMS,
    METHODS,
    TESTS,
    Cell,
    PlannedTestSweep,
    SweepRecipe,
    sweep,
)
from core.monitor.calibration import Guarantee
from core.whole_file import write_whole


@dataclass(frozen=True)
class Row:
    """One method at one lead on one planned test, for one reaction time.

    earliest_s: time from the first input by which 5 % of the failing flights have failed [s].
    lead: in effect [s].   power_at_epsilon: power where just epsilon is missed of these flights.
    reaction_s: mean [s].   prevented: share of the failing flights; prevented_alike: where just
    FALSE_ALARMS of these safe flights has an alert.
    """

    test: str
    earliest_s: float
    method: str
    lead: float
    n_unsafe: int
    n_safe: int
    miss_rate: float
    miss_low: float
    miss_high: float
    power: float
    power_low: float
    power_high: float
    power_at_epsilon: float
    reaction_s: float
    prevented: float
    prevented_alike: float


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    usual = SweepRecipe()
    for name, known in (("tests", TESTS), ("methods", METHODS)):
        parser.add_argument(
            f"--{name}", type=names, metavar="NAMES", help=f"of {'; '.join(known)}; all if absent"
        )
    for option, name, words in (
        ("leads", "leads_s", "warning lead times"),
        ("reactions", "reactions_s", "mean times from an alert to neutral controls"),
    ):
        default = getattr(usual, name)
        parser.add_argument(
            f"--{option}",
            dest=name,
            type=seconds,
            metavar="SECONDS",
            default=default,
            help=f"{words} (default: {','.join(f'{time:g}' for time in default)})",
        )
    parser.add_argument(
        "--imperfections",
        choices=("none", "usual"),
        default=usual.imperfections,
        help=f"of a real flight, in training as in testing (default: {usual.imperfections})",
    )
    parser.add_argument(
        "--ceiling",
        action="store_true",
        help="also what a posterior of all derivatives could tell: takes a minute a test",
    )
    parser.add_argument("--epsilon", type=float, default=usual.epsilon, help="promised miss rate")
    parser.add_argument(
        "--guarantee", choices=get_args(Guarantee), default=usual.guarantee, help="promise on it"
    )
    numbers = {
        "n_unsafe": "unsafe rollouts that each monitor is calibrated on",
        "n_monitors": "monitors of each method and lead",
        "n_test": "fresh test flights of each monitor",
        "seed": "seed of every random draw",
    }
    parser.add_argument(
        "--figure", type=Path, help="figure written, .png or .svg: power against lead"
    )
    add_table_options(parser, usual, numbers)


def seconds(text: str) -> tuple[float, ...]:
    """Times with commas between them [s]."""
    return tuple(float(time) for time in text.split(","))


def run(options: argparse.Namespace) -> int:
    """Train and test every monitor; print the tables."""
    recipe = recipe_of(SweepRecipe, options)
    if options.figure is not None:
        _check_figure(options.figure)
    with progress_bar("monitors") as progress:
        found = sweep(recipe, progress=progress)
    if options.figure is not None:
        write_whole(options.figure, _figure(options.figure, found, recipe))
    rows = [row for name, test in found.items() for row in rows_of(name, test, recipe)]
    print_table(options, rows, in_words(found, recipe), [asdict(row) for row in rows])
    return 0


def _check_figure(path: Path) -> None:
    check_file(path)
    if path.suffix not in (".png", ".svg"):
        raise ValueError(f"{path} was given: a figure's name ends in .png or .svg")


def _figure(path: Path, found: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> bytes:
    from app.report.study_figures import render  # matplotlib: a quarter of a second
    from app.report.sweep_figure import power_against_lead

    kind = path.suffix[1:]
    return render(power_against_lead(found, recipe), "sweep", [kind])[f"sweep.{kind}"]


def rows_of(name: str, found: PlannedTestSweep, recipe: SweepRecipe) -> list[Row]:
    """One row a cell and reaction time."""
    return [
        Row(
            test=name,
            earliest_s=found.earliest_s,
            method=method,
            lead=cell.lead,
            n_unsafe=int(cell.n_unsafe.sum()),
            n_safe=int(cell.n_safe.sum()),
            miss_rate=cell.miss_rate,
            miss_low=float(cell.miss_interval[0]),
            miss_high=float(cell.miss_interval[1]),
            power=cell.power,
            power_low=float(cell.power_interval[0]),
            power_high=float(cell.power_interval[1]),
            power_at_epsilon=float(cell.power_at_epsilon.mean()),
            reaction_s=reaction_s,
            prevented=prevented,
            prevented_alike=alike,
        )
        for (method, _), cell in found.cells.items()
        for reaction_s, prevented, alike in zip(
            recipe.reactions_s,
            cell.prevented_share.tolist(),
            cell.prevented_alike_share.tolist(),
            strict=True,
        )
    ]


def in_words(found: Mapping[str, PlannedTestSweep], recipe: SweepRecipe) -> str:
    """A table a planned test, a line a lead and method, and where nothing is left to gain."""
    promised = {"average": "on average", "95%": "with 95 % confidence"}[recipe.guarantee]
    lines = [
        f"{recipe.n_monitors} monitors of {recipe.n_unsafe} failures each, epsilon "
        f"{recipe.epsilon:g} {promised}, {recipe.n_test} fresh flights each",
        "missed: of failing flights; no alert: of safe flights (in brackets where just epsilon is "
        "missed); prevented: of failing flights, by the mean reaction to the alert (in brackets "
        f"where just {FALSE_ALARMS:.0%} of safe flights have one)",
    ]
    if recipe.ceiling:
        lines.append(
            "ceiling: what a posterior of all derivatives could tell, with just epsilon missed of "
            f"{CEILING_FLIGHTS // 2} failures"
        )
    reactions = "".join(f"{f'{reaction:g} s':>13}" for reaction in recipe.reactions_s)
    for name, test in found.items():
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
    """What to do about leads at which no method lets safe flights pass."""
    best: dict[float, float] = {}
    for (method, _), cell in test.cells.items():
        if method == CEILING:
            continue
        best[cell.lead] = max(best.get(cell.lead, 0.0), cell.power)
    leads = [f"{lead:g}" for lead, power in best.items() if power < USELESS]
    if not leads:
        return []
    return [
        f"  no method has power left {', '.join(leads)} s ahead: a shorter lead, or clear the "
        "point before it is flown"
    ]
