"""A simulator in Python by the command line: `forewarn train --simulator module:name`."""

import json
import re
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from io import StringIO
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

from app.cli import main
from app.commands.output import results
from app.store.store import open_store
from core.counted import pace
from core.monitor import Monitor, load
from core.planned_test.own import OwnSimulator
from core.types import Array
from tests.support import own_pitch
from tests.support.api import api

OPTIONS = ["--limit", "Nz=-1.1..2.9g", "--epsilon", "0.1", "--n-unsafe", "60", "--n-test", "300"]
METHOD = ["--guarantee", "average", "--predictor", "peak_ridge"]
NAMES = "pitch", "thing"
"""A plain function, and an object."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where a user would be, with a module of simulators."""
    folder = tmp_path_factory.mktemp("simulators")
    shutil.copy(own_pitch.__file__, folder / "my_pitch.py")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        yield folder
    for name in [name for name in sys.modules if name.startswith("my_")]:
        del sys.modules[name]


@pytest.fixture(scope="module", params=NAMES)
def trained(request: pytest.FixtureRequest, folder: Path) -> tuple[str, Path]:
    """The name of a simulator, and the file of its monitor, which is also in a store."""
    file = folder / f"{request.param}.fwm"
    name = f"my_pitch:{request.param}"
    stored = ["--data-dir", str(folder / request.param)]
    assert main(["train", "--simulator", name, *OPTIONS, *METHOD, *stored, "-o", str(file)]) == 0
    return name, file


def train(*options: str) -> int:
    return main(["train", *OPTIONS, *METHOD, *options])


def test_the_monitor_knows_its_simulator_and_was_tested_on_fresh_flights(trained: tuple[str, Path]):
    name, file = trained
    monitor = load(file)
    assert isinstance(monitor, Monitor)
    assert (monitor.n_unsafe, monitor.seed, monitor.dt) == (60, 0, own_pitch.DT)
    assert monitor.dictionary.keys == ("alpha", "q", "Nz", "delta_e")
    assert monitor.dataset_recipe["simulator"] == name
    assert list(monitor.dataset_recipe["parameters"]) == ["stiffness", "gain"]
    assert monitor.support is not None
    evaluation = monitor.evaluation or {}
    assert evaluation["n_test"] == evaluation["n_unsafe"] + evaluation["n_safe"] == 300
    assert evaluation["simulator"] == name
    assert evaluation["flights"]["certify"] == 300
    assert evaluation["at_epsilon"]["miss_rate"] < 0.1 + 3 * (0.09 / evaluation["n_unsafe"]) ** 0.5
    is_function = name.endswith(":pitch")
    assert ("prevention" in evaluation) == is_function
    assert set(evaluation["robustness"]) == ({"near_1.25", "near_1.5"} if is_function else set())


def test_the_certificate_says_that_fresh_flights_were_simulated(trained: tuple[str, Path]):
    name, file = trained
    page = file.with_suffix(".html")
    assert main(["certificate", str(file), "-o", str(page)]) == 0
    text = page.read_text()
    assert f"Simulated separately by {name}" in text
    assert "Split by flight" not in text


def test_the_same_seed_makes_the_same_file(trained: tuple[str, Path], tmp_path: Path):
    name, file = trained
    for seed, same in (("0", True), ("1", False)):
        assert train("--simulator", name, "--seed", seed, "-o", str(tmp_path / seed)) == 0
        assert ((tmp_path / seed).read_bytes() == file.read_bytes()) is same


def test_dataset_and_monitor_are_stored_and_no_request_runs_the_code(trained: tuple[str, Path]):
    name, file = trained
    place = file.with_suffix("")
    with closing(open_store(place / "forewarn.db", recover=False)) as store:
        (monitor,), (dataset,) = store.monitors.all(), store.datasets.all()
        assert monitor.digest
        assert dataset.recipe["simulator"] == name
        assert dataset.findings == []
        assert store.datasets.get(dataset.id).digest() == load(file).dataset_digest
    with api(place) as client:
        assert client.get(f"/api/v1/monitors/{monitor.id}/evaluation").json()["simulator"] == name
        asked: dict[str, Any] = {
            "/datasets": {"simulator": name},
            "/monitors": {"dataset": {"simulator": name}},
            f"/monitors/{monitor.id}/epsilon": {},
            "/studies": {"dataset": dataset.id},
            "/flights": {"source": {"kind": "simulated"}, "monitor": monitor.id},
        }
        for path, body in asked.items():
            answer = client.post(f"/api/v1{path}", json=body)
            assert answer.status_code == 422, (path, answer.text)
            assert name in answer.text, (path, answer.text)
            assert "forewarn train" in answer.text, (path, answer.text)
        replayed = {"kind": "replay", "dataset": dataset.id, "outcome": "unsafe", "rollout": 0}
        flight = client.post("/api/v1/flights", json={"source": replayed, "monitor": monitor.id})
        assert flight.status_code == 201, flight.text


def test_the_method_is_chosen_on_fresh_flights(folder: Path, tmp_path: Path, capsys: Any):
    """Also: what the simulator prints stays out of the results."""
    quiet = (folder / "my_pitch.py").read_text()
    loud = re.sub(r"^(def fly.*:\n)", r'\1    print("a flight")\n', quiet, flags=re.MULTILINE)
    (folder / "my_loud.py").write_text(loud)
    options = [*OPTIONS, "--guarantee", "average", "--json", "-o", str(tmp_path / "m.fwm")]
    assert main(["train", "--simulator", "my_loud:pitch", *options]) == 0
    printed = capsys.readouterr()
    assert "a flight" in printed.err
    said = json.loads(printed.out)
    assert [method["chosen"] for method in said["methods"]].count(True) == 1
    assert said["evaluation"]["flights"]["choose the method"] == 1000
    assert said["validity"] == "calibrated"


def refusal(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """The one sentence with which a command is refused; it writes no file."""
    assert train(*options, "-o", "refused.fwm") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert not Path("refused.fwm").exists()
    return line


BROKEN = """from dataclasses import replace
from my_pitch import *

def divides(theta, inputs, t):
    return [[1.0 / (theta["gain"] - theta["gain"])]]

def unknown(theta, inputs, t):
    return np.array(fly(theta, inputs, t)) * np.nan

raises = declared(divides)
nan = declared(unknown)
short = declared(lambda theta, inputs, t: fly(theta, inputs, t)[1:])
narrow = declared(lambda theta, inputs, t: np.array(fly(theta, inputs, t))[:, 1:])
tame = replace(pitch, parameters={"stiffness": (9.0, 0.1), "gain": (0.5, 0.01)})
misspelt = declared(lambda theta, inputs, t: fly(theta | {"gain": theta["gian"]}, inputs, t))
negative = replace(pitch, parameters={"stiffness": (6.0, 1.1), "gain": (1.0, -0.2)})
slow = replace(pitch, dt=50)
thing = type("Thing", (), {"channels": ["Nz"]})()
same = replace(pitch, parameters={"stiffness": (6.0, 0.0), "gain": (1.0, 0.0)},
               inputs=doublet(np.random.default_rng(0)))
"""


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("my_broken:raises", "my_broken.py, line 5, 'return [[1.0 / (theta"),
        ("my_broken:nan", "no finite alpha in"),
        ("my_broken:short", "shape (80, 4): return (81 samples, 4 channels alpha"),
        ("my_broken:narrow", "shape (81, 3): return (81 samples, 4 channels alpha"),
        ("my_broken:tame", "60 unsafe ones are out of reach within 3000 rollouts"),
        ("my_broken:tame", "raise --max-rollouts"),
        ("my_broken:tame", "g with limits -1.1 and 2.9: check the units"),
        ("my_broken:same", "99 flights of 100 that repeat another one"),
        ("my_broken:fly", "declare it by @simulator"),
        ("my_broken:Pitch", "is a class, not a simulator"),
        ("my_broken:thing", "of type Thing without parameters, dt, rollouts, not a simulator"),
        ("my_broken:misspelt", "no parameter gian: did you mean gain?"),
        ("my_broken:negative", "'gain' is (1.0, -0.2): give (nominal value, spread of 0 or more)"),
        ("my_broken:slow", "has dt=50 s, longer than the warning lead time of 0.25 s: give its"),
        ("my_unknown:pitch", "got an unexpected keyword argument 'channel': correct it"),
        ("my_broken.py:nan", "sim:fly for fly in sim.py"),
        ("my_broken:narow", "did you mean narrow?"),
        ("my_broken", "write it as package.module:name"),
        ("no_such_module:pitch", "there is no module no_such_module"),
        ("my_syntax:pitch", "my_syntax.py, line 2, 'return (', with SyntaxError"),
        ("my_import:pitch", "my_import.py, line 1, 'import no_such_library'"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(
    name: str, told: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    (folder / "my_broken.py").write_text(BROKEN)
    (folder / "my_syntax.py").write_text("def fly():\n    return (\n")
    (folder / "my_import.py").write_text("import no_such_library\n")
    (folder / "my_unknown.py").write_text(
        "from core.simulation.python_simulator import simulator\n"
        "pitch = simulator(channel=[])(print)"
    )
    assert told in refusal(capsys, "--simulator", name, "--max-rollouts", "3000")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--aircraft", "f16_sl_h0_v502"], "--aircraft was given with --simulator"),
        (["--rollouts", "some.npz"], "--rollouts was given with --simulator"),
        (["--dictionary", "some.csv"], "--dictionary was given with --simulator"),
        (["--amplitude", "5"], "--amplitude was given with --simulator"),
        (["--dt", "0.1"], "--dt was given with --simulator"),
        (["--print-recipe"], "--print-recipe was given with --simulator"),
        (["--t-early", "4"], "--t-early=4"),
        (["--n-test", "-1"], "--n-test=-1"),
        (["--seed", "-1"], "seed=-1"),
        (["--epsilon", "0.001"], "needs at least 999"),
        (["--predictor", "response_filter"], "knows no step responses"),
        (["--limit", "Ny=0.5"], "'Ny' is unknown"),
        (["--limit", "Nz=..38g"], "values beyond 30 g"),
        (["--limit", "alpha=..12"], "12 rad is more than any aircraft reaches"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    options: list[str], told: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    assert told in refusal(capsys, "--simulator", "my_pitch:pitch", *options)


def test_limits_that_last_and_computed_channels_are_judged(folder: Path, tmp_path: Path):
    computed = ["--channel", "load [kN] = 12*Nz", "--limit", "load=..34"]
    options = [*OPTIONS[2:], *METHOD, *computed, "-o", str(tmp_path / "load.fwm")]
    assert main(["train", "--simulator", "my_pitch:pitch", *options]) == 0
    monitor = load(tmp_path / "load.fwm")
    assert monitor.dictionary.keys[-1] == "load"
    assert monitor.envelope is not None
    assert np.isfinite(monitor.envelope.high).tolist() == [False] * 4 + [True]


def test_flights_are_counted_as_they_are_flown():
    """So that a slow simulator shows how far it is."""
    seen: list[tuple[int, int]] = []

    def fly(theta: dict[str, float], inputs: Array, t: Array) -> Any:
        seen.append((own.counts["flown"], own.counts["asked"]))
        return own_pitch.fly(theta, inputs, t)

    own = OwnSimulator.of(own_pitch.declared(fly), "it")
    own.outputs(2, 0)  # twice, to see whether they repeat
    assert seen == [(0, 2), (1, 2), (2, 4), (3, 4)]
    assert own.counts["flown"] == 4


def test_flights_are_told_with_their_rate_and_the_time_left():
    counts, now = Counter[str](), [10.0]
    words = results.flights_in_words(counts, lambda: now[0])
    assert words() == ""
    counts["asked"] = 256
    assert words() == "0 of 256 rollouts"
    counts["flown"], now[0] = 16, 14.0
    assert words() == "16 of 256 rollouts, 4 a second, 60 s left"
    assert pace(1234.4, 7200.0) == "1234 a second, 2 h left"


def test_a_log_gets_lines_on_the_progress(monkeypatch: pytest.MonkeyPatch):
    class Log(StringIO):
        told = Event()

        def flush(self) -> None:
            self.told.set()

    counts = Counter(asked=8, flown=0)
    monkeypatch.setattr(sys, "stderr", Log())
    monkeypatch.setattr(results, "LINE_S", 1e-3)
    with results.stage_bar("flying", counts) as show:
        show("training", 1, 3)
        Log.told.clear()
        assert Log.told.wait(30)
    assert "training: 1 of 3; 0 of 8 rollouts" in sys.stderr.getvalue()  # type: ignore
