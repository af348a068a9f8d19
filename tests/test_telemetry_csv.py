from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.telemetry.channel_names import NEEDED, SPELLINGS
from app.telemetry.csv_reader import FORMATS, read
from app.telemetry.recording import TelemetryError, subtract_trim
from core.channels import KEYS

RECORDS = Path(__file__).parents[1] / ".." / "shared" / "data"
HEADER = "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"
ROW = "{t},0.1,0.2,0.3,0.4,0.5,0.6"
TWO_ROWS = f"{ROW.format(t=0)}\n{ROW.format(t=0.05)}\n"
GOOD = f"{HEADER}\n{TWO_ROWS}"


@pytest.fixture
def write(tmp_path):
    """Content -> path of a file that holds it."""

    def _write(content, name="record.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return _write


def flown(name):
    path = RECORDS / name
    if not path.exists():
        pytest.skip(f"the flight records are not in {RECORDS}")
    return path


@pytest.mark.parametrize(
    ("name", "peak"), [("attas_rud1.csv", 0.212248), ("attas_ail1.csv", 0.165493)]
)
def test_flight_record_has_its_documented_length_rate_and_peak(name, peak):
    record = read(flown(name))
    assert record.y.shape == (751, 6)
    assert record.y.flags.c_contiguous
    np.testing.assert_allclose(np.diff(record.t), 0.04, rtol=1e-9)
    assert np.abs(record.y[:, KEYS.index("Ny")]).max() == peak
    assert set(record.attitude) == {"phi", "theta"}
    assert record.columns["Ny"] == "ay_g"
    assert record.notes == ()


def test_flight_record_equals_what_numpy_reads():
    path = flown("attas_rud1.csv")
    table = np.genfromtxt(path, delimiter=",", names=True)
    names = ["beta_rad", "p_radps", "r_radps", "ay_g", "da_rad", "dr_rad"]
    np.testing.assert_array_equal(read(path).y, np.column_stack([table[n] for n in names]))


@pytest.mark.parametrize(
    "name", ["citation_20190312_dutchroll.csv", "citation_20190312_dutchroll_yd.csv"]
)
def test_flight_record_without_sideslip_is_refused_by_channel_and_column(name):
    with pytest.raises(TelemetryError, match=r"no number in beta \(column beta_rad\)"):
        read(flown(name))


def test_channels_come_in_their_order_whatever_the_columns_order(write):
    columns = ["dr_rad", "extra", "ay_g", "t_s", "r_radps", "da_rad", "p_radps", "beta_rad"]
    rows = "6,text,4,0,3,5,2,1\n6,,4,1,3,5,2,1\n"
    record = read(write(f"{','.join(columns)}\n{rows}"))
    np.testing.assert_array_equal(record.y, [[1, 2, 3, 4, 5, 6]] * 2)
    np.testing.assert_array_equal(record.t, [0, 1])


@pytest.mark.parametrize("key", NEEDED)
def test_every_accepted_spelling_is_read_in_its_unit(key, write):
    si = {
        "": 2.0, "s": 2.0, "ms": 0.002, "rad": 2.0, "deg": np.deg2rad(2), "radps": 2.0,
        "rad_s": 2.0, "degps": np.deg2rad(2), "deg_s": np.deg2rad(2), "g": 2.0,
        "mps2": 2 / 9.80665, "m_s2": 2 / 9.80665,
    }  # fmt: skip
    plain = dict(zip(NEEDED, HEADER.split(","), strict=True))
    for name, (unit, _) in SPELLINGS[key].items():
        for spelling in (name, name.upper(), f" {name} "):
            header = ",".join(spelling if k == key else plain[k] for k in NEEDED)
            record = read(write(f"{header}\n1,2,2,2,2,2,2\n2,2,2,2,2,2,2\n"))
            value = record.t[1] if key == "t" else record.y[1, KEYS.index(key)]
            assert value == pytest.approx(si[unit], rel=1e-15)
            assert record.columns[key] == spelling.strip()


def test_the_contracts_own_keys_are_read_as_si_and_said_so(write):
    record = read(write(f"t,{','.join(KEYS)}\n{TWO_ROWS}"))
    np.testing.assert_array_equal(record.y, read(write(GOOD)).y)
    assert "beta, p, r, Ny, delta_a, delta_r" in record.notes[0]


@settings(deadline=None)
@given(
    st.lists(
        st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6),
        min_size=2,
        max_size=5,
    )
)
def test_degrees_and_radians_give_the_same_recording(tmp_path_factory, y):
    y = np.array(y)
    degrees = np.where(np.array(KEYS) == "Ny", y * 9.80665, np.rad2deg(y))
    path = tmp_path_factory.mktemp("units") / "record.csv"
    records = []
    for header, table, ms in (
        (HEADER, y, 1),
        ("t_ms,beta_deg,p_degps,r_deg_s,ay_mps2,delta_a_deg,dr_deg", degrees, 1000),
    ):
        rows = [f"{k * ms},{','.join(map(repr, map(float, row)))}" for k, row in enumerate(table)]
        path.write_text("\n".join([header, *rows]))
        records.append(read(path))
    np.testing.assert_array_equal(records[0].t, records[1].t)
    np.testing.assert_array_equal(records[0].y, y)
    np.testing.assert_allclose(records[1].y, y, rtol=1e-14, atol=1e-300)


DIALECTS = {
    "semicolon": GOOD.replace(",", ";"),
    "tab": GOOD.replace(",", "\t"),
    "spaces": GOOD.replace(",", ", "),
    "crlf": GOOD.replace("\n", "\r\n"),
    "cr": GOOD.replace("\n", "\r"),
    "byte order mark": "\ufeff" + GOOD,
    "blank lines": "\n  \n" + GOOD.replace("\n", "\n\n"),
    "no final newline": GOOD.rstrip("\n"),
    "quotes": GOOD.replace("t_s,beta_rad", '"t_s","beta_rad"').replace("0.1", '"0.1"'),
    "trailing comma": GOOD.replace("\n", ",\n"),
    "exponent": GOOD.replace("0.1", "+1e-1"),
}


@pytest.mark.parametrize("content", DIALECTS.values(), ids=DIALECTS)
def test_dialects_of_one_table_give_one_recording(content, write):
    record, plain = read(write(content)), read(write(GOOD))
    np.testing.assert_array_equal(record.y, plain.y)
    np.testing.assert_array_equal(record.t, plain.t)


@pytest.mark.parametrize("cell", ["", "  ", "nan", "NaN", "inf", "-inf", "1e999"])
def test_a_missing_value_stays_missing_and_is_counted(cell, write):
    record = read(write(GOOD.replace("0.2", cell, 1)))
    np.testing.assert_array_equal(np.isnan(record.y), [[0, 1, 0, 0, 0, 0], [0] * 6])
    assert record.notes == ("p is missing in 1 of 2 samples.",)


def test_an_empty_attitude_column_is_no_attitude(write):
    rows = "\n".join(f"{ROW.format(t=k)},,{k}" for k in (0, 90))
    record = read(write(f"{HEADER},phi_rad,psi_deg\n{rows}\n"))
    assert set(record.attitude) == {"psi"}
    np.testing.assert_allclose(record.attitude["psi"], [0, np.pi / 2])
    assert "phi" not in record.columns


def test_a_column_that_only_resembles_a_channel_is_ignored(write):
    with_more = GOOD.replace(HEADER, HEADER + ",p_static_pa,beta_dot_radps,t_oat_degc,ay")
    record = read(write(with_more.replace("0.6\n", "0.6,x,y,z,\n")))
    np.testing.assert_array_equal(record.y, read(write(GOOD)).y)


BAD_CONTENT = {
    "nothing": ("", "file is empty"),
    "blank lines": ("\n \n\n", "file is empty"),
    "empty quotes": ('""\n', "no column for t, beta"),
    "header only": (HEADER, "samples below the header: 0"),
    "one row": (f"{HEADER}\n{ROW.format(t=0)}\n", "samples below the header: 1"),
    "no header": (TWO_ROWS, "first line holds numbers"),
    "zero bytes": (b"\x89PNG\r\n\x00\x00", "byte 6 is zero"),
    "utf-16": (GOOD.encode("utf-16"), "zero"),
    "latin-1": (GOOD.encode() + "°".encode("latin-1"), "not UTF-8"),
    "control characters": ("\x01\x02\x1b[31m,\x7f\n1,2\n", "first line is not text"),
    "open quote": (GOOD + '0.1,"0.1', "line 4: unexpected end of data"),
    "text after a quote": (GOOD.replace("0.3", '"0.3"3', 1), "line 2: ',' expected after"),
    "short row": (GOOD + "0.1,0.2\n", "line 4 has 2 cells where the header has 7"),
    "long row": (GOOD + ROW.format(t=0.1) + ",7\n", "line 4 has 8 cells where the header has 7"),
    "short row after a blank line": (GOOD + "\n0.1,0.2\n", "line 5 has 2 cells"),
    "text": (GOOD.replace("0.2", "n/a"), "line 2, column p_radps: 'n/a' is not a number"),
    "decimal comma": (
        GOOD.replace(",", ";").replace("0.2", "0,2"),
        "line 2, column p_radps: '0,2' is not a number; write numbers with a decimal point",
    ),
    "digit groups": (GOOD.replace("0.2", "1_0"), "line 2, column p_radps: '1_0' is not a number"),
    "unit line": (GOOD.replace("\n", "\ns,-,-,-,-,-,-\n", 1), "line 2, column t_s: 's'"),
    "repeated time": (GOOD + ROW.format(t=0.05), "line 4, column t_s: time 0.05 is repeated"),
    "time steps back": (GOOD + ROW.format(t=-1), "line 4, column t_s: time steps back from 0.05"),
    "no time": (GOOD + ROW.format(t=""), "line 4, column t_s: time is missing"),
    "nan time": (GOOD + ROW.format(t="nan"), "line 4, column t_s: time is missing"),
    "endless time": (GOOD + ROW.format(t="inf"), "line 4, column t_s: time is missing"),
    "time before time": (f"{HEADER}\n{ROW.format(t='-inf')}", "line 2, column t_s: time is miss"),
    "same channel twice": (
        GOOD.replace("da_rad", "beta_deg"),
        r"beta has 2 columns \(beta_rad, beta_deg\)",
    ),
    "same name twice": (GOOD.replace("ay_g", "p_radps"), "p has 2 columns"),
    "two names for one channel": (GOOD.replace("da_rad", "Ny"), r"Ny has 2 columns \(ay_g, Ny\)"),
    "unknown unit": (GOOD.replace("p_radps", "p_rpm"), "p_rpm does not end in a known unit of p"),
    "no unit": (GOOD.replace("ay_g", "ay"), "ay does not end in a known unit of Ny"),
    "empty channels": (
        GOOD.replace("0.1", "").replace("0.5", "nan"),
        r"no number in beta \(column beta_rad\), delta_a \(column da_rad\)",
    ),
}


@pytest.mark.parametrize(("content", "message"), BAD_CONTENT.values(), ids=BAD_CONTENT)
def test_an_unusable_file_is_refused_in_one_line_that_names_it(content, message, write):
    path = write(content)
    with pytest.raises(TelemetryError, match=message) as refusal:
        read(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert str(refusal.value).replace(str(path), "").isprintable()
    assert "; " in str(refusal.value)


def test_missing_channels_are_named_together_with_what_is_there_and_what_is_accepted(write):
    with pytest.raises(TelemetryError) as refusal:
        read(write(GOOD.replace("beta_rad", "aos").replace("dr_rad", "rudder")))
    message = str(refusal.value)
    assert "no column for beta, delta_r;" in message
    assert "the columns found are t_s, aos, p_radps, r_radps, ay_g, da_rad, rudder;" in message
    for name in [*SPELLINGS["beta"], *SPELLINGS["delta_r"]]:
        assert name in message
    assert "p_degps" not in message


def test_a_path_that_is_no_file_is_refused(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    for name, message in [
        ("absent.csv", "does not exist"),
        ("folder.csv", "is a directory"),
        ("absent", "does not exist"),
    ]:
        with pytest.raises(TelemetryError, match=message):
            read(tmp_path / name)


@pytest.mark.parametrize("name", ["record.mat", "record", "record.csv.gz"])
def test_an_unknown_ending_is_refused_with_the_known_ones(name, write):
    with pytest.raises(TelemetryError, match="export the recording as one of: csv, tsv"):
        read(write(GOOD, name))


@pytest.mark.parametrize("ending", FORMATS)
def test_the_ending_is_read_in_any_case(ending, write):
    assert read(write(GOOD, f"record.{ending.upper()}")).y.shape == (2, 6)


@settings(deadline=None)
@given(st.binary(max_size=200), st.booleans())
def test_noise_is_refused_as_telemetry_and_nothing_else(tmp_path_factory, noise, after_header):
    path = tmp_path_factory.mktemp("noise") / "noise.csv"
    path.write_bytes(GOOD.encode() + noise if after_header else noise)
    try:
        record = read(path)
    except TelemetryError:
        return
    assert after_header
    assert (np.diff(record.t) > 0).all()


def test_trim_is_the_mean_of_the_first_stretch(write):
    rows = [f"{k},{k},{k},{k},{k if k else ''},{k},{k},{k}" for k in range(6)]
    record = read(write("\n".join([HEADER + ",phi_rad", *rows])))
    perturbation = subtract_trim(record, 3.0)
    expected = np.arange(6.0)[:, None] - [1, 1, 1, 1.5, 1, 1]
    expected[0, KEYS.index("Ny")] = np.nan
    np.testing.assert_array_equal(perturbation.y, expected)
    np.testing.assert_array_equal(perturbation.attitude["phi"], np.arange(6.0))
    assert "Ny 1.5 g" in perturbation.notes[-1]
    assert perturbation.notes[:-1] == record.notes


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), 0.06])
def test_a_trim_stretch_outside_the_recording_is_refused(seconds, write):
    with pytest.raises(TelemetryError, match=r"recording of 0\.05 s"):
        subtract_trim(read(write(GOOD)), seconds)


def test_trim_of_a_channel_silent_at_first_is_refused(write):
    record = read(write(GOOD.replace("0.2", "", 1)))
    with pytest.raises(TelemetryError, match=r"p has no finite sample in the first 0\.04 s"):
        subtract_trim(record, 0.04)
