"""Chapter 10 with a set-up record: measurements by name, scaled, up to the scoring."""

import json
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.main import STATIC
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.proposal import propose
from app.telemetry.readers import ch10
from app.telemetry.readers.tmats import Place, SetupRecord
from app.telemetry.recording import TelemetryError
from core.channels import KEYS
from tests.support import ch10_flight
from tests.support.attas import TEST, fly
from tests.support.ch10_flight import LABELS, NAMES, OFFSETS, SCALES, UNITS
from tests.support.recorded_files import ch10_packet, read
from tests.support.repetition import examples

pytest.importorskip("chapter10")

BUS = "1553 channel 5 (NAV) from RT03 SA02"
ARINC = "429 channel 6 bus 2 label 325 source 1"


def values_of_flight() -> dict[str, np.ndarray]:
    """Two doublets, in UNITS."""
    y = np.concatenate(fly(2, 5).y)
    y = y[: len(y) // ch10_flight.PER_PACKET * ch10_flight.PER_PACKET]
    return {key: x if key == "Ny" else np.degrees(x) for key, x in zip(KEYS, y.T, strict=True)}


@pytest.fixture
def columns(tmp_path):
    """Changes of the set-up record, "" for none -> columns, and the values in UNITS."""

    def _columns(changes: dict[str, str] | None = None, setup: str | None = None) -> Any:
        text = ch10_flight.setup_record(changes=changes) if setup is None else setup
        content, exact, t = ch10_flight.recorded(values_of_flight(), TEST.dt, text)
        path = tmp_path / "flight.ch10"
        path.write_bytes(content)
        return read("ch10", path), exact, t

    return _columns


def test_measurements_are_proposed_with_scale_and_unit(columns):
    read_columns, exact, t = columns()
    proposal = propose(read_columns)
    assert proposal.missing == ()
    for key, name in NAMES.items():
        source = proposal.mapping.channels[key]
        assert (source.signal, source.sign) == (name, 1)
        assert source.scale == SCALES[key]
        assert proposal.rationales[key].confidence > 0.8, proposal.rationales[key]
        trace = apply_mapping(read_columns, proposal.mapping).channels[key]
        expected = exact[key] if key == "Ny" else np.radians(exact[key])
        np.testing.assert_allclose(trace.values, expected, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(trace.t, t, atol=1e-12)
        assert read_columns.signal(name).unit == UNITS[key]
        assert read_columns.signal(name).description == LABELS[key]
    assert "Measurements with names and scales by the set-up record: 7." in (
        read_columns.contents.notes
    )


def test_a_unit_that_is_not_known_is_never_sure(columns):
    read_columns, _, _ = columns({r"C-2\MN3:DEG/S;": r"C-2\MN3:FURLONGS;"})
    rationale = propose(read_columns).rationales["p"]
    assert rationale.confidence < 0.9
    assert any("'FURLONGS' in the file is not a known unit" in each for each in rationale.reasons)


def test_without_a_set_up_record_the_same_comes_from_bits_in_the_mapping(columns):
    read_columns, exact, _ = columns(setup="")
    bus = BUS.replace(" (NAV)", "")
    analog = "analog channel 8, 2 of 16 bits"
    places = {
        "beta": (f"{bus}/word 01", "1-16 signed"),
        "r": (f"{bus}/word 02", "2-16 signed"),
        "delta_a": (f"{bus}/word 03", "1-12 signed"),
        "p": (f"{ARINC}/word", "11-29 bnr"),
        "Ny": (f"{analog}/analog 2", ""),
    }
    units = {"p": "deg/s", "r": "deg/s", "Ny": "g"}
    mapping = Mapping(
        {
            key: ChannelSource(
                signal, units.get(key, "deg"), scale=SCALES[key],
                offset=OFFSETS.get(key, 0.0), bits=bits,
            )
            for key, (signal, bits) in places.items()
        },
        propose(read_columns).mapping.times,
    )  # fmt: skip
    traces = apply_mapping(read_columns, mapping)
    for key in places:
        expected = exact[key] if key == "Ny" else np.radians(exact[key])
        np.testing.assert_allclose(traces.channels[key].values, expected, atol=1e-15)


def test_the_example_of_the_guide_gives_its_values(columns):
    text = (STATIC / "guide" / "first-recording.md").read_text(encoding="utf-8")
    plain, example = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    assert Mapping.from_plain(json.loads(plain)).channels["Ny"].bits == "5-16 signed"
    read_columns, exact, _ = columns()
    traces = apply_mapping(read_columns, Mapping.from_plain(json.loads(example)))
    assert {*traces.channels} == {"delta_a", "p"}
    for key, trace in traces.channels.items():
        np.testing.assert_allclose(trace.values, np.radians(exact[key]), atol=1e-15)


@pytest.mark.parametrize(
    ("signal", "bits", "message"),
    [
        (f"{BUS}/word 01", "5-20 signed", "its words have bits 1 to 16"),
        (f"{BUS}/word 01", "1-16 bnr", "ends in /word"),
        (f"{ARINC}/data", "1-19 bnr", "ends in /word"),
        ("1553 channel 5 (NAV) from RT03 SA03/word 01", "", f"choose one of .*{BUS[:20]}"),
        (f"{ARINC[:-1]}0/word", "11-29 bnr", "not in the file: choose one of 429 channel 6 bus 2"),
    ],
)
def test_words_and_bits_that_the_file_lacks_are_refused(columns, signal, bits, message):
    read_columns, _, _ = columns()
    times = propose(read_columns).mapping.times
    source = ChannelSource(signal, "deg", bits=bits)
    with pytest.raises(TelemetryError, match=message.replace("(", r"\(").replace(")", r"\)")):
        apply_mapping(read_columns, Mapping({"beta": source}, times))


NOT_LINEAR = r"C-1\CO\N:2;C-1\CO-2:1e-9;"


@pytest.mark.parametrize(
    "changes",
    [
        {r"C-1\CO\N:1;": NOT_LINEAR},
        {r"C-1\CO\N:1;": r"C-1\CO\N:3;"},
        {r"C-1\DCT:COE": r"C-1\DCT:DER"},
        {f"C-1\\CO-1:{SCALES['beta']!r}": r"C-1\CO-1:0"},
        {f"C-1\\CO-1:{SCALES['beta']!r}": r"C-1\CO-1:much"},
    ],
)
def test_a_conversion_that_is_not_a_scale_leaves_raw_counts(columns, changes):
    read_columns, exact, _ = columns(changes)
    assert read_columns.signal("BETA").unit == "counts"
    proposal = propose(read_columns)
    assert proposal.missing == ("beta",)
    assert "its unit counts does not fit" in proposal.rationales["beta"].reasons[0]
    source = ChannelSource("BETA", "deg", scale=SCALES["beta"])
    mapping = Mapping({"beta": source}, proposal.mapping.times)
    traces = apply_mapping(read_columns, mapping)
    np.testing.assert_allclose(traces.channels["beta"].values, np.radians(exact["beta"]))
    assert find_warnings(read_columns, mapping, traces) == {}
    note = "Set-up record: its conversion is no straight line, so these are raw counts: BETA."
    assert note in read_columns.contents.notes
    counts = ch10_flight.counts_of(exact)["beta"]
    np.testing.assert_array_equal(read_columns.values("BETA"), counts)


@pytest.mark.parametrize(
    ("changes", "note"),
    [
        ({r"C-1\BFM:TWO": r"C-1\BFM:FPT"}, "its binary format is FPT"),
        ({r"C-1\BFM:TWO;": ""}, "its binary format is missing"),
        ({r"B-1\MBM-1-1-1-1:FW": r"B-1\MBM-1-1-1-1:0110"}, "its words and masks are not underst"),
        ({r"B-1\MTO-1-1-1-1:MSB": r"B-1\MTO-1-1-1-1:LSB"}, "its words and masks are not unders"),
        ({r"B-1\DLN:BUS A": r"B-1\DLN:BUS B"}, "no channel of the recorder has its data link"),
        ({r"B-1\STA-1-1:00010": r"B-1\STA-1-1:XXXXX"}, "its message is not one of 1553 or ARINC"),
        ({r"B-1\STA-1-1:00010": r"B-1\STA-1-1:00011"}, "its words were not recorded"),
    ],
)
def test_a_measurement_without_a_place_is_named_with_the_reason(columns, changes, note):
    read_columns, _, _ = columns(changes)
    assert "BETA" not in [signal.name for signal in read_columns.contents.signals]
    (text,) = [text for text in read_columns.contents.notes if note in text]
    assert "BETA" in text
    assert f"{BUS}/word 01" in [signal.name for signal in read_columns.contents.signals]


def test_too_many_signals_leave_the_measurements(columns, monkeypatch):
    monkeypatch.setattr(ch10, "MOST_SIGNALS", 15)
    read_columns, exact, _ = columns()
    names = [signal.name for signal in read_columns.contents.signals]
    assert {name for name in names if "/time" not in name} == {*NAMES.values(), "SPARE"}
    for key, name in NAMES.items():
        np.testing.assert_allclose(read_columns.values(name), exact[key], atol=1e-12)
    assert read_columns.contents.ignored[0].startswith("groups without raw words")


def test_pair_sets_on_a_line_are_a_scale(columns):
    scale = SCALES["beta"]
    pairs = "".join(
        rf"C-1\PS3-{n}:{x};C-1\PS4-{n}:{scale * x!r};" for n, x in enumerate((-9, 0, 4), 1)
    )
    read_columns, exact, _ = columns({r"C-1\DCT:COE;": rf"C-1\DCT:PRS;C-1\PS\N:3;{pairs}"})
    np.testing.assert_allclose(read_columns.values("BETA"), exact["beta"], atol=1e-12)


@pytest.mark.parametrize("mask", ["", r"R-1\AMSK-3-2:1111111111111111;"])
def test_offset_binary_counts_from_the_middle_of_a_known_width(columns, mask):
    changes = {r"C-4\BFM:UNS": r"C-4\BFM:OFF", r"R-1\AMCN-3-2:2;": rf"R-1\AMCN-3-2:2;{mask}"}
    read_columns, exact, _ = columns(changes)
    if mask:
        half = 2**15 * SCALES["Ny"]
        np.testing.assert_allclose(read_columns.values("NY"), exact["Ny"] - half, atol=1e-12)
    else:
        assert any("OFF of unknown width: NY" in note for note in read_columns.contents.notes)


@pytest.mark.parametrize(("status", "kind", "expected"), [
    (0, "TWO", np.nan), (1, "TWO", np.nan), (2, "TWO", np.nan), (3, "TWO", -7),
    (0, "UNS", 2**19 - 7), (1, "UNS", np.nan), (2, "UNS", np.nan), (3, "UNS", 2**19 - 7),
])  # fmt: skip
def test_words_of_arinc_429_without_data_are_missing(tmp_path, status, kind, expected):
    setup = ch10_flight.setup_record(changes={r"C-2\BFM:TWO": rf"C-2\BFM:{kind}"})
    packets = ch10_packet(1, 0, 0, bytes(4) + setup.encode())
    label = int(f"{0o325:08b}"[::-1], 2)
    for k in range(3):
        word = label | (-7 & 0x7FFFF) << 10 | status << 29
        body = np.array([1, 2 << 24, word], "<u4").tobytes()
        packets += ch10_packet(0x38, ch10_flight.ARINC, 1000 + 200_000 * k, body)
    path = tmp_path / "words.ch10"
    path.write_bytes(packets)
    rate = read("ch10", path).values("ROLL_RATE")
    np.testing.assert_array_equal(rate, [expected * SCALES["p"]] * 3)


def test_a_set_up_record_in_xml_is_named(tmp_path):
    packets = ch10_packet(1, 0, 0, (1 << 9).to_bytes(4, "little") + b"<Tmats/>")
    packets += ch10_flight.recorded(values_of_flight(), TEST.dt, "")[0]
    path = tmp_path / "xml.ch10"
    path.write_bytes(packets)
    assert "The set-up record is in XML, which is not read." in read("ch10", path).contents.notes


def test_a_set_up_record_may_be_cut_anywhere_into_packets():
    text = ch10_flight.setup_record().encode()
    whole, parts = SetupRecord(), SetupRecord()
    whole.add(text)
    for at in range(0, len(text), 97):
        parts.add(text[at : at + 97])
    assert parts.groups == whole.groups
    assert not parts.is_changed
    parts.add(text + b"C-1\\CO-1:0.5;C-2\\CO-1:0.1")
    assert parts.is_changed
    assert parts.groups["C", 1]["CO"][1,] == "0.5"
    assert parts.groups["C", 2]["CO"][1,] == repr(SCALES["p"]), "which has no end yet"


VALUES = ["", "0", "-1", "9" * 12, "1e999", "nan", "FW", "0" * 16, "1" * 60, "XXXXX", "COE", "x:y;"]


@settings(max_examples=examples(150))
@given(st.data())
def test_any_set_up_record_is_read(data):
    lines = ch10_flight.setup_record().replace("\n", "").split(";")
    for _ in range(data.draw(st.integers(1, 6))):
        k = data.draw(st.integers(0, len(lines) - 1))
        code, _, value = lines[k].partition(":")
        code = data.draw(st.sampled_from([code, code.replace("-1", ""), code + "-3", code[:5]]))
        value = data.draw(st.sampled_from([value, *VALUES]) | st.text(max_size=8))
        lines[k] = f"{code}:{value}"
    record = SetupRecord()
    record.add(";".join([*lines, ""]).encode())
    record.channel_names()
    words = np.array([[3.0, -7.0, np.nan, 2.0**30], [0.0, 1.0, 2.0, 3.0]])
    places = [
        Place("1553", 5, (3, 1, 2)), Place("429", 6, (0o325, 1, 2)), Place("analog", 8),
    ]  # fmt: skip
    with np.errstate(over="ignore", invalid="ignore"):
        for measurements in record.recorded(places).values():
            for measurement in measurements:
                assert measurement.scaling.problem() == ""
                assert measurement.counts(words, 16).shape == (2,)
    assert all(
        text.lower().startswith(("set-up record: ", "the set-up")) for text in record.notes()
    )
