"""Report and exports over REST: self-contained files under names in any alphabet."""

import io
import os
import re
from collections.abc import Iterator
from typing import Any, BinaryIO
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat
from starlette.testclient import TestClient

from app.recordings.files import RecordingFiles
from core.channels import CHANNELS, KEYS
from core.monitor import Monitor
from tests.support.api import api, problem, store_of
from tests.support.attas import TEST, fly
from tests.support.recorded import RECORDINGS, csv_of, uploaded

NAME = 'prüfflug β ✈ "1"; x.csv'
STEM = NAME.removesuffix(".csv")


class Scored:
    """A recording with a strange name, as it was scored."""

    def __init__(self, client: TestClient, monitor: Monitor) -> None:
        self.client = client
        self.monitor = store_of(client).monitors.add(monitor, "transport <doublet>").id
        content = csv_of(np.concatenate(fly(2, 5).y), TEST.dt)
        self.recording = uploaded(client, content, name=NAME, aircraft="PH-LÅB")
        self.scoring = self.score()

    def score(self, **order: Any) -> dict[str, Any]:
        path = f"{RECORDINGS}/{self.recording['id']}/scorings"
        answer = self.client.post(path, json={"monitor": self.monitor} | order)
        assert answer.status_code in (200, 201), answer.text
        return answer.json()

    @property
    def path(self) -> str:
        return f"{RECORDINGS}/{self.recording['id']}/scorings/{self.scoring['id']}"

    @property
    def frames(self) -> list[dict[str, Any]]:
        return self.client.get(f"{self.path}/assessments").json()["frames"]

    def export(self, form: str) -> io.BytesIO:
        answer = self.client.get(f"{self.path}/export", params={"format": form})
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"].split(";")[0] in MEDIA_TYPES[form]
        assert kept_name(answer) == f"{STEM} scored.{form}"
        return io.BytesIO(answer.content)


MEDIA_TYPES = {
    "csv": "text/csv",
    "parquet": "application/vnd.apache.parquet",
    "mat": "application/x-matlab-data",
}


def kept_name(answer: Any) -> str:
    """The name that a browser keeps an answer under."""
    form, _, name = answer.headers["content-disposition"].partition("filename*=UTF-8''")
    assert form == "attachment; "
    assert re.fullmatch(r"[\w.%~-]+", name, re.ASCII)
    return unquote(name)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory, attas: Monitor) -> Iterator[Scored]:
    with api(tmp_path_factory.mktemp("data")) as client:
        yield Scored(client, attas)


def test_the_report_is_self_contained_under_a_strict_policy(scored: Scored):
    answer = scored.client.get(f"{scored.path}/report")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'")
    assert "script" not in policy
    assert "content-disposition" not in answer.headers
    html = answer.text
    assert re.findall(r"(?:src|href)\s*=|<script|@import", html) == []
    assert "prüfflug β ✈ &#34;1&#34;; x.csv" in html
    assert "transport &lt;doublet&gt;" in html
    assert "PH-LÅB" in html
    for key in ("digest", "monitor_digest"):
        assert scored.scoring[key] in html
    assert scored.recording["digest"] in html
    for manoeuvre in scored.scoring["manoeuvres"]:
        assert manoeuvre["guarantee"].replace("'", "&#39;") in html


def test_the_report_has_the_source_of_the_mapping_and_the_notes(scored: Scored):
    path = f"{RECORDINGS}/{scored.recording['id']}"

    def html() -> str:
        return scored.client.get(f"{scored.path}/report").text

    assert "proposed by the program, not confirmed" in html()
    assert "Confidence" in html()
    order = {"mapping": scored.recording["mapping"], "remember": False}
    assert scored.client.put(f"{path}/mapping", json=order).status_code == 200
    assert "confirmed by the user" in html()
    assert "Confidence" not in html()
    marker = {"t": 2.0, "end": 3.0, "kind": "note", "text": "gust & <rain>"}
    assert scored.client.post(f"{path}/markers", json=marker).status_code == 201
    assert "gust &amp; &lt;rain&gt;" in html()
    turned = {**scored.recording["mapping"]["channels"]["beta"], "sign": -1}
    mapping = scored.recording["mapping"]
    changed = {**mapping, "channels": {**mapping["channels"], "beta": turned}}
    order = {"mapping": changed, "remember": False}
    assert scored.client.put(f"{path}/mapping", json=order).status_code == 200
    assert "another mapping is in use now" in html()


def test_raw_counts_give_the_same_scoring_and_the_report_has_their_scale(scored: Scored):
    y = np.concatenate(fly(2, 5).y)
    head = ",".join(["t_s", *(f"word {k}" for k in range(6))])
    counted = uploaded(scored.client, csv_of(y * 2**12, TEST.dt, head), name="counts.csv")
    channels = {
        key: {"signal": f"word {k}", "unit": channel.unit, "scale": 2**-12, "offset": 0.0}
        for k, (key, channel) in enumerate(zip(KEYS, CHANNELS, strict=True))
    }
    mapping = {"channels": channels, "times": {"": {"signal": "t_s", "unit": "s"}}}
    path = f"{RECORDINGS}/{counted['id']}"
    put = scored.client.put(f"{path}/mapping", json={"mapping": mapping})
    assert put.json()["mapping"]["channels"]["p"]["scale"] == 2**-12
    answer = scored.client.post(f"{path}/scorings", json={"monitor": scored.monitor})
    assert answer.json()["mapping"]["channels"]["p"]["scale"] == 2**-12
    assert any("Scaled: beta = 0.0002441" in note for note in answer.json()["notes"])
    scoring = f"{path}/scorings/{answer.json()['id']}"
    frames = scored.client.get(f"{scoring}/assessments").json()["frames"]
    assert [frame["p_value"] for frame in frames] == [frame["p_value"] for frame in scored.frames]
    html = scored.client.get(f"{scoring}/report").text
    assert "word 1 = 0.000244140625 * raw" in html
    channels["p"]["scale"] = 0.0
    refused = scored.client.put(f"{path}/mapping", json={"mapping": mapping})
    assert problem(refused, 422) == (
        "the mapping of 'p' has a scale of 0: give a finite number other than zero"
    )


def test_csv_is_the_samples_with_units_in_their_names(scored: Scored):
    table = pd.read_csv(scored.export("csv"))
    frames = scored.frames
    assert list(table)[:2] == ["t_s", "beta_from_trim_rad"]
    np.testing.assert_array_equal(table["t_s"], [frame["t"] for frame in frames])
    risk = [np.nan if frame["p_value"] is None else frame["p_value"] for frame in frames]
    np.testing.assert_array_equal(table["p_value"], risk)
    assert table["state"].tolist() == [frame["state"] for frame in frames]
    assert table["manoeuvre"].tolist() == [frame["manoeuvre"] for frame in frames]


@pytest.mark.parametrize("form", ["parquet", "mat"])
def test_other_formats_keep_units_and_provenance(scored: Scored, form: str):
    y = np.array([frame["y"] for frame in scored.frames])
    if form == "parquet":
        table = pq.read_table(scored.export(form))
        units = {field.name: (field.metadata or {})[b"unit"].decode() for field in table.schema}
        columns = {key: table[key].to_numpy() for key in KEYS}
        about = (table.schema.metadata or {})[b"forewarn"].decode()
    else:
        content = loadmat(scored.export(form), simplify_cells=True)
        units, columns, about = content["units"], {key: content[key] for key in KEYS}, ""
        about = content["about"]
    for c, channel in enumerate(CHANNELS):
        assert units[channel.key] == channel.unit
        np.testing.assert_array_equal(columns[channel.key], y[:, c])
    for key in ("digest", "monitor_digest"):
        assert scored.scoring[key] in about
    assert scored.recording["digest"] in about


def test_csv_is_the_default_and_unknown_formats_are_refused(scored: Scored):
    path = f"{scored.path}/export"
    assert scored.client.get(path).content == scored.export("csv").getvalue()
    assert "format" in problem(scored.client.get(path, params={"format": "xlsx"}), 422)


def test_an_export_leaves_no_file_on_the_disk(scored: Scored, monkeypatch: pytest.MonkeyPatch):
    whole = scored.export("csv").getvalue()
    made: list[int] = []
    given = RecordingFiles.unnamed

    def seen(files: RecordingFiles) -> BinaryIO:
        file = given(files)
        made.append(os.fstat(file.fileno()).st_dev)
        return file

    monkeypatch.setattr(RecordingFiles, "unnamed", seen)
    answer = scored.client.get(f"{scored.path}/export")
    assert int(answer.headers["content-length"]) == len(whole) == len(answer.content)
    files = scored.client.app.state.recordings.files  # pyright: ignore
    assert made == [os.stat(files.root).st_dev]
    assert not list(files.incoming.iterdir())


@pytest.mark.parametrize("end", ["report", "export"])
def test_unknown_scorings_are_not_found(scored: Scored, end: str):
    recording, lost = scored.recording["id"], scored.score(epsilon=0.4)
    path = f"{RECORDINGS}/{recording}/scorings"
    assert scored.client.delete(f"{path}/{lost['id']}").status_code == 204
    for gone in (f"{path}/{lost['id']}", f"{path}/nothing", f"{RECORDINGS}/no/scorings/nothing"):
        assert "no scoring" in problem(scored.client.get(f"{gone}/{end}"), 404)
    elsewhere = f"{RECORDINGS}/no/scorings/{scored.scoring['id']}"
    assert scored.scoring["id"] in problem(scored.client.get(f"{elsewhere}/{end}"), 404)


def test_a_call_after_the_alert_says_why_a_recording_ends_within_its_manoeuvre(scored: Scored):
    y = fly(40, 6).y[2][:110]
    made = uploaded(scored.client, csv_of(y, TEST.dt), name="cut.csv")
    path, request = f"{RECORDINGS}/{made['id']}", {"monitor": scored.monitor}

    def outcomes() -> list[str]:
        answer = scored.client.post(f"{path}/scorings", json=request).raise_for_status().json()
        return [manoeuvre["outcome"] for manoeuvre in answer["manoeuvres"]]

    assert outcomes() == ["cut"]
    marker = {"t": 109 * TEST.dt, "kind": "marker", "text": "ABORT, test conductor"}
    scored.client.post(f"{path}/markers", json=marker).raise_for_status()
    assert outcomes() == ["aborted"]
