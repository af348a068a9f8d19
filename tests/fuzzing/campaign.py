"""A fuzzing campaign: damaged files of every kind, each batch in an isolated process."""

import json
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from app.telemetry.contents import open_columns
from app.telemetry.readers import isolation
from app.telemetry.reading import LONGEST_SENTENCE, ReadLimits, read_file
from app.telemetry.recording import TelemetryError
from tests.fuzzing.damage import Damaged
from tests.fuzzing.seeds import Seed, paths_of

BATCH = 500
MEMORY = 2 << 30
"""Of the process that reads a batch [bytes]."""
SECONDS = 10.0
"""For one file."""


@dataclass(frozen=True)
class Outcome:
    """What a damaged file came to. end: "read", "refused", "wrong", "crashed", "slow", "large".

    seconds: of processor time.   memory: the most that its process had used up to then [MiB].
    """

    kind: str
    number: int
    end: str
    text: str = ""
    seconds: float = 0.0
    memory: int = 0

    @property
    def contained(self) -> bool:
        """Whether it took its process with it, in which it was alone if it were uploaded."""
        return self.end in ("crashed", "slow", "large")


def run(seed: int, counts: dict[str, int], seeds: Sequence[Seed], folder: Path) -> list[Outcome]:
    """Try so many damaged files of each kind."""
    files = [(kind, number) for kind, count in counts.items() for number in range(count)]
    batches = [files[first : first + BATCH] for first in range(0, len(files), BATCH)]
    paths = {kind: [str(path) for path in paths_of(seeds, kind)] for kind in counts}
    with ThreadPoolExecutor(2) as pool:
        done = pool.map(lambda batch: _batch(seed, batch, paths, folder), batches)
        return [outcome for outcomes in done for outcome in outcomes]


def _batch(
    seed: int, files: list[tuple[str, int]], paths: dict[str, list[str]], folder: Path
) -> list[Outcome]:
    """Try the files of one batch; begin again after one that ends its process."""
    outcomes: list[Outcome] = []
    while files:
        with TemporaryDirectory(dir=folder) as name:
            here = Path(name)
            (here / "columns").mkdir()
            (here / "log").touch()
            order = {"seed": seed, "files": files, "seconds": SECONDS, "paths": paths}
            (here / "order").write_text(json.dumps(order | {"log": str(here / "log")}))
            answer = isolation.carry_out(_order(here, len(files)))
            lines = (here / "log").read_text().splitlines()
        for (kind, number), line in zip(files, lines, strict=False):
            outcomes.append(Outcome(kind, number, *json.loads(line)))
        files = files[len(lines) :]
        if files:
            assert answer["end"] in ("crashed", "slow", "large"), answer
            text = answer.get("text", "")
            outcomes.append(Outcome(*files[0], answer["end"], text, SECONDS))
            files = files[1:]
    return outcomes


def replayed(file: Damaged, folder: Path, seconds: float = SECONDS) -> str:
    """Read one file as an upload is; return what is said of it, or that it is read.

    AssertionError where that is not as it should be, or anything is left behind.
    """
    path, columns = folder / "replayed", folder / "replayed.columns"
    path.write_bytes(file.content)
    before = sorted(folder.iterdir())
    try:
        contents = read_file(path, columns, name=file.name, limits=ReadLimits(seconds=seconds))
    except TelemetryError as error:
        text = str(error)
        assert text.startswith(f"{file.name}: "), text
        assert text.isprintable(), text
        assert len(text) <= LONGEST_SENTENCE, text
        assert sorted(folder.iterdir()) == before
        return text
    assert contents == open_columns(columns).contents
    shutil.rmtree(columns)
    return "read"


def _order(folder: Path, n_files: int) -> dict[str, object]:
    return {
        "path": str(folder / "order"),
        "folder": str(folder / "columns"),
        "reader": "tests.fuzzing.batch",
        "extra": "",
        "notes": (),
        "seconds": SECONDS + 0.5 * n_files,
        "memory": MEMORY,
        "most_bytes": 1 << 30,
        "bad_share": 0.01,
    }
