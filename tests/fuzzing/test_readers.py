"""Damaged files: each is read or refused with a reason, and none leaves files behind.

The ordinary tests try a few hundred files, `make fuzz` ten thousand. A failure names the kind and
number of the file: `python -m tests.fuzzing --seed SEED --kinds KIND --number NUMBER --keep FILE`
makes it again.
"""

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from app.telemetry.formats import FORMATS
from app.telemetry.readers import isolation
from tests.fuzzing.campaign import SECONDS, replayed, run
from tests.fuzzing.damage import Damaged, damaged
from tests.fuzzing.hostile import ENDLESS, FEW_HOSTILE, HOSTILE, READABLE
from tests.fuzzing.seeds import paths_of, write_seeds
from tests.support.api import api, problem
from tests.support.forked_readers import Forked, forking
from tests.support.recorded import RECORDINGS, kept_files, upload

pytestmark = pytest.mark.xdist_group("fuzzing")
SEED = 20240501
MOST_MEMORY = 1024
"""Of the process of a batch [MiB]."""
MOST_CONTAINED = 0.005
"""Share of files that may take down the library that reads them, which is contained."""
STATUS = {201, 413, 422}


@dataclass(frozen=True)
class Extent:
    """Numbers of files by their kind.

    together: files that share the process of their batch.   alone: files that are read as uploads
    are, each in a separate process.   uploaded: files that are uploaded, of which at least
    least_stored are stored.
    """

    together: dict[str, int]
    alone: dict[str, int]
    uploaded: dict[str, int]
    least_stored: int


SAMPLE = Extent(
    dict.fromkeys(FORMATS, 15) | {"matlab5": 30},
    dict.fromkeys(FORMATS, 1),
    dict.fromkeys(FORMATS, 1),
    2,
)
CAMPAIGN = Extent(
    dict.fromkeys(FORMATS, 1000) | {
        "csv": 1300, "parquet": 1500, "matlab5": 1700, "hdf5": 1700, "netcdf": 1500, "ulog": 1100,
        "mdf4": 1100, "ch10": 400,
    },
    dict.fromkeys(FORMATS, 30) | {
        "csv": 60, "parquet": 50, "matlab5": 50, "hdf5": 50, "netcdf": 50, "ulog": 30, "mdf4": 5,
        "ch10": 15,
    },
    dict.fromkeys(FORMATS, 10) | {
        "csv": 30, "parquet": 14, "matlab5": 14, "hdf5": 14, "netcdf": 12, "ulog": 10, "mdf4": 2,
        "ch10": 6,
    },
    11,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def read_forked(read_apart: None) -> Iterator[None]:
    """Each file's process is forked of one that has imported the libraries."""
    with forking() as parent, pytest.MonkeyPatch.context() as patch:
        patch.setattr(isolation, "_start", lambda: Forked(parent))
        yield
        isolation._end_spares()


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(SAMPLE, id="few"),
        pytest.param(CAMPAIGN, id="all", marks=pytest.mark.fuzz),
    ],
)
def extent(request):
    return request.param


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    return write_seeds(tmp_path_factory.mktemp("seeds"))


@pytest.fixture(scope="module")
def outcomes(extent, seeds, tmp_path_factory):
    return run(SEED, extent.together, seeds, tmp_path_factory.mktemp("batches"))


def some(counts, seeds, first):
    """Files that were not tried before: kind, number, file."""
    for kind, count in counts.items():
        for number in range(first[kind], first[kind] + count):
            yield kind, number, damaged(SEED, kind, number, paths_of(seeds, kind))


def test_files_of_all_formats_are_tried(extent, outcomes):
    assert Counter(outcome.kind for outcome in outcomes) == extent.together
    assert extent.together.keys() == extent.alone.keys() == extent.uploaded.keys() == FORMATS.keys()
    for kind, count in extent.together.items():
        ends = Counter(outcome.end for outcome in outcomes if outcome.kind == kind)
        assert ends["read"] > 0.05 * count, f"almost no file of {kind} is worth reading"
        assert ends["refused"] > 0.05 * count, f"almost no file of {kind} is damaged"


def test_the_campaign_has_ten_thousand_files():
    assert sum(CAMPAIGN.together.values()) >= 10_000


def test_a_damaged_file_is_read_or_refused(outcomes):
    """Nothing but a TelemetryError, whole columns, a mapping that can be proposed."""
    assert [outcome for outcome in outcomes if outcome.end == "wrong"] == []


def test_no_damaged_file_takes_long_or_much_memory(outcomes):
    ended = [outcome for outcome in outcomes if not outcome.contained]
    assert max(outcome.seconds for outcome in ended) < SECONDS
    assert max(outcome.memory for outcome in ended) < MOST_MEMORY


def test_files_that_crash_their_library_are_refused(outcomes, seeds, tmp_path):
    contained = [outcome for outcome in outcomes if outcome.contained]
    assert len(contained) <= MOST_CONTAINED * len(outcomes), contained
    for outcome in contained:
        file = damaged(SEED, outcome.kind, outcome.number, paths_of(seeds, outcome.kind))
        replayed(file, tmp_path, seconds=2.0)


def test_a_refused_file_is_named_and_leaves_nothing(extent, seeds, tmp_path):
    def replay(each):
        kind, number, file = each
        folder = tmp_path / f"{kind} {number}"
        folder.mkdir()
        return kind, replayed(file, folder, seconds=SECONDS) == "read"

    with ThreadPoolExecutor(2) as pool:
        done = Counter(pool.map(replay, some(extent.alone, seeds, extent.together)))
    assert sum(done.values()) == sum(extent.alone.values())
    if extent is CAMPAIGN:
        assert {kind for kind, is_read in done if is_read} >= {"csv", "hdf5", "ulog"}
        assert {kind for kind, is_read in done if not is_read} == FORMATS.keys()


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in FEW_HOSTILE else pytest.mark.fuzz) for name in HOSTILE],
)
def test_hostile_files_do_no_harm(name, tmp_path):
    HOSTILE[name](tmp_path / "made")
    file = Damaged("flight", (tmp_path / "made").read_bytes(), name)
    answer = replayed(file, tmp_path, seconds=5.0 if name in ENDLESS else 20.0)
    assert (answer == "read") == (name in READABLE), answer
    assert ("took more than" in answer) == (name in ENDLESS)


def test_a_damaged_upload_is_stored_entirely_or_not_at_all(extent, seeds, tmp_path):
    first = {kind: extent.together[kind] + extent.alone[kind] for kind in FORMATS}
    n_stored = 0
    with api(tmp_path, max_upload_bytes=200_000) as client:
        for kind, number, file in some(extent.uploaded, seeds, first):
            before = kept_files(tmp_path)
            answer = upload(client, file.content, file.name)
            assert answer.status_code in STATUS, (kind, number, file.done, answer.text)
            if answer.status_code == 201:
                n_stored += 1
                assert client.get(answer.headers["location"]).json() == answer.json()
                assert {name for name in kept_files(tmp_path) - before if "/" not in name} == {
                    answer.json()["id"]
                }
            else:
                assert problem(answer, answer.status_code).isprintable()
                assert kept_files(tmp_path) == before
        assert len(client.get(RECORDINGS, params={"limit": 200}).json()) == n_stored
    assert extent.least_stored <= n_stored < sum(extent.uploaded.values())
