"""The command `forewarn`: study, train, score, report, serve, demo, doctor."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.commands.destinations import check_directory, check_file
from app.commands.options import add_recipe_options, plain_recipe
from app.commands.progress import progress_bar
from app.commands.report import add_report_command
from app.commands.score import add_score_command
from app.commands.serve import add_serving_commands
from app.recipes import from_plain, to_plain
from core import __version__
from core.collection import DatasetRecipe
from core.kernels.compiled import announce_compilation
from core.monitor import MonitorRecipe

INTERRUPTED = 130


@dataclass(frozen=True)
class TrainingRecipe:
    """What `train` does: simulate a dataset, train a monitor, fly fresh rollouts through it."""

    dataset: DatasetRecipe = DatasetRecipe()  # noqa: RUF009
    monitor: MonitorRecipe = MonitorRecipe()  # noqa: RUF009
    n_test: int = 2000

    def __post_init__(self) -> None:
        """Refuse less than no test flight."""
        if self.n_test < 0:
            raise ValueError(f"n_test={self.n_test} was given: it must be 0 or more")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Returns 0 only where the work was done."""
    options = _parser().parse_args(arguments)
    try:
        with announce_compilation(lambda text: print(f"forewarn: {text}", file=sys.stderr)):
            return options.run(options)
    except KeyboardInterrupt:
        print("forewarn: interrupted, nothing was written", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError) as error:
        print(f"forewarn: {error}", file=sys.stderr)
        return 1
    except MemoryError as error:
        print(f"forewarn: memory does not suffice ({error}): ask for less", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="forewarn",
        description="Warns a stated time before a flight-test manoeuvre breaks a limit.",
    )
    parser.add_argument("--version", action="version", version=f"forewarn {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    study = commands.add_parser("study", help="repeat the paper's experiment: five methods")
    add_recipe_options(study, method=False)
    study.add_argument(
        "--n-monitors", type=int, dest=".n_monitors", metavar="NUMBER", help="monitors a method"
    )
    study.add_argument(
        "--n-test", type=int, dest=".n_test", metavar="NUMBER", help="fresh test flights a monitor"
    )
    study.add_argument("-o", "--out", type=Path, default=Path("study"), help="directory written")
    study.set_defaults(run=_study)

    train = commands.add_parser("train", help="simulate, train and test a monitor; write its file")
    add_recipe_options(train, method=True)
    train.add_argument(
        "--n-test", type=int, dest=".n_test", metavar="NUMBER", help="fresh test flights"
    )
    train.add_argument("-o", "--out", type=Path, default=Path("monitor.fwm"), help="file written")
    train.set_defaults(run=_train)

    add_score_command(commands)
    add_report_command(commands)
    add_serving_commands(commands)
    return parser


def _study(options: argparse.Namespace) -> int:
    from app.report.study import write_study
    from core.study import StudyRecipe, study

    recipe = from_plain(StudyRecipe(), plain_recipe(options))
    if options.print_recipe:
        return _print_recipe(recipe)
    check_directory(options.out)
    with progress_bar("monitors") as progress:
        result = study(recipe, progress=progress)
    print(write_study(result, options.out))
    return 0


def _train(options: argparse.Namespace) -> int:
    from app.commands.training_lines import train_and_test

    recipe = from_plain(TrainingRecipe(), plain_recipe(options))
    if options.print_recipe:
        return _print_recipe(recipe)
    check_file(options.out)
    monitor, report = train_and_test(recipe.dataset, recipe.monitor, recipe.n_test)
    monitor.save(options.out)
    print(f"{report}\nwritten: {options.out}")
    return 0


def _print_recipe(recipe: Any) -> int:
    print(json.dumps(to_plain(recipe), indent=2))
    return 0
