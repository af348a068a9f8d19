"""Combine trained monitors into one and test it on fresh flights."""

from collections.abc import Sequence
from dataclasses import replace

from app.jobs.requests import CombinationRecipe, planned_test
from app.jobs.training import FlownTest, Progress, fly_test
from core.monitor import Monitor, combine
from core.planned_test.collection import combination_failures


def combine_and_test(
    members: Sequence[Monitor], recipe: CombinationRecipe, progress: Progress
) -> tuple[Monitor, FlownTest | None]:
    """Calibrate the members' common rule on fresh failures of their planned test, then test it.

    The test is None if n_test is 0.   ValueError if the members do not fit together.
    """
    member, dataset = planned_test(members, recipe.lead)

    def report(n_unsafe: int, n_made: int) -> None:
        message = f"calibrating: {n_unsafe} unsafe of {n_made} fresh flights"
        progress(message, n_unsafe, recipe.n_unsafe)

    flights, n_made = combination_failures(dataset, recipe.n_unsafe, report)
    combination = combine(
        members,
        flights,
        lead=recipe.lead,
        epsilon=recipe.epsilon,
        guarantee=recipe.guarantee,
    )
    if recipe.n_test == 0:
        return combination, None
    progress(f"flying {recipe.n_test} fresh flights", 1, 2)
    test = fly_test(combination, dataset, recipe.n_test)
    evaluation = test.as_plain(recipe.n_test, combination.lead, combination.dt) | {
        "unsafe_rate": recipe.n_unsafe / n_made,
        "seed": member.seed,
        "dataset_digest": member.dataset_digest,
        "version": combination.version,
    }
    return replace(combination, evaluation=evaluation), test
