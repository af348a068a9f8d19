"""Recordings over REST: upload, mapping, preview and deletion, each complete or without effect."""

import hashlib
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from app.recordings import files as recording_files
from app.recordings import recordings as recordings_module
from core.channels import KEYS
from tests.support.api import api, problem, store_of
from tests.support.recorded import HEAD, OCTETS, RECORDINGS, csv_of, kept_files, upload, uploaded


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory):
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def client(data_dir):
    with api(data_dir, max_upload_bytes=100_000, max_body_bytes=20_000) as client:
        yield client


@pytest.fixture
def untouched(client, data_dir):
    """Nothing is kept of what a test does."""
    rows, files = client.get(RECORDINGS).json(), kept_files(data_dir)
    yield
    assert client.get(RECORDINGS).json() == rows
    assert kept_files(data_dir) == files


@pytest.fixture(scope="module")
def file(flights):
    return csv_of(flights[0])


@pytest.fixture(scope="module")
def kept(client, file):
    return uploaded(client, file, name="kept.csv")


def signal_of(recording, key):
    return recording["mapping"]["channels"][key]["signal"]


def test_a_file_becomes_a_recording(client, data_dir, file, flights):
    answer = upload(client, file, name="rudder doublet.csv", aircraft="PH-LAB")
    assert answer.status_code == 201, answer.text
    recording = answer.json()
    assert answer.headers["location"] == f"{RECORDINGS}/{recording['id']}"
    assert client.get(answer.headers["location"]).json() == recording
    assert (recording["name"], recording["aircraft"]) == ("rudder doublet.csv", "PH-LAB")
    assert recording["size"] == len(file)
    assert recording["digest"] == hashlib.sha256(file).hexdigest()
    assert recording["format"] == "csv"
    assert recording["duration"] == pytest.approx(3.0)
    assert recording["mapping_state"] == "proposed"
    assert recording["missing"] == []
    assert recording["problem"] is None
    assert recording["bad_rows"] == {"n": 0, "share": 0.0, "rows": []}
    assert [group["n_rows"] for group in recording["contents"]["groups"]] == [61]
    assert recording["contents"]["groups"][0]["rate"] == pytest.approx(20.0)
    names = [signal["name"] for signal in recording["contents"]["signals"]]
    lateral = recording["contents"]["signals"][names.index(signal_of(recording, "Ny"))]
    assert lateral["max"] == flights[0][:, 3].max()
    assert lateral["mean"] == pytest.approx(flights[0][:, 3].mean())
    assert (lateral["n"], lateral["missing"]) == (61, 0)
    assert 0 < recording["rationales"]["Ny"]["confidence"] <= 1
    stored = data_dir / "recordings" / recording["id"]
    assert (stored / "file").read_bytes() == file
    listed = client.get(RECORDINGS).json()[0]
    assert listed == {key: recording[key] for key in listed}


def test_identical_files_are_reported(client, kept, file):
    again = uploaded(client, file, name="again.csv")
    assert again["same_as"] is not None
    assert again["same_as"] != again["id"]
    listed = {one["id"]: one["same_as"] for one in client.get(RECORDINGS).json()}
    assert listed[again["id"]] == again["same_as"]
    assert listed[again["same_as"]] is None
    assert client.delete(f"{RECORDINGS}/{again['id']}").status_code == 204
    assert uploaded(client, file + b"\n", name="other.csv")["same_as"] is None


@pytest.mark.parametrize(
    ("given", "kept_as"),
    [
        ("../../etc/flight.csv", "flight.csv"),
        ("C:\\Users\\crew\\flight 12.csv", "flight 12.csv"),
        ("Flügel­versuch ×2 – δ_r.csv", "Flügelversuch ×2 – δ_r.csv"),
        ("飛行\u202egnp.csv", "飛行gnp.csv"),
        ("a\tb\x00c\r\n.csv", "a b c .csv"),
        ("e\u0301" + "x" * 240 + ".csv", "é" + "x" * 240 + ".csv"),
    ],
)
def test_a_name_is_stored_without_its_path(client, data_dir, file, given, kept_as):
    recording = uploaded(client, file, name=given)
    assert recording["name"] == kept_as
    assert (data_dir / "recordings" / recording["id"] / "file").is_file()
    assert client.delete(f"{RECORDINGS}/{recording['id']}").status_code == 204


@pytest.mark.parametrize("name", ["", "x" * 256, "/", "..\\", "\u200b\x07"])
def test_an_invalid_file_name_is_refused(client, file, name, untouched):
    assert "name" in problem(upload(client, file, name=name), 422)


@pytest.mark.parametrize("kind", ["text/csv", "application/x-www-form-urlencoded", None])
def test_a_file_is_accepted_with_any_content_type(client, file, kind):
    headers = {} if kind is None else {"content-type": kind}
    answer = client.post(RECORDINGS, content=file, headers=headers)
    assert answer.status_code == 201
    assert answer.json()["name"] == "upload"
    assert answer.json()["digest"] == hashlib.sha256(file).hexdigest()
    assert client.delete(f"{RECORDINGS}/{answer.json()['id']}").status_code == 204


def form(content: bytes, name: str = "flight.csv", before: bytes = b"") -> bytes:
    quoted = name.replace('"', chr(92) + '"')
    head = f'Content-Disposition: form-data; name="file"; filename="{quoted}"'.encode()
    field = b"--xx\r\n" + head + b"\r\nContent-Type: text/csv\r\n\r\n"
    return before + field + content + b"\r\n--xx--\r\n"


NOTE = b'--xx\r\nContent-Disposition: form-data; name="note"\r\n\r\nhello\r\n'
IN_FORM = {"content-type": 'multipart/form-data; boundary="xx"'}


@pytest.mark.parametrize("step", [1, 7, 1000, 10**9])
@pytest.mark.parametrize("before", [b"", NOTE, b"preamble\r\n"])
def test_a_file_in_a_form_is_read_from_chunks_of_any_size(client, file, step, before):
    file = file[:3000].rpartition(b"\n")[0] if step == 1 else file
    body = form(file, 'my "flight".csv', before)
    pieces = (body[k : k + step] for k in range(0, len(body), step))
    answer = client.post(RECORDINGS, content=pieces, headers=IN_FORM)
    assert answer.status_code == 201, answer.text
    assert answer.json()["name"] == 'my "flight".csv'
    assert answer.json()["digest"] == hashlib.sha256(file).hexdigest()
    assert client.delete(f"{RECORDINGS}/{answer.json()['id']}").status_code == 204


@pytest.mark.parametrize(
    ("body", "headers", "words"),
    [
        (form(b"t,p\n")[:-12], IN_FORM, "the form ends before the file"),
        (NOTE + b"--xx--\r\n", IN_FORM, "the form has no file"),
        (b"", IN_FORM, "the form ends"),
        (b"--xx\r\n" + b"a" * 20_000, IN_FORM, "headers are too long"),
        (form(b"t,p\n"), {"content-type": "multipart/form-data"}, "boundary"),
    ],
)
def test_a_form_without_a_complete_file_is_refused(client, body, headers, words, untouched):
    assert words in problem(client.post(RECORDINGS, content=body, headers=headers), 422)


def test_a_compressed_body_is_refused(client, file, untouched):
    headers = OCTETS | {"content-encoding": "gzip"}
    answer = client.post(RECORDINGS, content=file, params={"name": "a.csv"}, headers=headers)
    assert "gzip" in problem(answer, 415)


def test_an_upload_has_its_own_limit_with_or_without_a_length(client, file, untouched):
    def endless():
        yield HEAD.encode()
        for _ in range(1000):
            yield b"\n0,0,0,0,0,0,0" * 100

    for body in (b"0" * 100_001, endless()):
        assert "100000 bytes" in problem(upload(client, body), 413)
    larger = client.put(f"{RECORDINGS}/x/mapping", content=b" " * 20_001)
    assert "20000 bytes" in problem(larger, 413)


def test_an_upload_may_be_larger_than_other_bodies(client, flights):
    body = csv_of(np.concatenate([flights[0]] * 4))
    assert len(body) > 20_000
    identity = uploaded(client, iter([body[:30_000], body[30_000:]]))["id"]  # pyright: ignore
    assert client.delete(f"{RECORDINGS}/{identity}").status_code == 204


@pytest.mark.parametrize(
    "body",
    [b"", b"\0\1\2" * 1000, b"nothing in it\n", b"PK\3\4" + b"x" * 100, b"t,beta\n" * 50],
)
def test_an_unreadable_file_leaves_nothing(client, body, untouched):
    assert problem(upload(client, body, name="bad.csv"), 422)


def test_an_empty_file_is_refused_by_name(client, untouched):
    said = problem(upload(client, b"", name="rud1.csv"), 422)
    assert said == "the file is empty: choose a file with telemetry"


def test_no_upload_starts_on_a_full_disk(client, file, untouched, monkeypatch):
    monkeypatch.setattr(recording_files, "SPARE_BYTES", 2**62)
    said = problem(upload(client, file), 507)
    assert re.search(r"needs [1-9][\d,]* KiB, .* has 0 KiB available", said)


def test_a_disk_that_fills_up_leaves_nothing(client, file, untouched, monkeypatch):
    asked = []

    def require(self, n_bytes):
        asked.append(n_bytes)
        if len(asked) > 1:
            raise recording_files.NoSpace("the disk is full")

    monkeypatch.setattr(recording_files.RecordingFiles, "require", require)
    assert "full" in problem(upload(client, file), 507)


def test_a_reader_that_dies_leaves_nothing(client, file, untouched, monkeypatch):
    def dies(*_args, **_kwargs):
        raise RuntimeError("a fault of the program")

    monkeypatch.setattr(recordings_module, "propose_mapping", dies)
    assert "reference" in problem(upload(client, file), 500)


def test_a_store_that_fails_at_the_last_moment_leaves_nothing(client, file, untouched, monkeypatch):
    def fails(_):
        raise RuntimeError("a fault of the program")

    monkeypatch.setattr(store_of(client).recordings, "complete", fails)
    assert problem(upload(client, file), 500)
    assert store_of(client).recordings.incomplete() == []


def test_simultaneous_uploads_are_each_complete(client, flights):
    files = [csv_of(y) for y in flights[:6]]

    def send(number):
        return uploaded(client, files[number], name=f"{number}.csv")

    with ThreadPoolExecutor(6) as pool:
        recordings = list(pool.map(send, range(6)))
    for recording, body in zip(recordings, files, strict=True):
        assert recording["digest"] == hashlib.sha256(body).hexdigest()
        assert client.delete(f"{RECORDINGS}/{recording['id']}").status_code == 204


def test_too_many_uploads_at_once_are_refused(client, file, untouched, monkeypatch):
    monkeypatch.setattr(recordings_module, "MOST_UPLOADS", 0)
    assert "uploads are in progress" in problem(upload(client, file), 429)


def test_bad_rows_are_listed(client, flights):
    lines = csv_of(np.concatenate([flights[0]] * 5)).decode().splitlines()
    lines[7] = "what happened here,,,"
    recording = uploaded(client, "\n".join(lines).encode())
    assert recording["bad_rows"]["n"] == 1
    assert recording["bad_rows"]["share"] == pytest.approx(1 / 305)
    assert recording["bad_rows"]["rows"][0]["line"] == 8
    assert client.delete(f"{RECORDINGS}/{recording['id']}").status_code == 204


def test_a_mapping_can_be_tried_without_being_stored(client, kept, flights):
    path = f"{RECORDINGS}/{kept['id']}"
    mapping = kept["mapping"] | {"channels": dict(kept["mapping"]["channels"])}
    mapping["channels"]["Ny"] = mapping["channels"]["Ny"] | {"sign": -1}
    seen = client.post(f"{path}/preview", json={"mapping": mapping}).json()
    assert seen["problem"] is None
    assert set(seen["channels"]) == set(KEYS)
    assert seen["channels"]["Ny"]["max"] == -flights[0][:, 3].min()
    assert seen["channels"]["Ny"]["unit"] == "g"
    assert len(seen["channels"]["Ny"]["low"]) == len(seen["channels"]["Ny"]["t"]) == 61
    assert seen["quality"]["sentences"]
    assert client.get(path).json() == kept
    mapping["channels"]["Ny"] = mapping["channels"]["Ny"] | {"signal": "no such"}
    seen = client.post(f"{path}/preview", json={"mapping": mapping}).json()
    assert "no such" in seen["problem"]
    assert seen["quality"] is None
    assert "Ny" not in seen["warnings"]
    twice = mapping["channels"]["p"] | {"unit": "deg/s"}
    mapping["channels"] |= {"p": twice, "r": twice}
    seen = client.post(f"{path}/preview", json={"mapping": mapping}).json()
    assert seen["warnings"]["p"] == [
        "p_radps is also mapped to yaw rate",
        "its name gives p_radps in rad/s, not in deg/s",
    ]


def test_a_signal_preview_has_the_values_of_the_file(client, kept, flights):
    path = f"{RECORDINGS}/{kept['id']}/signals"
    names = [signal["name"] for signal in kept["contents"]["signals"]]
    seen = client.get(f"{path}/{names.index(signal_of(kept, 'p'))}/preview").json()
    assert (seen["name"], seen["n"], seen["rows"]) == (signal_of(kept, "p"), 61, 1)
    assert seen["low"] == seen["high"] == flights[0][:, 1].tolist()
    for index in (len(names), -1):
        assert "signals 0 to 6" in problem(client.get(f"{path}/{index}/preview"), 404)


def test_a_recording_without_times_is_mapped_by_a_rate(client, file):
    untimed = b"".join(row.partition(b",")[2] for row in file.splitlines(keepends=True))
    made = uploaded(client, untimed)
    assert "or give the sample rate" in made["problem"]
    path = f"{RECORDINGS}/{made['id']}"
    by_rate = made["mapping"] | {"times": {"": {"rate": 20, "start": 45065}}}
    seen = client.post(f"{path}/preview", json={"mapping": by_rate}).json()
    assert seen["problem"] is None
    assert seen["channels"]["beta"]["t"][0] == 45_065.0
    confirmed = client.put(f"{path}/mapping", json={"mapping": by_rate}).json()
    assert confirmed["duration"] == pytest.approx(3.0)
    assert confirmed["contents"]["groups"][0]["rate"] == pytest.approx(20.0)
    by_rate["times"][""]["signal"] = "t"
    refused = client.post(f"{path}/preview", json={"mapping": by_rate})
    assert "either a signal or a rate" in problem(refused, 422)


def test_a_mapping_file_is_accepted_as_the_body(client, kept):
    path = f"{RECORDINGS}/{kept['id']}"
    mapping = {**kept["mapping"]}
    wrapped = client.post(f"{path}/preview", json={"mapping": mapping})
    assert client.post(f"{path}/preview", json=mapping).json() == wrapped.json()
    assert "beta" in client.post(f"{path}/preview", json=mapping).json()["channels"]


def test_a_mapping_confirmed_over_a_warning_stays_marked(client, flights):
    made = uploaded(client, csv_of(flights[0]))
    assert made["confirmed_over"] is None
    path = f"{RECORDINGS}/{made['id']}"
    mapping = made["mapping"]
    confirmed = client.put(f"{path}/mapping", json={"mapping": mapping}).json()
    assert (confirmed["mapping_state"], confirmed["confirmed_over"]) == ("confirmed", {})
    channels = mapping["channels"]
    changed = mapping | {"channels": channels | {"p": channels["p"] | {"unit": "deg/s"}}}
    warnings = client.post(f"{path}/preview", json={"mapping": changed}).json()["warnings"]
    assert warnings
    client.put(f"{path}/mapping", json={"mapping": changed})
    (listed,) = (each for each in client.get(RECORDINGS).json() if each["id"] == made["id"])
    assert client.get(path).json()["confirmed_over"] == listed["confirmed_over"] == warnings
    client.put(f"{path}/mapping", json={"mapping": mapping})
    assert client.get(path).json()["confirmed_over"] == {}


def test_a_confirmed_mapping_is_remembered_for_the_aircraft(client, flights):
    odd = csv_of(flights[1], head="t_s,a,b,c,d,e,f")
    first = uploaded(client, odd, aircraft="D-IFSA")
    assert first["mapping_state"] == "proposed"
    signals = dict(zip(KEYS, "abcdef", strict=True))
    names = [signal["name"] for signal in first["contents"]["signals"]]
    units = {"beta": "deg", "p": "rad/s", "r": "rad/s", "Ny": "g"}
    mapping = {
        "channels": {
            key: {
                "signal": next(name for name in names if name.startswith(signal)),
                "unit": units.get(key, "rad"),
                "sign": -1 if key == "r" else 1,
                "bias": 0.1 if key == "Ny" else 0.0,
            }
            for key, signal in signals.items()
        },
        "times": first["mapping"]["times"],
    }
    path = f"{RECORDINGS}/{first['id']}/mapping"
    confirmed = client.put(path, json={"mapping": mapping}).json()
    assert confirmed["mapping_state"] == "confirmed"
    assert confirmed["missing"] == []
    assert confirmed["quality"]
    assert confirmed["mapping"]["channels"]["Ny"]["bias"] == 0.1
    next_one = csv_of(flights[2], head="t_s,a,b,c,d,e,f")
    again = uploaded(client, next_one, aircraft="D-IFSA")
    assert again["mapping_state"] == "remembered"
    assert again["mapping"]["channels"] == confirmed["mapping"]["channels"]
    for said in ({"aircraft": "OO-ABC"}, {}):
        assert uploaded(client, next_one, **said)["mapping_state"] == "proposed"
    other = uploaded(client, csv_of(flights[2], head="t_s,a,b,c,d,e,g"), aircraft="OO-XYZ")
    assert other["mapping_state"] == "proposed"
    order = {"mapping": mapping, "aircraft": "OO-XYZ", "remember": False}
    assert client.put(path, json=order).json()["aircraft"] == "OO-XYZ"
    assert store_of(client).mappings.find("OO-XYZ", "") is None


def test_without_an_aircraft_nothing_is_remembered(client, flights):
    odd = csv_of(flights[1], head="t_s,beta_rad,p_radps,r_radps,Ny_g,da_rad,dr_rad")
    first = uploaded(client, odd)
    path = f"{RECORDINGS}/{first['id']}/mapping"
    order = {"mapping": first["mapping"], "remember": True}
    assert client.put(path, json=order).json()["mapping_state"] == "confirmed"
    assert uploaded(client, odd)["mapping_state"] == "proposed"


def test_a_mapping_that_cannot_be_applied_is_not_kept(client, kept):
    path = f"{RECORDINGS}/{kept['id']}"
    for wrong, words in (
        ({"Ny": {"signal": "no such", "unit": "g"}}, "no such"),
        ({"alfa": {"signal": "t_s", "unit": "rad"}}, "alpha"),
        ({"Ny": {"unit": "g"}}, "either a signal or a derivation"),
    ):
        mapping = {"channels": wrong, "times": kept["mapping"]["times"]}
        assert words in problem(client.put(f"{path}/mapping", json={"mapping": mapping}), 422)
    assert client.get(path).json() == kept


def test_a_deleted_recording_leaves_nothing(client, data_dir, file):
    before = kept_files(data_dir)
    identity = uploaded(client, file)["id"]
    assert client.delete(f"{RECORDINGS}/{identity}").status_code == 204
    assert kept_files(data_dir) == before
    for path in ("", "/scorings", "/markers", "/signals/0/preview"):
        assert identity in problem(client.get(f"{RECORDINGS}/{identity}{path}"), 404)
    assert identity in problem(client.delete(f"{RECORDINGS}/{identity}"), 404)


def test_lost_files_are_reported_and_the_recording_can_be_deleted(client, data_dir, file):
    identity = uploaded(client, file)["id"]
    (data_dir / "recordings" / identity).rename(data_dir / "lost")
    assert "is missing" in problem(client.get(f"{RECORDINGS}/{identity}"), 503)
    assert client.get(RECORDINGS).status_code == 200
    assert client.delete(f"{RECORDINGS}/{identity}").status_code == 204


def test_markers_are_added_changed_and_deleted(client, kept):
    path = f"{RECORDINGS}/{kept['id']}/markers"
    answer = client.post(path, json={"t": 1.5, "text": "gust"})
    assert answer.status_code == 201
    marker = answer.json()
    assert (marker["kind"], marker["end"]) == ("marker", None)
    note = {"t": 0.5, "end": 0.75, "text": "räusch", "kind": "note"}
    other = client.post(path, json=note).json()
    assert client.get(path).json() == [other, marker]
    changed = client.put(f"{path}/{marker['id']}", json=note).json()
    assert changed == marker | note
    assert "before the start" in problem(client.post(path, json=note | {"end": 0.1}), 422)
    for one in (marker, other):
        assert client.delete(f"{path}/{one['id']}").status_code == 204
    assert client.get(path).json() == []
    assert problem(client.delete(f"{path}/{marker['id']}"), 404)


def test_the_catalog_has_formats_and_targets(client):
    telemetry = client.get("/api/v1/catalog").json()["telemetry"]
    formats = {one["key"]: one for one in telemetry["formats"]}
    assert formats["csv"]["installed"] is True
    assert formats["csv"]["endings"][0] == ".csv"
    assert formats["ulog"]["extra"] == "ulog"
    targets = {one["key"]: one for one in telemetry["targets"]}
    assert targets["beta"]["units"][:2] == ["rad", "deg"]
    for way in telemetry["derivations"]:
        assert {way["target"], *way["needs"]} <= targets.keys()
