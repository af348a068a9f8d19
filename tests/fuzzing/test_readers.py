"""Ten thousand damaged files: each is read or refused in a sentence, and none leaves a trace.

A file that fails is named by its kind and number: `python -m tests.fuzzing --seed SEED --kinds
KIND --number NUMBER --keep FILE` makes it again.
"""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.telemetry.formats import FORMATS
from tests.fuzzing.campaign import SECONDS, replayed, run
from tests.fuzzing.damage import Damaged, damaged
from tests.fuzzing.hostile import HOSTILE, READABLE
from tests.fuzzing.seeds import paths_of, write_seeds
from tests.support.api import api, problem
from tests.support.recorded import RECORDINGS, kept_files, upload

SEED = 20240501
TOGETHER = {
    "csv": 1300, "parquet": 1500, "matlab5": 1700, "hdf5": 1700, "netcdf": 1500, "ulog": 1100,
    "mdf4": 1100, "ch10": 400,
}  # fmt: skip
"""Files that share the process of their batch."""
ALONE = {
    "csv": 60, "parquet": 50, "matlab5": 50, "hdf5": 50, "netcdf": 50, "ulog": 30, "mdf4": 5,
    "ch10": 15,
}  # fmt: skip
"""Files that are read as uploads are, each in a process of its own."""
UPLOADED = {
    "csv": 30, "parquet": 14, "matlab5": 14, "hdf5": 14, "netcdf": 12, "ulog": 10, "mdf4": 2,
    "ch10": 6,
}  # fmt: skip
MOST_MEMORY = 1024
"""Of the process of a batch [MiB]."""
FEW = 0.005
"""Share of files that may take down the library that reads them, which is contained."""
STATUS = {201, 413, 422}


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    return write_seeds(tmp_path_factory.mktemp("seeds"))


@pytest.fixture(scope="module")
def outcomes(seeds, tmp_path_factory):
    return run(SEED, TOGETHER, seeds, tmp_path_factory.mktemp("batches"))


def some(counts, seeds, first):
    """Files that were not tried before: kind, number, file."""
    for kind, count in counts.items():
        for number in range(first[kind], first[kind] + count):
            yield kind, number, damaged(SEED, kind, number, paths_of(seeds, kind))


def test_ten_thousand_files_of_all_formats_are_tried(outcomes):
    assert Counter(one.kind for one in outcomes) == TOGETHER
    assert len({(one.kind, one.number) for one in outcomes}) >= 10_000
    assert TOGETHER.keys() == ALONE.keys() == UPLOADED.keys() == FORMATS.keys()
    for kind, count in TOGETHER.items():
        ends = Counter(one.end for one in outcomes if one.kind == kind)
        assert ends["read"] > 0.05 * count, f"hardly a file of {kind} is worth reading"
        assert ends["refused"] > 0.05 * count, f"hardly a file of {kind} is damaged"


def test_a_damaged_file_is_read_or_refused(outcomes):
    """Nothing but a TelemetryError, whole columns, a mapping that can be proposed."""
    assert [one for one in outcomes if one.end == "wrong"] == []


def test_no_damaged_file_takes_long_or_much_memory(outcomes):
    ended = [one for one in outcomes if not one.contained]
    assert max(one.seconds for one in ended) < SECONDS
    assert max(one.memory for one in ended) < MOST_MEMORY


def test_the_few_files_that_take_down_their_library_are_refused(outcomes, seeds, tmp_path):
    contained = [one for one in outcomes if one.contained]
    assert len(contained) <= FEW * len(outcomes), contained
    for one in contained:
        file = damaged(SEED, one.kind, one.number, paths_of(seeds, one.kind))
        replayed(file, tmp_path, seconds=2.0)


def test_what_is_read_alone_is_refused_by_its_name_and_leaves_nothing(seeds, tmp_path):
    def replay(each):
        kind, number, file = each
        folder = tmp_path / f"{kind} {number}"
        folder.mkdir()
        return kind, replayed(file, folder, seconds=SECONDS) == "read"

    with ThreadPoolExecutor(2) as pool:
        done = Counter(pool.map(replay, some(ALONE, seeds, TOGETHER)))
    assert sum(done.values()) == sum(ALONE.values())
    assert {kind for kind, is_read in done if is_read} >= {"csv", "hdf5", "ulog"}
    assert {kind for kind, is_read in done if not is_read} == ALONE.keys()


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_made_to_hurt_does_not(name, tmp_path):
    HOSTILE[name](tmp_path / "made")
    file = Damaged("flight", (tmp_path / "made").read_bytes(), name)
    said = replayed(file, tmp_path, seconds=20.0)
    assert (said == "read") == (name in READABLE), said
    assert "took more than" not in said


def test_an_upload_of_a_damaged_file_is_kept_whole_or_not_at_all(seeds, tmp_path):
    first = {kind: TOGETHER[kind] + ALONE[kind] for kind in TOGETHER}
    n_kept = 0
    with api(tmp_path, max_upload_bytes=200_000) as client:
        for kind, number, file in some(UPLOADED, seeds, first):
            before = kept_files(tmp_path)
            answer = upload(client, file.content, file.name)
            assert answer.status_code in STATUS, (kind, number, file.done, answer.text)
            if answer.status_code == 201:
                n_kept += 1
                assert client.get(answer.headers["location"]).json() == answer.json()
                assert {name for name in kept_files(tmp_path) - before if "/" not in name} == {
                    answer.json()["id"]
                }
            else:
                assert problem(answer, answer.status_code).isprintable()
                assert kept_files(tmp_path) == before
        assert len(client.get(RECORDINGS).json()) == n_kept
    assert 10 < n_kept < sum(UPLOADED.values())
