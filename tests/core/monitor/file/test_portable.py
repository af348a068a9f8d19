"""The portable monitor: to the bit, whole or not at all, and never more than data."""

import hashlib
import io
import json
import os
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from core import __version__
from core.dataset import Dataset
from core.limits.limits import Limits, Specification
from core.monitor import Monitor, MonitorRecipe, load, train
from core.monitor.file.portable import MonitorFileError, Section, pack, unpack
from core.monitor.predictor import PREDICTORS, PrincipalComponents
from core.monitor.recipe import mismatch
from core.monitor.score import SCORES, NegativeMagnitude
from core.monitor.validity.innovation import fit_innovation
from core.monitor.validity.support import Support
from core.recipe import from_plain, to_plain
from tests.support.oscillator import DT, THETA, Array
from tests.support.stored import EVALUATION

RECIPES = {
    "simple": MonitorRecipe(),
    "exact trajectory": MonitorRecipe(p_value="exact", t_early=0.3, n_delay=3, epsilon=0.2),
    "exact pointwise": MonitorRecipe(p_value="exact", calibration="pointwise", scaling="raw"),
    "pca": MonitorRecipe(predictor=PrincipalComponents(4), score=SCORES["unsafe_distance"]),
    "magnitude": MonitorRecipe(predictor=PREDICTORS["last_output"], score=NegativeMagnitude("r")),
}


@pytest.fixture(scope="module")
def blob(dataset: Dataset) -> bytes:
    return train(dataset).to_bytes()


def same(a: object, b: object) -> bool:
    """Whether two values are equal to the bit, through tuples."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("name", RECIPES)
def test_a_loaded_monitor_is_the_saved_one_to_the_bit(
    name: str, dataset: Dataset, flights: Array, tmp_path: Path
) -> None:
    monitor, path = train(dataset, RECIPES[name]), tmp_path / "m.fwm"
    monitor.save(path)
    loaded = load(str(path))
    for field in fields(Monitor):
        assert same(getattr(loaded, field.name), getattr(monitor, field.name)), field.name
    for y in flights:
        assert loaded.p_values(y).tobytes() == monitor.p_values(y).tobytes()
    said, before = (m.stream().update(0, flights[0][0]).as_dict() for m in (loaded, monitor))
    assert said == before
    assert loaded.to_bytes() == monitor.to_bytes()


def with_support(dataset: Dataset, **changes: object) -> Monitor:
    """A monitor that claims to have its validity calibrated."""
    safe, unsafe = (np.sort(np.random.default_rng(n).random((n, 2)), axis=0) for n in (130, 120))
    support = Support(np.arange(1.0, 7.0), safe, unsafe, n_samples=61, level=0.03)
    return replace(train(dataset), support=replace(support, **changes))  # pyright: ignore


def with_innovation(dataset: Dataset) -> Monitor:
    """One that is judged by innovations, as those trained by this program are."""
    nothing = np.full(6, np.nan)
    return with_support(dataset, sigma=nothing, innovation=fit_innovation(dataset))


@pytest.mark.parametrize("made", [with_support, with_innovation])
def test_a_support_comes_back_to_the_bit(
    made: Callable[[Dataset], Monitor], dataset: Dataset, flights: Array, tmp_path: Path
) -> None:
    monitor = made(dataset)
    monitor.save(tmp_path / "m.fwm")
    loaded = load(tmp_path / "m.fwm")
    assert loaded.support is not None
    for field in fields(Support):
        assert same(getattr(loaded.support, field.name), getattr(monitor.support, field.name))
    assert loaded.to_bytes() == monitor.to_bytes()
    times = DT * np.arange(len(flights[0]))
    risk = loaded.assess(times, flights[0], withdraw=False).p_value
    assert risk.tobytes() == train(dataset).p_values(flights[0]).tobytes()


def test_the_file_carries_what_is_known_and_nothing_else(dataset: Dataset, tmp_path: Path) -> None:
    """Limits and validity are sections that must be known, the evaluation one that may be."""
    bare = replace(train(dataset), specification=None)
    known = replace(with_support(dataset), evaluation=EVALUATION)
    for monitor, names in (
        (bare, ["monitor", "specification"]),
        (known, ["monitor", "specification", "validity", "evaluation"]),
    ):
        sections = unpack(monitor.to_bytes(), "m")
        assert list(sections) == names
        assert [name for name in names if not sections[name].required] == names[3:]
        monitor.save(tmp_path / "m.fwm")
        loaded = load(tmp_path / "m.fwm")
        assert (loaded.specification, loaded.evaluation) == (
            monitor.specification,
            monitor.evaluation,
        )


@pytest.mark.parametrize("specification", [Limits(beta=0.12, Ny=None), "hand-made verdicts", None])
def test_a_specification_comes_back(
    specification: Specification, dataset: Dataset, tmp_path: Path
) -> None:
    train(replace(dataset, specification=specification)).save(tmp_path / "m.fwm")
    assert load(tmp_path / "m.fwm").specification == specification


def with_section(
    blob: bytes, required: bool, name: str = "clairvoyance", version: int = 1
) -> bytes:
    """The same file as a later program might write it."""
    sections = [part for part in unpack(blob, "m").values() if part.name != name]
    return pack([*sections, Section(name, version, required, {"sees": "all"}, {"x": np.ones(3)})])


def test_a_later_programs_sections_are_ignored_or_refused_as_they_ask(
    blob: bytes, dataset: Dataset, flights: Array, tmp_path: Path
) -> None:
    (tmp_path / "m.fwm").write_bytes(with_section(blob, required=False))
    p_values = load(tmp_path / "m.fwm").p_values(flights[0])
    assert p_values.tobytes() == train(dataset).p_values(flights[0]).tobytes()
    for later in (with_section(blob, True), with_section(blob, True, "validity", 3)):
        assert "which this program does not support: upgrade" in refusal(later, tmp_path / "m.fwm")


NONSENSE = {
    "a level nobody can serve": {"level": 0.01},
    "numbers that are not sorted": {"safe": np.arange(300.0, 0.0, -1).reshape(150, 2)},
    "what is no number": {"unsafe": np.full((150, 2), np.nan)},
    "no flight": {"unsafe": np.empty((0, 2))},
    "another shape": {"sigma": np.ones(5)},
}


@pytest.mark.parametrize("nonsense", NONSENSE)
def test_a_support_that_makes_no_sense_is_refused(
    nonsense: str, dataset: Dataset, tmp_path: Path
) -> None:
    content = with_support(dataset, **NONSENSE[nonsense]).to_bytes()
    assert "holds a monitor that this program cannot rebuild" in refusal(
        content, tmp_path / "m.fwm"
    )


def test_the_header_says_where_a_monitor_comes_from(dataset: Dataset, blob: bytes) -> None:
    title, digest, body = blob.split(b"\n", 2)
    assert title == b"FOREWARN MONITOR 3"
    assert digest.decode() == hashlib.sha256(body).hexdigest()
    with np.load(io.BytesIO(body), allow_pickle=False) as archive:
        index = json.loads(archive["sections"].tobytes())
        assert sorted(archive["monitor/alphas"]) == archive["monitor/alphas"].tolist()
    assert [part["name"] for part in index] == ["monitor", "specification"]
    header = index[0]["header"]
    assert header["recipe"]["predictor"] == {"kind": "linear"}
    assert header["recipe"]["score"] == {"kind": "nearest_neighbor"}
    assert header["recipe"]["epsilon"] == 0.1
    assert header["seed"] == 7
    assert header["version"] == __version__
    assert header["dataset_digest"] == dataset.digest()
    assert header["dataset_recipe"] == {"aircraft": "oscillator"}
    assert header["theta_names"] == list(THETA)
    assert (header["dt"], header["h"], header["n_early"]) == (DT, 5, 0)


def test_the_digest_tells_datasets_apart(dataset: Dataset) -> None:
    digests = {dataset.digest(), replace(dataset, dt=0.04).digest()}
    for name in ("unsafe", "fail_index", "safe", "safe_times"):
        changed = getattr(dataset, name).copy()
        changed.flat[0] += 1
        digests.add(replace(dataset, **{name: changed}).digest())
    assert len(digests) == 6
    assert replace(dataset, unsafe=dataset.unsafe.copy()).digest() == dataset.digest()


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_survives_json(name: str) -> None:
    text = json.dumps(to_plain(RECIPES[name]))
    assert from_plain(MonitorRecipe(), json.loads(text)) == RECIPES[name]


def test_every_pair_of_predictor_and_score_survives_json() -> None:
    for predictor in PREDICTORS.values():
        for score in SCORES.values():
            if not mismatch(predictor, score):
                recipe = MonitorRecipe(predictor=predictor, score=score)
                assert (
                    from_plain(MonitorRecipe(), json.loads(json.dumps(to_plain(recipe)))) == recipe
                )


# --- what is refused -----------------------------------------------------------------------------


def refusal(content: bytes, path: Path) -> str:
    path.write_bytes(content)
    with pytest.raises(MonitorFileError) as error:
        load(path)
    assert str(path) in str(error.value)
    return str(error.value)


def signed(body: bytes) -> bytes:
    return b"FOREWARN MONITOR 3\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def test_a_file_cut_off_anywhere_is_refused(blob: bytes, tmp_path: Path) -> None:
    for length in [*range(100), *range(100, len(blob), 997), len(blob) - 1]:
        message = refusal(blob[:length], tmp_path / "m.fwm")
        if length <= len(b"FOREWARN MONITOR "):
            assert "is not a Forewarn monitor: choose a file written by" in message
        else:
            assert "is cut off or altered" in message
    assert "is cut off or altered" in refusal(blob + b"\0", tmp_path / "m.fwm")


def test_a_file_with_any_byte_changed_is_refused(blob: bytes, tmp_path: Path) -> None:
    for position in [*range(120), *range(120, len(blob), 499)]:
        for bit in (1, 0x80) if position >= 30 else (1, 2, 4, 8, 16, 32, 64, 128):
            altered = bytearray(blob)
            altered[position] ^= bit
            refusal(bytes(altered), tmp_path / "m.fwm")


def test_a_newer_format_is_refused(blob: bytes, tmp_path: Path) -> None:
    message = refusal(blob.replace(b"MONITOR 3", b"MONITOR 12", 1), tmp_path / "m.fwm")
    assert "has monitor format 12, this program reads up to 3: upgrade forewarn" in message


@pytest.mark.parametrize(
    "content", [b"", b"\n\n", b"beta,p,r\n0,0,0\n", b"PK\x03\x04", b"FOREWARN MONITOR x\n"]
)
def test_another_kind_of_file_is_refused(content: bytes, tmp_path: Path) -> None:
    assert "is not a Forewarn monitor" in refusal(content, tmp_path / "m.fwm")


def test_a_missing_file_and_a_directory_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MonitorFileError, match=r"cannot be read \(No such file or directory\)"):
        load(tmp_path / "none.fwm")
    with pytest.raises(MonitorFileError, match=r"cannot be read \(Is a directory\)"):
        load(tmp_path)


def test_a_pickle_is_never_opened(blob: bytes, tmp_path: Path) -> None:
    """Neither an archive with an object array nor a bare pickle, however well signed."""
    with np.load(io.BytesIO(blob.split(b"\n", 2)[2])) as archive:
        arrays = dict(archive)
    arrays["monitor/alphas"] = np.array([Trap(tmp_path / "sprung")], object)
    crafted = io.BytesIO()
    np.savez(crafted, **arrays)  # pyright: ignore[reportArgumentType]
    for body in (crafted.getvalue(), pickle.dumps(Trap(tmp_path / "sprung"))):
        assert "holds no monitor" in refusal(signed(body), tmp_path / "m.fwm")
    assert not (tmp_path / "sprung").exists()
    pickle.loads(pickle.dumps(Trap(tmp_path / "sprung")))
    assert (tmp_path / "sprung").exists()


class Trap:
    """Leaves a directory behind when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable, tuple]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("body", [b"", b"PK\x05\x06" + bytes(18)])
def test_a_signed_file_without_a_monitor_is_refused(body: bytes, tmp_path: Path) -> None:
    assert "holds no monitor" in refusal(signed(body), tmp_path / "m.fwm")


def test_an_unknown_predictor_is_refused(blob: bytes, tmp_path: Path) -> None:
    with np.load(io.BytesIO(blob.split(b"\n", 2)[2])) as archive:
        arrays = dict(archive)
    header = arrays["sections"].tobytes().replace(b'"linear"', b'"oracle"')
    arrays["sections"] = np.frombuffer(header, np.uint8)
    crafted = io.BytesIO()
    np.savez(crafted, **arrays)  # pyright: ignore[reportArgumentType]
    assert "oracle" in refusal(signed(crafted.getvalue()), tmp_path / "m.fwm")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("monitor/matrix", lambda a: a[:-1], "matrix is float64"),
        ("monitor/offset", lambda a: a[:-1], "5 entries instead of 6"),
        ("monitor/scale", lambda a: a[:2], "scale is float64"),
        ("monitor/alphas", lambda a: a[None], "alphas is float64"),
        ("monitor/safe_points", lambda a: a[:, :3], "safe points is float64"),
        ("monitor/safe_points", lambda a: a.astype(np.float32), "safe points is float32"),
        ("monitor/safe_where", lambda a: a[:-1], "safe where is int64"),
        ("monitor/safe_where", lambda a: a + 10**6, "safe where holds numbers outside"),
        ("monitor/unsafe_where", lambda a: a - 10**6, "unsafe where holds numbers outside"),
        ("monitor/theta_unsafe", lambda a: a[:, :0], "theta unsafe is float64"),
        ("transduction/start", lambda a: a + 10**6, "exact start holds numbers outside"),
        ("transduction/start", lambda a: a[::-1].copy(), "exact start does not delimit"),
        ("transduction/start", lambda a: a[:0], "exact points belong to no failure"),
        ("transduction/unsafe", lambda a: a[:-1], "exact unsafe is float64"),
    ],
)
def test_signed_arrays_that_do_not_fit_together_are_refused(
    name: str, change, message: str, dataset: Dataset, tmp_path: Path
) -> None:
    monitor = train(dataset, MonitorRecipe(p_value="exact"))
    body = monitor.to_bytes().split(b"\n", 2)[2]
    with np.load(io.BytesIO(body)) as archive:
        arrays = dict(archive)
    crafted = io.BytesIO()
    np.savez(crafted, **arrays | {name: change(arrays[name])})  # pyright: ignore
    assert message in refusal(signed(crafted.getvalue()), tmp_path / "monitor.fwm")


# --- saving --------------------------------------------------------------------------------------


@pytest.mark.parametrize("fails", ["fsync", "chmod", "replace"])
def test_an_interrupted_save_leaves_the_old_file_and_nothing_else(
    fails: str, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "m.fwm"
    path.write_bytes(b"the old one")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, fails, interrupt)
    with pytest.raises(KeyboardInterrupt):
        train(dataset).save(path)
    assert path.read_bytes() == b"the old one"
    assert list(tmp_path.iterdir()) == [path]


def test_what_does_not_shrink_is_stored_and_read_as_what_was_compressed() -> None:
    arrays = {
        "measured": np.random.default_rng(1).standard_normal((20_000, 6)),
        "counted": np.repeat(np.arange(2_000), 20).reshape(-1, 2),
        "by_columns": np.asfortranarray(np.random.default_rng(2).standard_normal((300, 50))),
        "empty": np.empty((0, 6)),
        "single": np.array(3.0),
    }
    blob = pack([Section("card", 1, False, {}, arrays)])
    body = blob.split(b"\n", 2)[2]
    compressed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        kinds = {member.filename: member.compress_type for member in archive.infolist()}
    with np.load(io.BytesIO(body)) as archive:
        np.savez_compressed(compressed, **dict(archive))  # pyright: ignore[reportArgumentType]
    assert kinds["card/measured.npy"] == kinds["card/by_columns.npy"] == zipfile.ZIP_STORED
    assert kinds["card/counted.npy"] == zipfile.ZIP_DEFLATED
    for file in (blob, signed(compressed.getvalue())):
        read = unpack(file, "monitor")["card"].arrays
        assert list(read) == list(arrays)
        assert all(same(read[name], arrays[name]) for name in arrays)


def test_saving_replaces_the_old_file_and_leaves_nothing_else(
    dataset: Dataset, blob: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "m.fwm"
    path.write_bytes(b"the old one, which is longer in places" * 10_000)
    train(dataset).save(path)
    assert path.read_bytes() == blob
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_larger_than_the_memory_is_refused_by_its_first_bytes(tmp_path: Path) -> None:
    recording = tmp_path / "flight.csv"
    with recording.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(MonitorFileError, match=r"flight\.csv is not a Forewarn monitor"):
        load(recording)
