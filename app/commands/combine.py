"""`forewarn combine`: several monitors of one planned test as one, calibrated as a whole."""

import argparse
from pathlib import Path

from app.assessment.wording import PROMISED
from app.commands.options.fields import add_fields, given_fields
from app.commands.output.results import add_output, check_file, print_result, progress_bar
from app.commands.train import test_lines
from app.jobs.kinds import combine_and_test
from app.jobs.requests import CombinationRecipe
from core.evaluation.certificate import warnings_of
from core.monitor import load


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "members",
        nargs="+",
        type=Path,
        metavar="MONITOR.fwm",
        help="trained monitors of one planned test",
    )
    add_fields(parser, CombinationRecipe)
    add_output(parser, "FILE", "file to write", Path("combination.fwm"))


def run(options: argparse.Namespace) -> int:
    recipe = CombinationRecipe(**given_fields(options, CombinationRecipe))
    check_file(options.out)
    members = [load(path) for path in options.members]
    with progress_bar("fresh failures") as progress:
        combination, test = combine_and_test(
            members, recipe, lambda _, done, total: progress(done, total)
        )
    combination.save(options.out)
    above, warnings = combination.alert_above(), warnings_of(combination.evaluation, recipe.epsilon)
    lines = [
        f"{len(members)} monitors calibrated as one on {combination.n_unsafe} fresh failures; "
        f"{combination.n_early} failed earlier than the warning lead time of "
        f"{combination.lead:g} s",
        f"alerts above a risk of {above:.3g}, for a miss rate of at most {recipe.epsilon:g} "
        f"{PROMISED[recipe.guarantee]}",
        *(test_lines(test, combination.lead) if test else []),
        *(f"WARNING: {warning}" for warning in warnings),
        f"written: {options.out}",
    ]
    plain = {
        "file": str(options.out),
        "members": [str(path) for path in options.members],
        "n_unsafe": combination.n_unsafe,
        "n_early": combination.n_early,
        "lead": combination.lead,
        "epsilon": recipe.epsilon,
        "guarantee": recipe.guarantee,
        "alert_above": above,
        "evaluation": combination.evaluation,
        "warnings": list(warnings),
    }
    print_result(options, "\n".join(lines), plain)
    return 0
