"""Combining trained monitors into one, and what fresh flights say of it."""

from collections.abc import Sequence
from dataclasses import replace

from app.jobs.requests import CombinationRecipe, planned_test
from app.jobs.training import FlownTest, Progress, fly_test
from core.collection import combination_failures
from core.monitor import Monitor, combine


def combine_and_test(
    members: Sequence[Monitor], recipe: CombinationRecipe, progress: Progress
) -> tuple[Monitor, FlownTest | None]:
    """Calibrate the members' rule on fresh failures of their planned test, and fly fresh flights.

    No flight is flown where n_test is 0; the second is None then.   ValueError where members do
    not go together.
    """
    own, dataset = planned_test(members, recipe.lead)

    def found(n_unsafe: int, n_made: int) -> None:
        words = f"calibrating: {n_unsafe} unsafe of {n_made} fresh flights"
        progress(words, n_unsafe, recipe.n_unsafe)

    flights, n_made = combination_failures(dataset, recipe.n_unsafe, found)
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
        "seed": own.seed,
        "dataset_digest": own.dataset_digest,
        "version": combination.version,
    }
    return replace(combination, evaluation=evaluation), test
