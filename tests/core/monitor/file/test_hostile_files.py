"""Malicious monitor files: refused with one sentence, or they give a working monitor.

All have a correct digest, because anyone who writes a file can sign it.
"""

import hashlib
import io
import json
import math
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.dataset import Dataset
from core.evaluation.certificate import warnings_of
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import UNFOLDS_TO, MonitorFileError, Section, pack, unpack
from core.monitor.group import LargestDeflection
from core.monitor.predictor import PeakRidge, PrincipalComponents
from core.monitor.score import SCORES, NegativeMagnitude
from core.monitor.validity.innovation import fit_innovation
from core.monitor.validity.support import Support
from tests.support import oscillator
from tests.support.repetition import examples
from tests.support.stored import EVALUATION

RECIPES = {
    "simple": MonitorRecipe(),
    "exact": MonitorRecipe(p_value="exact", t_early=0.3, n_delay=3, epsilon=0.2),
    "pca": MonitorRecipe(predictor=PrincipalComponents(4), score=SCORES["unsafe_distance"]),
    "magnitude": MonitorRecipe(score=NegativeMagnitude("r")),
    "peaks": MonitorRecipe(
        predictor=PeakRidge(past_s=0.3, phase="start"), score=SCORES["rest_of_card"]
    ),
    "groups": MonitorRecipe(groups=LargestDeflection(), epsilon=0.3),
}


@cache
def sections_of(name: str) -> dict[str, Section]:
    """The sections of a monitor that has one of each; the simple one's validity is of today."""
    recipe = RECIPES[name]
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    monitor = train(dataset, recipe)
    safe, unsafe = (np.sort(np.random.default_rng(n).random((n, 2)), axis=0) for n in (130, 120))
    sigma = np.full(6, 1.0 if recipe.predictor.forecasts else np.nan)
    support = Support(sigma, safe, unsafe, n_samples=61, level=0.03)
    if name == "simple":
        innovation = fit_innovation(dataset)
        support = replace(support, sigma=np.full(6, np.nan), innovation=innovation)
    return unpack(replace(monitor, support=support, evaluation=EVALUATION).to_bytes(), "m")


def refusal(content: bytes) -> str:
    with pytest.raises(MonitorFileError) as error:
        from_bytes(content, "m.fwm")
    assert str(error.value).startswith("m.fwm ")
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500
    return str(error.value)


def changed(
    sections: Mapping[str, Section], name: str, path: tuple[str, ...], value: object
) -> bytes:
    """A file with one value of a header, or one array, replaced."""
    section = sections[name]
    if path[0] in section.arrays:
        section = section._replace(arrays=dict(section.arrays) | {path[0]: value})
    else:
        header = json.loads(json.dumps(section.header))
        inner = header
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
        section = section._replace(header=header)
    return pack({**sections, name: section}.values())


# --- fields --------------------------------------------------------------------------------------

NUMBERS = [math.nan, math.inf, -1, 0, 0.5, 10**400, 1e300, 5e-324, True, None, "1", [], {}]
NO_SENSE = {
    ("monitor", ("h",)): [*NUMBERS, -3, 4, 6, 10**12],
    ("monitor", ("dt",)): NUMBERS,
    ("monitor", ("n_early",)): [1, 13, -1, None, 0.0, "0"],
    ("monitor", ("seed",)): [-1, 0.5, "1", True],
    ("monitor", ("theta_names",)): ["zeta", None, [1, 2], {}],
    ("monitor", ("dataset_recipe",)): [None, [], "f16", {"dt": math.nan}],
    ("monitor", ("dataset_digest",)): [None, 1, "\ud800"],
    ("monitor", ("version",)): [None, 1],
    ("monitor", ("recipe",)): [None, [], "linear"],
    ("monitor", ("recipe", "n_delay")): [*NUMBERS, 10**9],
    ("monitor", ("recipe", "t_early")): [*NUMBERS, 10.0],
    ("monitor", ("recipe", "epsilon")): [x for x in NUMBERS if x not in (0.5, 5e-324)],
    ("monitor", ("recipe", "calibration")): ["", None, 1],
    ("monitor", ("recipe", "p_value")): ["exact", 1],
    ("monitor", ("recipe", "score")): [None, "oracle", {"kind": []}, {"kind": "oracle"}],
    ("specification", ("specification",)): [[], 1, {"Ny": -1}, {"Ny": "1"}, {"Ny": True}],
    ("validity", ("n_samples",)): [x for x in NUMBERS if x != 1],
    ("validity", ("level",)): [x for x in NUMBERS if x not in (0.5, 5e-324)],
    ("validity", ("n_past",)): [*NUMBERS, 1, 5],
    ("validity", ("spacing",)): [*NUMBERS, 10**5],
    ("validity", ("window",)): [*NUMBERS, 10**6],
    ("evaluation", ("epsilon",)): [x for x in NUMBERS if x not in (0.5, 5e-324)],
    ("evaluation", ("n_unsafe",)): NUMBERS,
    ("evaluation", ("n_safe",)): NUMBERS,
    ("evaluation", ("at_epsilon",)): [{}, None, [], {"misses": 1}, {"misses": [], "withdrawn": 0}],
    ("evaluation", ("leads",)): [{}, None, []],
    ("evaluation", ("leads", "n_timely")): [-1, 10**9, "4", None],
    ("evaluation", ("leads", "median")): ["4", None, []],
    ("evaluation", ("prevention",)): [{}, None, [], {"n_unsafe": 1}],
    ("evaluation", ("prevention", "prevented")): [[], [1], ["4"], [-1] * 5, [10**9] * 5, None],
    ("evaluation", ("prevention", "caused")): [[10**9] * 5, [0.5] * 5],
    ("evaluation", ("prevention", "stopped")): [-1, 10**9, "4", None],
    ("evaluation", ("prevention", "reactions_s")): [[], [0.0] * 5, ["a"] * 5],
    ("evaluation", ("robustness",)): [[], None, {"other": {}}, {"other": None}],
    ("evaluation", ("robustness", "doubled_noise", "misses")): [-1, 10**9, "4", None],
    ("evaluation", ("robustness", "doubled_noise", "safe_withdrawn")): [-1, 181, "4", None],
    ("evaluation", ("robustness", "doubled_noise", "words")): [None, 1],
    ("evaluation", ("robustness", "near", "miss_rate")): [-0.1, 1.1, "4", []],
    ("evaluation", ("robustness", "near", "miss_interval")): [None, [], [0.5, 0.2], [0.1, 2]],
    ("evaluation", ("robustness", "near", "n_aircraft")): [-1, 0.5, "4", None],
    ("evaluation", ("robustness", "near", "worst")): [1, [], [6, 5], [0, 0], ["a", "b"]],
    ("evaluation", ("groups",)): [None, 1, [{}], [None]],
    ("evaluation", ("groups", 0, "n_unsafe")): [0, -1, 101, 4, "80", None],
    ("evaluation", ("groups", 0, "misses")): [-1, 81, "5", None],
    ("evaluation", ("groups", 0, "name")): [None, 1],
    ("evaluation", ("groups", 0, "miss_interval")): [None, [], [0.5, 0.2], [0.1, 2], ["a", "b"]],
    ("evaluation", ("curves",)): [{}, None, [], {"epsilon": [0.1], "misses": []}, {"epsilon": 1}],
    ("evaluation", ("curves", "misses")): [[], [4, 4], ["4"], [-1], [10**9], None, [math.nan]],
}


@pytest.mark.parametrize(("section", "path"), NO_SENSE)
def test_a_header_that_makes_no_sense_is_refused(section: str, path: tuple[str, ...]) -> None:
    for value in NO_SENSE[section, path]:
        refusal(changed(sections_of("simple"), section, path, value))


def put(value: float) -> Callable[[npt.NDArray[Any]], npt.NDArray[Any]]:
    def change(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        array = array.copy()
        array.flat[-1] = value
        return array

    return change


nan, inf = put(math.nan), put(math.inf)
ARRAYS = {
    ("monitor", "alphas"): [nan, lambda a: a[::-1], lambda a: a[:0], put(math.inf)],
    ("monitor", "scale"): [nan, inf, put(0.0), put(-1.0)],
    ("monitor", "training_max_abs"): [nan, put(-1.0)],
    ("monitor", "matrix"): [nan, inf],
    ("monitor", "offset"): [nan, inf],
    ("monitor", "unsafe_points"): [nan, inf, lambda a: a[:-1]],
    ("monitor", "safe_points"): [nan, inf, lambda a: a[:0]],
    ("monitor", "unsafe_where"): [put(-1), put(2**40), lambda a: a.astype(np.int32)],
    ("monitor", "theta_unsafe"): [nan, lambda a: a[:1]],
    ("transduction", "alphas"): [nan, put(-1e9), lambda a: a[:-1]],
    ("transduction", "points"): [nan, inf],
    ("transduction", "unsafe"): [nan, put(-1.0)],
    ("transduction", "safe"): [nan, inf, put(-1.0)],
    ("transduction", "start"): [put(0), lambda a: a + 1],
    ("validity", "sigma"): [nan, inf, put(0.0), put(-1.0), lambda a: a * np.nan],
    ("validity", "safe"): [nan, lambda a: a[::-1]],
    ("validity", "matrix"): [nan, inf, lambda a: a[:-1], lambda a: a.astype(np.float32)],
    ("validity", "offset"): [nan, inf, lambda a: a[:-1]],
}


@pytest.mark.parametrize(("section", "name"), ARRAYS)
def test_an_array_that_makes_no_sense_is_refused(section: str, name: str) -> None:
    file = next(f for f in map(sections_of, ("exact", "simple")) if name in f[section].arrays)
    array = file[section].arrays[name]
    for change in ARRAYS[section, name]:
        refusal(changed(file, section, (name,), np.ascontiguousarray(change(array))))


GROUPS = {
    ("kind",): ["pooled", None, "first_limit", []],
    ("rule",): [{}, None, [1]],
    ("rule", "surface"): [*NUMBERS, 3, 6],
    ("rule", "low"): [-1.0, 0.0, 1, "1", None, 1e300],
    ("rule", "high"): [-1.0, 0.0, 10**400, None],
    ("alphas",): [
        np.zeros((3, 0)),
        np.zeros((2, 3)),
        np.full((3, 2), np.nan),
        np.eye(3),
        np.eye(1),
    ],
}


@pytest.mark.parametrize("path", GROUPS)
def test_groups_that_make_no_sense_are_refused(path: tuple[str, ...]) -> None:
    for value in GROUPS[path]:
        refusal(changed(sections_of("groups"), "groups", path, value))
    for name, others in (("groups", "simple"), ("simple", "groups")):
        without = {key: part for key, part in sections_of(name).items() if key != "groups"}
        if name == "simple":
            without["groups"] = sections_of(others)["groups"]
        assert "section groups do not match" in refusal(pack(without.values()))


@pytest.mark.parametrize(("key", "value"), [("always", 1), ("always", None), ("running", False)])
def test_a_transduction_that_is_not_of_these_failures_is_refused(key: str, value: object) -> None:
    refusal(changed(sections_of("exact"), "transduction", (key,), value))


def test_a_recipe_that_contradicts_the_transduction_is_refused() -> None:
    without = [part for name, part in sections_of("exact").items() if name != "transduction"]
    assert "section transduction" in refusal(pack(without))


@pytest.mark.parametrize(
    ("field", "value"),
    [("name", 1), ("version", "1"), ("version", None), ("required", 0), ("header", [])],
)
def test_an_invalid_section_is_refused(field: str, value: object) -> None:
    odd = Section("odd", 1, True, {}, {})._replace(**{field: value})
    assert "holds no monitor" in refusal(pack([*sections_of("simple").values(), odd]))
    twice = [*sections_of("simple").values(), sections_of("simple")["monitor"]]
    assert "section 'monitor' twice" in refusal(pack(twice))


def paths() -> list[tuple[str, str, tuple[str, ...]]]:
    """Each array and header field of each section of each file."""
    found: list[tuple[str, str, tuple[str, ...]]] = [
        ("exact", "monitor", ("recipe", key))
        for key in sections_of("exact")["monitor"].header["recipe"]
    ]
    for file in RECIPES:
        for name, section in sections_of(file).items():
            found += [(file, name, (key,)) for key in (*section.arrays, *section.header)]
    return found


HOSTILE = st.one_of(
    st.sampled_from([*NUMBERS, -(2**63), 2**64, "\ud800", [[]], {"kind": "linear"}, "x" * 10_000]),
    st.floats(),
    st.integers(-5, 200),
    st.text(max_size=5),
)


@st.composite
def hostile_arrays(draw: st.DrawFn, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The array with values put in, or of another order, length, shape or kind."""
    value = draw(st.sampled_from([-1, 0, 1, 2**62, 1e-320, 1e300, -1e300, 7, np.nan, np.inf]))
    out = array.copy()
    with np.errstate(all="ignore"):
        typed = np.array([value]).astype(out.dtype, casting="unsafe")[0] if value == value else 0
    if out.dtype.kind == "f" and value != value:
        typed = value
    kind = draw(st.sampled_from(["put", "fill", "reverse", "cut", "flat", "cast", "double"]))
    if kind == "put" and out.size:
        out.flat[draw(st.integers(0, out.size - 1))] = typed
    elif kind == "fill":
        out.fill(typed)
    elif kind == "reverse":
        out = out[::-1]
    elif kind == "cut":
        out = out[: draw(st.integers(0, 3))]
    elif kind == "flat":
        out = out.reshape(-1)
    elif kind == "cast":
        out = out.astype(draw(st.sampled_from(["f4", ">f8", "i4", "u8", "?", "i8"])))
    else:
        out = np.concatenate([out, out])
    return np.ascontiguousarray(out)


@settings(max_examples=examples(300))
@given(data=st.data(), place=st.deferred(lambda: st.sampled_from(paths())))
@pytest.mark.filterwarnings("ignore:invalid value encountered in cast")
def test_a_changed_field_is_refused_or_leaves_a_monitor_that_assesses(
    data: st.DataObject, place: tuple[str, str, tuple[str, ...]], flights: np.ndarray
) -> None:
    file, name, path = place
    arrays = sections_of(file)[name].arrays
    value = data.draw(hostile_arrays(arrays[path[0]]) if path[0] in arrays else HOSTILE)
    content = changed(sections_of(file), name, path, value)
    try:
        monitor = from_bytes(content, "m.fwm")
    except MonitorFileError:
        refusal(content)
    else:
        assert_assesses(monitor, flights[0])


def assert_assesses(monitor: Monitor, y: np.ndarray) -> None:
    """What any monitor can do, it does."""
    n = monitor.n_unsafe
    with np.errstate(all="ignore"):
        t = np.arange(len(y), dtype=np.float64) * monitor.dt
        found = monitor.assess(t, y, 0.5, withdraw=False)
        p = found.p_value[~np.isnan(found.p_value)]
        assert ((1 / (n + 1) <= p) & (p <= 1)).all()
        monitor.judge_and_withdraw(t, y, found)
        stream = monitor.stream(0.5)
        for moment, sample in zip(t[:12], y, strict=False):
            stream.update(moment, sample).as_dict()
    warnings_of(monitor.evaluation, 0.1)
    assert from_bytes(monitor.to_bytes(), "again").to_bytes() == monitor.to_bytes()


# --- archives ------------------------------------------------------------------------------------


def signed(body: bytes) -> bytes:
    return b"FOREWARN MONITOR 3\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def archive(members: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", kind) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return body.getvalue()


def npy(array: npt.NDArray[Any], allow_pickle: bool = False) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=allow_pickle)
    return file.getvalue()


@pytest.fixture
def memory() -> Iterator[Callable[[], int]]:
    """The most memory that was taken since [bytes]."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


def test_a_file_that_unpacks_to_much_more_is_refused_before_unpacking(
    memory: Callable[[], int],
) -> None:
    """Declared as it is; and declared small, which reads no more than is declared."""
    zeros = npy(np.zeros(2 * UNFOLDS_TO // 8))
    content = signed(archive({"monitor/alphas.npy": zeros, "sections.npy": npy(np.zeros(1))}))
    assert len(content) < UNFOLDS_TO / 100
    before = memory()
    assert "bytes unpack to" in refusal(content)
    assert memory() - before < UNFOLDS_TO / 4
    size = len(zeros).to_bytes(4, "little")
    lying = signed(content.split(b"\n", 2)[2].replace(size, (200).to_bytes(4, "little")))
    assert "holds no monitor" in refusal(lying)


def test_an_array_that_declares_more_than_it_has_is_refused(memory: Callable[[], int]) -> None:
    large = npy(np.zeros(9)).replace(b"(9,), }", b"(9000000000,), }")
    before = memory()
    assert "declared shape" in refusal(signed(archive({"a.npy": large})))
    assert memory() - before < UNFOLDS_TO / 4


@pytest.mark.parametrize("kind", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_another_compression_is_refused(kind: int) -> None:
    body = archive({"sections.npy": npy(np.zeros(1))}, kind)
    assert "unsupported compression" in refusal(signed(body))


@pytest.mark.parametrize(
    "text",
    [b"[" * 100_000, b"[" * 100 + b"]" * 100, b"[null]", b"1", b"{}", b'"', b"\xff", b"[{}]", b""],
    ids=lambda text: text[:8].decode("latin1") or "empty",
)
def test_sections_that_are_none_are_refused(text: bytes) -> None:
    members = {"sections.npy": npy(np.frombuffer(text, np.uint8))}
    refusal(signed(archive(members)))


@settings(max_examples=examples(100))
@given(data=st.data())
def test_an_archive_with_changed_bytes_is_refused_or_read(
    data: st.DataObject, dataset: Dataset
) -> None:
    body = bytearray(train(dataset).to_bytes().split(b"\n", 2)[2])
    places = st.one_of(
        st.integers(0, len(body) - 1),
        st.integers(0, 200),
        st.integers(len(body) - 900, len(body) - 1),
    )
    for place in data.draw(st.lists(places, min_size=1, max_size=3)):
        body[place] ^= data.draw(st.integers(1, 255))
    try:
        from_bytes(signed(bytes(body)), "m.fwm")
    except MonitorFileError:
        refusal(signed(bytes(body)))
