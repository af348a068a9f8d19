"""An archive of recordings, against reading and scoring, and a loop of `forewarn score`."""

import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from app.recordings.archive import ArchiveRequest, score_archive
from app.recordings.scored_file import ScoreRequest, load_monitors, score_file
from app.telemetry.readers import isolation, worker
from core.planned_test.planned_test import LateralSimulator
from tests.benchmarks.pairs import in_turns
from tests.benchmarks.test_bench_recordings import NAMES, RECIPE, TO_SI
from tests.support.places import DATA

pytestmark = [pytest.mark.benchmark, pytest.mark.usefixtures("read_apart")]
MONITOR = DATA / "version_0_1_0" / "certified.fwm"
N_FILES, N_LOOP, SECONDS, DT = 20, 4, 600, 0.02


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Recordings of 10 minutes at 50 Hz, doublets one after the other."""
    folder, n = tmp_path / "source" / "PH-LAB", round(SECONDS / DT)
    folder.mkdir(parents=True)
    recipe = replace(RECIPE, dt=DT)
    per_flight = recipe.maneuver.n_samples(DT)
    for k in range(N_FILES):
        rng = np.random.default_rng(k)
        y = LateralSimulator(recipe).rollouts(-(-n // per_flight), rng).y.reshape(-1, 6)[:n]
        table = np.column_stack([DT * np.arange(n), y / TO_SI])
        head = ",".join(["t_s", *NAMES])
        np.savetxt(folder / f"{k}.csv", table, "%.9g", ",", header=head, comments="")
    return folder.parent


def test_an_archive_against_reading_and_scoring(source: Path, tmp_path: Path) -> None:
    request, runs = ScoreRequest((MONITOR,), source, accept_useless=True), iter(range(99))
    monitors = load_monitors(request)

    def archive() -> None:
        done = score_archive(ArchiveRequest(request, tmp_path / f"out{next(runs)}"))
        assert (done.scored, done.failed) == (N_FILES, {})

    def read_and_score() -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(isolation, "carry_out", worker.read)
            for file in source.glob("*/*.csv"):
                score_file(replace(request, file=file), monitors=monitors)

    pair = in_turns(read_and_score, archive)
    begin = perf_counter()
    for k in range(N_LOOP):
        file = source / "PH-LAB" / f"{k}.csv"
        call = [sys.executable, "-m", "app.cli", "score", str(MONITOR), str(file)]
        out = ["--accept-useless", "--out", str(tmp_path / f"one{k}")]
        subprocess.run([*call, *out], check=True, stdout=subprocess.DEVNULL)
    loop = (perf_counter() - begin) / N_LOOP
    ours = float(np.median(pair.theirs)) / N_FILES
    memory = [
        resource.getrusage(who).ru_maxrss / 2**10
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    print(
        f"\n{N_FILES} recordings of {SECONDS} s at {1 / DT:g} Hz, load {os.getloadavg()[0]:.1f}: "
        f"{ours:.3f} s each; {pair} of reading and scoring; `forewarn score` takes "
        f"x{loop / ours:.3g} ({loop:.2f} s); {memory[0]:.0f} MiB here, {memory[1]:.0f} MiB a child"
    )
