import numpy as np
import pytest

from core.seeds import Branch, monitor_seeds, stream


@pytest.mark.parametrize(
    ("branch", "below", "key"),
    [
        (Branch.ROLLOUTS, (3,), (0, 3)),
        (Branch.SAFE_TIMES, (), (1,)),
        (Branch.TEST, (), (2,)),
        (Branch.VALIDITY, (), (3,)),
    ],
)
def test_each_branch_keeps_its_numbers_between_versions(
    branch: Branch, below: tuple[int, ...], key: tuple[int, ...]
) -> None:
    expected = np.random.default_rng(np.random.SeedSequence(7, spawn_key=key)).random(5)
    np.testing.assert_array_equal(stream(7, branch, *below).random(5), expected)


def test_all_streams_of_a_seed_differ() -> None:
    streams = [stream(7, branch) for branch in Branch]
    streams += [stream(7, Branch.ROLLOUTS, number) for number in range(4)]
    assert len({rng.random() for rng in streams}) == len(streams)


def test_the_first_monitors_of_a_study_do_not_depend_on_their_number() -> None:
    few, many = monitor_seeds(7, 2), monitor_seeds(7, 10)
    assert many[:2] == few
    assert len(np.unique(many)) == 20
