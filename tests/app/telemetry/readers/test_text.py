"""Text tables in every dialect give the same numbers, and bad rows with line numbers."""

import io

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from app.telemetry.contents import ColumnWriter, open_columns
from app.telemetry.readers import text as reader
from app.telemetry.readers.text import read
from app.telemetry.recording import TelemetryError
from tests.support.places import RECORDS
from tests.support.repetition import examples

HEADER = "t_s,beta_rad,p_radps,r_radps,ay_g,da_rad,dr_rad"
NAMES = HEADER.split(",")
N = 12
TABLE = np.column_stack([np.arange(N) / 20, *(np.arange(N) / 8 + k / 16 - 1 for k in range(6))])
ROWS = [",".join(map(repr, map(float, row))) for row in TABLE]
GOOD = "\n".join([HEADER, *ROWS, ""])


@pytest.fixture
def pour(tmp_path):
    """Content of a file -> its columns."""

    def _pour(content, bad_share=0.01, most_bytes=2**30):
        path, folder = tmp_path / "record.csv", tmp_path / f"columns{len(list(tmp_path.iterdir()))}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        folder.mkdir()
        read(path, ColumnWriter(folder, most_bytes, bad_share))
        return open_columns(folder)

    return _pour


def table(columns):
    return np.column_stack([columns.values(signal.name) for signal in columns.contents.signals])


def names(columns):
    return [signal.name for signal in columns.contents.signals]


def units(columns):
    return [signal.unit for signal in columns.contents.signals]


@pytest.mark.parametrize(
    "name",
    [
        "attas_rud1.csv",
        "attas_ail1.csv",
        "citation_20190312_dutchroll.csv",
        "citation_20190312_dutchroll_yd.csv",
    ],
)
def test_flight_record_equals_what_numpy_reads(name, pour):
    path = RECORDS / name
    if not path.exists():
        pytest.skip(f"the flight records are not in {RECORDS}")
    columns = pour(path.read_bytes())
    expected = np.genfromtxt(path, delimiter=",", names=True)
    assert names(columns) == [*(expected.dtype.names or ())]
    np.testing.assert_array_equal(table(columns), np.array(expected.tolist()))
    assert columns.contents.bad_rows == columns.contents.notes == columns.contents.ignored == ()


def spread(text):
    return "\n".join(line.replace(",", "   ") for line in text.split("\n"))


DIALECTS = {
    "comma": GOOD,
    "semicolon": GOOD.replace(",", ";"),
    "tab": GOOD.replace(",", "\t"),
    "bar": GOOD.replace(",", "|"),
    "blanks": GOOD.replace(",", " "),
    "runs of blanks": spread(GOOD).replace("\n", "  \n   "),
    "blanks and tabs": GOOD.replace(",", " \t "),
    "comma and blank": GOOD.replace(",", ", "),
    "blanks before a bar": GOOD.replace(",", "  | "),
    "decimal comma": GOOD.replace(",", ";").replace(".", ","),
    "decimal comma and tab": GOOD.replace(",", "\t").replace(".", ","),
    "decimal comma and blanks": GOOD.replace(",", "  ").replace(".", ","),
    "decimal comma in quotes": "\n".join(
        ['"' + '","'.join(line.replace(".", ";").split(",")).replace(";", ",") + '"'
         for line in GOOD.splitlines()]
    ),
    "crlf": GOOD.replace("\n", "\r\n"),
    "cr": GOOD.replace("\n", "\r"),
    "mixed line ends": GOOD.replace("\n", "\r\n", 4).replace("\n0.3", "\r0.3"),
    "byte order mark": "\ufeff" + GOOD,
    "utf-16": GOOD.encode("utf-16"),
    "utf-16 big": "\ufeff".encode("utf-16-be") + GOOD.encode("utf-16-be"),
    "utf-16 without a mark": GOOD.encode("utf-16-le"),
    "blank lines": "\n  \n" + GOOD.replace("\n", "\n\n").replace("\n0.2", "\n   \n0.2"),
    "no final newline": GOOD.rstrip("\n"),
    "quoted names": '"' + HEADER.replace(",", '","') + '"\n' + "\n".join(ROWS),
    "quotes everywhere": "\n".join(
        '"' + line.replace(",", '","') + '"' for line in GOOD.splitlines()
    ),
    "delimiter at the end": GOOD.replace("\n", ",\n"),
    "delimiter at the end of rows": HEADER + "\n" + "\n".join(f"{row}," for row in ROWS),
    "plus signs and exponents": "\n".join(
        [HEADER, *(",".join(f"{x:+.17e}" for x in row) for row in TABLE)]
    ),
    "exponents of Fortran": spread(
        "\n".join([HEADER, *(",".join(f"{x: .17E}".replace("E", "D") for x in row)
                             for row in TABLE)])
    ),
    "preamble": "Flight 12, PH-LAB\n\nDate: 2026-03-01; 12:00\nRate,20,Hz\n\n" + GOOD,
    "long preamble": "".join(f"key {k}: {'word ' * (k % 7)}{k}\n" for k in range(50)) + GOOD,
    "comments": "# made by a recorder\n// of 2026\n% (c)\n! 1, 2, 3\n; more\n" + GOOD,
    "commented header": "# made by a recorder\n# " + GOOD,
    "commented header of MATLAB": "%" + GOOD,
    "numpy.savetxt with a header": "# " + HEADER.replace(",", ", ") + "\n" + "\n".join(
        row.replace(",", " ") for row in ROWS
    ),
    "comments among the rows": GOOD.replace("\n0.2", "\n# the second run\n0.2") + "# end\n",
    "sep of Excel": "sep=;\n" + GOOD.replace(",", ";"),
    "end of file of DOS": GOOD + "\x1a",
}  # fmt: skip


@pytest.mark.parametrize("content", DIALECTS.values(), ids=DIALECTS)
def test_dialects_of_one_table_give_the_same_columns(content, pour):
    columns = pour(content)
    assert names(columns) == NAMES
    np.testing.assert_array_equal(table(columns), TABLE)
    assert columns.contents.n_bad_rows == 0
    assert columns.contents.ignored == ()


@pytest.mark.parametrize("bytes_a_block", [1000, 1777])
@pytest.mark.parametrize("dialect", [name for name in DIALECTS if "preamble" not in name])
def test_blocks_do_not_show(dialect, bytes_a_block, pour, monkeypatch):
    monkeypatch.setattr(reader, "BLOCK_SIZE", bytes_a_block)
    np.testing.assert_array_equal(table(pour(DIALECTS[dialect])), TABLE)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@given(st.lists(st.text("ab,\u00e9", max_size=9), min_size=1), st.integers(25, 60))
def test_blocks_are_the_files_lines_and_know_their_numbers(end, lines, size):
    file = io.BytesIO(end.join(lines).encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "BLOCK_SIZE", size)
        numbered = list(reader.blocks(file))
        for line, block in numbered:
            at = [*reader.pieces(line, block, 5)]
            assert b"".join(piece for _, piece in at) == block
            assert all(
                lines[n - 1 : n + piece.count(b"\n") - 1] == piece.decode().split("\n")[:-1]
                for n, piece in at
            )
    whole = b"".join(block for _, block in numbered).decode().split("\n")[:-1]
    assert whole == (lines if lines[-1] else lines[:-1])


def test_a_line_without_end_is_refused(pour, monkeypatch):
    monkeypatch.setattr(reader, "BLOCK_SIZE", 1000)
    with pytest.raises(TelemetryError, match="line 14 is longer than"):
        pour(GOOD + "1," * 2000)


UNITS = {
    "row": "t,beta,p\ns,deg,deg/s\n",
    "row in brackets": "t,beta,p\n[s],[deg],[deg/s]\n",
    "row in parentheses": "t,beta,p\n(s),(deg),(deg/s)\n",
    "row in comments": "# t,beta,p\n# s,deg,deg/s\n",
    "row below names of groups": "Clock,Air data,Inertial\nt,beta,p\ns,deg,deg/s\n",
    "in names": "t [s],beta (deg),p{deg/s}\n",
}


@pytest.mark.parametrize("header", UNITS.values(), ids=UNITS)
def test_units_are_read_from_names_cells_and_brackets(header, pour):
    columns = pour(header + "0,1,2\n1,2,3\n2,3,4\n")
    assert units(columns) == ["s", "deg", "deg/s"]
    assert [name.split()[0].partition("{")[0] for name in names(columns)] == ["t", "beta", "p"]
    np.testing.assert_array_equal(table(columns)[0], [0, 1, 2])


@pytest.mark.parametrize("row", ["s;Grad;Grad/s", "Sek;Grad;Grad/s", "s;°;°/s", "Sek;Grad;-"])
def test_a_row_of_units_in_german_is_no_row_of_names(row, pour):
    columns = pour(f"Zeit;Schiebewinkel;p\n{row}\n0,5;1,5;2,5\n1,5;2,5;3,5\n")
    assert names(columns) == ["Zeit", "Schiebewinkel", "p"]
    assert units(columns) == [unit.strip("-") for unit in row.split(";")]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("beta [deg]", "deg"), ("p (deg/s)", "deg/s"), ("V [m/s]", "m/s"), ("a (m/s^2)", "m/s^2"),
        ("a (m/s²)", "m/s²"), ("T (°C)", "°C"), ("h (ft)", "ft"), ("w (rad s-1)", "rad s-1"),
        ("Ny [g]", "g"), ("x [odd unit]", "odd unit"), ("beta_deg", ""), ("beta (filtered)", ""),
        ("gyro[0]", ""), ("M [-]", ""), ("M (-)", ""), ("x []", ""), ("(deg)", ""), ("n (1)", ""),
    ],
)  # fmt: skip
def test_a_unit_in_a_name_is_recognised_and_the_name_stays(name, unit, pour):
    columns = pour(f"t,{name}\n0,1\n1,2\n")
    assert names(columns) == ["t", name]
    assert units(columns) == ["", unit]


def test_names_that_could_be_units_are_names(pour):
    columns = pour("t,V,h,psi,g\n0,1,2,3,4\n1,2,3,4,5\n")
    assert names(columns) == ["t", "V", "h", "psi", "g"]


def test_names_in_an_8_bit_code_are_read(pour):
    columns = pour("t [s];Schiebewinkel β".replace("β", "ß [°]").encode("latin-1") + b"\n0;1\n1;2")
    assert columns.contents.signals[1].name == "Schiebewinkel ß [°]"
    assert columns.contents.signals[1].unit == "°"


def test_a_repeated_name_is_numbered_with_a_note(pour):
    columns = pour("t,beta,beta\n0,1,2\n1,2,3\n")
    assert names(columns) == ["t", "beta", "beta (2)"]
    assert "beta" in columns.contents.notes[0]


def test_a_column_without_a_name_is_called_by_its_number(pour):
    assert names(pour(",t,,beta\n7,0,1,2\n8,1,2,3\n")) == ["column_1", "t", "column_3", "beta"]


@pytest.mark.parametrize("first", ["", "two words\n", "# a comment, and more\n"])
def test_columns_without_names_are_numbered_with_a_note(first, pour):
    columns = pour(first + "\n".join(ROWS))
    assert names(columns) == [f"column_{k}" for k in range(1, 8)]
    np.testing.assert_array_equal(table(columns), TABLE)
    assert "No line of names" in columns.contents.notes[0]


def test_names_with_blanks_are_split_at_several_blanks(pour):
    columns = pour("Time (s)   Sideslip (deg)\n0   1\n1   2\n")
    assert names(columns) == ["Time (s)", "Sideslip (deg)"]
    assert units(columns) == ["s", "deg"]


@pytest.mark.parametrize("header", [HEADER + "\n", "# " + HEADER + "\n", ""])
@pytest.mark.parametrize("first", ["0,1,2", "0,1,2,3,4,5,6,7", "0,1,2,x,4,5,6"])
def test_a_bad_first_row_is_a_bad_row_and_hides_no_names(header, first, pour):
    columns = pour("\n".join([header + first, *ROWS]))
    assert names(columns) == (NAMES if header else [f"column_{k}" for k in range(1, 8)])
    assert [row.line for row in columns.contents.bad_rows] == [2 if header else 1]
    np.testing.assert_array_equal(table(columns), TABLE)


def test_names_that_do_not_fit_the_rows_are_not_used_for_columns(pour):
    columns = pour("t,beta,p\n0,1,2,3\n1,2,3,4\n2,3,4,5\n")
    assert names(columns) == [f"column_{k}" for k in range(1, 5)]


@pytest.mark.parametrize(
    "cell",
    ["", "  ", "nan", "NaN", " NaN ", "inf", "-inf", "Infinity", "1e999", "NA", "n/a", "null", "-",
     "#N/A", "1.#QNAN", "*****"],
)  # fmt: skip
def test_a_missing_value_stays_missing_and_its_row_stays(cell, pour):
    rows = [row.split(",") for row in ROWS]
    rows[3][2] = cell
    columns = pour("\n".join([HEADER, *map(",".join, rows)]))
    expected = TABLE.copy()
    expected[3, 2] = np.nan
    np.testing.assert_array_equal(table(columns), expected)
    assert columns.contents.n_bad_rows == 0


def test_a_column_of_text_is_ignored_with_its_name_and_reason(pour):
    rows = [f"{row},{'AP OFF' if k % 2 else 'AP ON'},3" for k, row in enumerate(ROWS)]
    columns = pour("\n".join([HEADER + ",mode,n", *rows]))
    assert names(columns) == [*NAMES, "n"]
    assert columns.contents.ignored == ("mode: text such as 'AP ON'",)


def test_a_column_that_is_empty_stays_as_missing(pour):
    columns = pour("t,beta\n0,\n1,\n2,\n")
    assert names(columns) == ["t", "beta"]
    assert np.isnan(columns.values("beta")).all()


def test_remarks_in_an_empty_column_do_not_make_bad_rows(pour):
    rows = [f"{row},{'MARK, 1' if k == 900 else ''}" for k, row in enumerate(ROWS * 200)]
    rows[900] = f'{ROWS[0]},"MARK, 1"'
    columns = pour("\n".join([HEADER + ",event", *rows]))
    np.testing.assert_array_equal(table(columns)[:, :-1], np.tile(TABLE, (200, 1)))
    assert columns.contents.n_bad_rows == 0
    assert columns.contents.ignored == ("event: text from line 902 on, 'MARK, 1'",)


def broken(row):
    """Ways to break a row, with what is said about it."""
    cells = row.split(",")
    return {
        "short": (",".join(cells[:4]), "4 cells instead of 7"),
        "long": (row + ",7", "8 cells instead of 7"),
        "word": (
            ",".join([*cells[:2], "abc", *cells[3:]]),
            "'abc' in column p_radps is not a number",
        ),
        "python": (",".join([*cells[:2], "1_0", *cells[3:]]), "'1_0' in column p_radps"),
        "hex": (",".join([*cells[:2], "0x1F", *cells[3:]]), "'0x1F' in column p_radps"),
        "two": (",".join([*cells[:6], "1 2"]), "'1 2' in column dr_rad is not a number"),
        "open quote": (",".join(['"1', *cells[1:]]), "unmatched quotes"),
        "text behind a quote": (",".join(['"1"2', *cells[1:]]), "unmatched quotes"),
        "header": (HEADER, "'t_s' in column t_s is not a number"),
        "bytes": (",".join([*cells[:6], "1\udc81"]), "unreadable bytes in column dr_rad"),
        "zeros": (",".join([*cells[:6], "1\0"]), "unreadable bytes in column dr_rad"),
    }


@pytest.mark.parametrize("way", broken(ROWS[0]))
def test_a_bad_row_is_left_out_with_its_line_and_reason(way, pour):
    rows = ROWS * 20
    rows[100], reason = broken(rows[100])[way]
    text = "# a recorder\n\n" + "\n".join([HEADER, *rows])
    columns = pour(text.encode("utf-8", "surrogateescape"))
    (bad,) = columns.contents.bad_rows
    assert bad.line == 104
    assert reason in bad.reason
    assert bad.text.isprintable()
    np.testing.assert_array_equal(table(columns), np.delete(np.tile(TABLE, (20, 1)), 100, axis=0))
    assert columns.contents.notes[-1].startswith("Dropped 1 of 240 rows (0.42 %)")


@settings(max_examples=examples(40))
@given(
    broken_rows=st.dictionaries(
        st.integers(0, 599), st.sampled_from([*broken(ROWS[0])]), max_size=40
    ),
    blank=st.sets(st.integers(0, 599), max_size=5),
    above=st.integers(0, 3),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    block=st.integers(2000, 9000),
)
def test_bad_rows_are_found_by_line_wherever_they_are(
    broken_rows, blank, above, end, block, tmp_path_factory
):
    assume(broken_rows.get(0) != "header")  # two lines of names
    lines, expected, good = ["# note"] * above + [HEADER], [], []
    for k, row in enumerate(ROWS * 50):
        lines += ["", "  "] * (k in blank)
        if k in broken_rows:
            expected.append(len(lines) + 1)
            lines.append(broken(row)[broken_rows[k]][0])
        else:
            good.append(TABLE[k % N])
            lines.append(row)
    folder = tmp_path_factory.mktemp("columns")
    path = folder.with_suffix(".csv")
    path.write_bytes(end.join(lines).encode("utf-8", "surrogateescape"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "BLOCK_SIZE", block)
        patch.setattr(reader, "PIECE_BYTES", 300)
        contents = read(path, ColumnWriter(folder, 2**30, bad_share=0.1))
    assert [bad.line for bad in contents.bad_rows] == expected
    assert contents.n_bad_rows == len(expected)
    np.testing.assert_array_equal(table(open_columns(folder)), good)


def test_too_many_bad_rows_are_refused_with_their_count_and_the_first_lines(pour):
    rows = ROWS * 100
    rows[::50] = ["1,2"] * 24
    with pytest.raises(TelemetryError) as refusal:
        pour("\n".join([HEADER, *rows]))
    assert "24 of the 1200 rows cannot be read, more than 1 %" in str(refusal.value)
    assert "(line 2: 2 cells instead of 7; line 52: " in str(refusal.value)
    assert pour("\n".join([HEADER, *rows]), bad_share=0.02).contents.n_bad_rows == 24


def test_a_few_bad_rows_are_allowed_in_a_small_table_but_not_most(pour):
    assert pour("\n".join([HEADER, *ROWS[:6], "x", "y", "z"])).contents.n_bad_rows == 3
    with pytest.raises(TelemetryError, match="2 of the 5 rows"):
        pour("\n".join([HEADER, *ROWS[:3], "x,1", "y,1"]))


def test_a_hopeless_file_is_refused_before_its_end(pour, monkeypatch):
    monkeypatch.setattr(reader, "BLOCK_SIZE", 4000)
    with pytest.raises(TelemetryError, match="rows so far cannot be read"):
        pour("\n".join([HEADER, *[*ROWS, "x"] * 200]))


def test_more_bad_rows_than_are_listed_are_counted(pour):
    contents = pour("\n".join([HEADER, *[*ROWS, "x"] * 150]), bad_share=0.1).contents
    assert (len(contents.bad_rows), contents.n_bad_rows) == (100, 150)


BAD_CONTENT = {
    "nothing": ("", "no row of numbers"),
    "blank lines": ("\n \n\n", "no row of numbers"),
    "empty quotes": ('""\n', "no row of numbers"),
    "header only": (HEADER, "no row of numbers"),
    "one row": (f"{HEADER}\n{ROWS[0]}\n", "at least two rows"),
    "prose": ("To be, or not to be: that is\nthe question.\n", "no row of numbers"),
    "binary": (b"\x89PNG\r\n\x00\x00" * 40, "no row of numbers"),
    "columns of text": ("a,b\nx,y\nz,w\n", "no row of numbers"),
}


@pytest.mark.parametrize(("content", "message"), BAD_CONTENT.values(), ids=BAD_CONTENT)
def test_a_text_without_a_table_is_refused_in_one_sentence(content, message, pour):
    with pytest.raises(TelemetryError, match=message) as refusal:
        pour(content)
    assert str(refusal.value).isprintable()
    assert ": " in str(refusal.value)


def test_more_numbers_than_allowed_are_refused(pour):
    with pytest.raises(TelemetryError, match="expands to more"):
        pour(GOOD, most_bytes=100)


@settings(max_examples=examples(60))
@given(st.binary(max_size=300), st.booleans())
@example(b'"', True)
@example(b"\xff\xfe", False)
def test_noise_is_refused_as_telemetry_and_nothing_else(tmp_path_factory, noise, after_table):
    folder = tmp_path_factory.mktemp("columns")
    path = folder.with_suffix(".csv")
    path.write_bytes(GOOD.encode() + noise if after_table else noise)
    try:
        contents = read(path, ColumnWriter(folder, 2**20))
    except TelemetryError:
        return
    assert contents.groups[0].n_rows >= 2


@settings(max_examples=examples(60))
@given(st.data())
def test_whole_blocks_and_single_rows_are_read_alike(tmp_path_factory, data):
    text = data.draw(st.sampled_from([c for c in DIALECTS.values() if isinstance(c, str)]))
    at = data.draw(st.lists(st.integers(0, len(text) - 1), max_size=6))
    for k in at:
        sign = data.draw(st.sampled_from([*'",;\n "-_.deDxN#:', "nan", "\t", "\u00e9"]))
        text = text[:k] + sign + text[k + data.draw(st.integers(0, 2)) :]
    path = tmp_path_factory.mktemp("columns") / "record.csv"
    path.write_bytes(text.encode())

    def outcome(name):
        folder = path.parent / name
        folder.mkdir()
        try:
            return read(path, ColumnWriter(folder, 2**20)), table(open_columns(folder)).tobytes()
        except TelemetryError as error:
            return str(error)

    whole = outcome("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "parsed", refused)
        assert outcome("single") == whole


def refused(*_):
    raise ValueError("by row, please")


cells = st.one_of(
    st.floats(width=64, allow_nan=False, allow_infinity=False).map(repr), st.integers().map(str)
)


@given(
    st.lists(st.lists(cells, min_size=3, max_size=3), min_size=2, max_size=30),
    st.sampled_from(",;\t| "),
)
def test_every_number_is_read_to_its_last_bit(tmp_path_factory, rows, delimiter):
    folder = tmp_path_factory.mktemp("columns")
    path = folder.with_suffix(".csv")
    path.write_text("\n".join(map(delimiter.join, [["a", "b", "c"], *rows])))
    read(path, ColumnWriter(folder, 2**20))
    values = np.array([[float(cell) for cell in row] for row in rows])
    values[np.isinf(values)] = np.nan
    np.testing.assert_array_equal(table(open_columns(folder)), values)
