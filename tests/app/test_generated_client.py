"""A client generated from the OpenAPI document trains, uploads, scores and reads markers."""

import importlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.support.api import document, served
from tests.support.patience import until
from tests.support.recorded import csv_of

NOT_GENERATED = "image/svg+xml"
"""A response type that the generator does not read; its operation is generated all the same."""


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, str]]:
    """The generated package, and what its generator printed."""
    folder = tmp_path_factory.mktemp("generated")
    (folder / "openapi.json").write_text(json.dumps(document()))
    (folder / "config.json").write_text('{"post_hooks": []}')
    arguments = ["--path", "openapi.json", "--config", "config.json", "--meta", "none"]
    arguments += ["--output-path", "forewarn_client"]
    made = subprocess.run(
        [sys.executable, "-m", "openapi_python_client", "generate", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    sys.path.insert(0, str(folder))
    yield importlib.import_module("forewarn_client"), made.stdout + made.stderr
    sys.path.remove(str(folder))


def test_every_operation_is_generated_without_a_warning(generated: tuple[Any, str]) -> None:
    package, printed = generated
    lines = [line for line in printed.splitlines() if line.startswith(("WARNING", "Unable"))]
    assert lines == ["WARNING parsing GET /api/v1/jobs/{job_id}/figures/{name} within jobs."]
    assert NOT_GENERATED in printed
    files = {path.stem for path in (Path(package.__file__).parent / "api").rglob("*.py")}
    operations = {
        operation["operationId"]
        for item in document()["paths"].values()
        for operation in item.values()
    }
    assert operations <= files


def api_of(package: Any) -> SimpleNamespace:
    """Operations of the package by name."""
    root = Path(package.__file__).parent / "api"
    return SimpleNamespace(
        **{
            path.stem: importlib.import_module(
                f"{package.__name__}.api.{path.parent.name}.{path.stem}"
            )
            for path in root.glob("*/*.py")
            if path.stem != "__init__"
        }
    )


def test_a_generated_client_trains_uploads_scores_and_marks(
    generated: tuple[Any, str], flights: Any, tmp_path: Path
) -> None:
    package, _ = generated
    api, models = api_of(package), importlib.import_module(f"{package.__name__}.models")
    types = importlib.import_module(f"{package.__name__}.types")
    with served(tmp_path) as (origin, _), package.Client(base_url=origin) as client:
        body = models.MonitorToTrain.from_dict(
            {
                "name": "generated",
                "dataset": {"n_unsafe": 20, "max_safe": 300, "limits": {"Ny": 0.5}},
                "epsilon": 0.2,
                "guarantee": "average",
                "n_test": 10,
            }
        )
        job = api.train_monitor.sync(client=client, body=body)
        until(lambda: api.read_job.sync(job.id, client=client).status.value in ("done", "failed"))
        job = api.read_job.sync(job.id, client=client)
        assert job.status.value == "done", job.error
        monitor = api.read_monitor.sync(job.result["monitor"], client=client)
        assert monitor.limits["Ny"] == 0.5
        file = types.File(payload=csv_of(flights[0]), file_name="flight.csv", mime_type="text/csv")
        recording = api.upload_recording.sync(
            client=client, body=models.FileInAForm(file=file), name="flight.csv"
        )
        scoring = api.score_recording.sync(
            recording.id,
            client=client,
            body=models.ScoringRequest.from_dict({"monitor": monitor.id, "manoeuvres": "entire"}),
        )
        assert isinstance(scoring, models.Scoring)
        assert scoring.n_samples == len(flights[0])
        text = models.MarkerText(t=1.0, text="gust")
        marker = api.add_marker.sync(recording.id, client=client, body=text)
        listed = api.list_markers.sync(recording.id, client=client)
        assert [each.id for each in listed] == [marker.id]
        simulated = {"monitor": monitor.id, "source": {"kind": "simulated", "seed": 1}}
        request = models.FlightRequest.from_dict(simulated)
        flight = api.start_flight.sync(client=client, body=request)
        assert isinstance(flight, models.FlightStatus), flight
        call = models.MarkerRequest(kind=models.FlightMarkerCall.KNOCK_IT_OFF)
        assert api.set_flight_marker.sync(flight.id, client=client, body=call).number == 1
        (read,) = api.list_flight_markers.sync(flight.id, client=client)
        assert read.kind.value == "knock_it_off"
