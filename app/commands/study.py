"""`forewarn study`: the paper's experiment; writes a table, data and figures."""

import argparse
from pathlib import Path

from app.commands.options.option import add_output, add_scheduler
from app.commands.options.recipe import add_recipe_options, plain_recipe, print_recipe
from app.commands.output.results import check_directory, print_result, progress_bar
from app.jobs.cluster import executor_at
from app.recipes.recipes import from_plain
from app.report.studies.study import summary, write_study
from core.evaluation.study import StudyRecipe, study


def add(parser: argparse.ArgumentParser) -> None:
    add_recipe_options(parser, "n_monitors", "n_test", imperfections="none")
    add_output(parser, "DIR", "directory to write to", Path("study"))
    add_scheduler(parser)


def run(options: argparse.Namespace) -> int:
    recipe = from_plain(StudyRecipe(), plain_recipe(options))
    if options.print_recipe:
        return print_recipe(recipe)
    check_directory(options.out)
    with executor_at(options.scheduler) as executor, progress_bar("monitors") as progress:
        result = study(recipe, executor=executor, progress=progress)
    print_result(options, write_study(result, options.out), summary(result))
    return 0
