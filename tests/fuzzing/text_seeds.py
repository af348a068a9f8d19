"""Small text tables as recorders, spreadsheets and programs write them."""

from math import cos, sin

N = 40
ROWS = [(0.02 * k, 3 * sin(0.02 * k), cos(0.04 * k), -0.5 + k, 1e-3 * k * k) for k in range(N)]
NAMES = ("time", "beta", "p", "r", "Ny")
UNITS = ("s", "deg", "deg/s", "deg/s", "g")


def plain(delimiter: str, head: str, decimal: str = ".", end: str = "\n") -> str:
    rows = (delimiter.join(f"{v:.6g}".replace(".", decimal) for v in row) for row in ROWS)
    return end.join([head, *rows, ""])


def dated() -> str:
    rows = (
        f'"2024-05-01T23:59:58.{20 * k:03d}Z",{row[1]:.4f},"quiet, calm",{k % 2}'
        for k, row in enumerate(ROWS)
    )
    return "\r\n".join(['"when","beta [deg]","remark","flag"', *rows, ""])


def past_midnight() -> str:
    clocks = [f"23:59:{59.5 + 0.02 * k:06.3f}" for k in range(25)]
    clocks += [f"00:00:{0.02 * k:06.3f}" for k in range(N - 25)]
    rows = (f"{at}\t{row[1]:.4f}\t{row[2]:.4f}" for at, row in zip(clocks, ROWS, strict=True))
    return "\n".join(["# recorder 7", "clock\tbeta\tp", "\tdeg\tdeg/s", *rows, ""])


def fortran() -> str:
    rows = ("".join(f"{v:15.6E}" for v in row).replace("E", "D") for row in ROWS)
    return "\n".join([" ".join(f"{name:>14}" for name in NAMES), *rows, ""])


def with_gaps() -> str:
    rows = [[f"{v:.5g}" for v in row] for row in ROWS]
    for k, row in enumerate(rows):
        row[1 + k % 4] = ("NaN", "", "---", "1e400")[k % 4]
    lines = [",".join(row) for row in rows]
    lines[30] += ",7"
    return "\n".join(["; exported by hand", ",".join(NAMES), ",".join(UNITS), *lines, ""])


TEXTS: dict[str, bytes] = {
    "commas.csv": plain(",", "t_s,beta_rad,p_radps,r_radps,Ny_g").encode(),
    "semicolons.txt": plain(";", "Zeit [s];β [°];p;r;Ny", ",", "\r\n").encode(),
    "clock.tsv": past_midnight().encode("utf-8-sig"),
    "dated.csv": dated().encode(),
    "fortran.dat": fortran().encode(),
    "gaps.csv": with_gaps().encode(),
    "wide.txt": plain("\t", "Zeit [s]\tβ [°]\tp\tr\tNy").encode("utf-16"),
    "nameless.asc": plain("|", "# only numbers, by Müller").encode("cp1252"),
}
