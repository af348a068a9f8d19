"""`forewarn combine`: several monitors of one planned test as one, calibrated as a whole."""

import argparse
from pathlib import Path

from app.commands.options.fields import add_fields, given_fields
from app.commands.options.option import add_output, option
from app.commands.output.results import check_file, print_result, progress_bar
from app.commands.train import promise, promise_lines
from app.jobs.kinds import combine_and_test
from app.jobs.requests import CombinationRecipe
from core.monitor import load


def add(parser: argparse.ArgumentParser) -> None:
    option(
        parser, "members MONITOR.fwm", "trained monitors of one planned test", nargs="+", type=Path
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
    lines = [
        f"{len(members)} monitors calibrated as one on {combination.n_unsafe} fresh failures; "
        f"{combination.n_early} failed earlier than the warning lead time of "
        f"{combination.lead:g} s",
        *promise_lines(combination, test),
        f"written: {options.out}",
    ]
    plain = {
        "file": str(options.out),
        "members": [str(path) for path in options.members],
        "n_unsafe": combination.n_unsafe,
    } | promise(combination)
    print_result(options, "\n".join(lines), plain)
    return 0
