"""Hostile text tables: endless, irregular, with unusual characters."""

from collections.abc import Callable

ROW = "0.5,1.25,-3\n"


def unclosed_quote() -> str:
    rows = ROW * 3000
    return f't,beta,p\n{rows[:600]}0.5,"1.25,-3\n{rows}'


def every_quote_open() -> str:
    return "t,beta,p\n" + '"0.5,1.25,-3\n' * 3000


def one_line_without_end() -> str:
    return "t,beta\n" + "1," * 3_000_000


def numbers_without_end() -> str:
    return "t,beta\n" + "1" * 300_000 + ",2\n" + "3," + "4" * 300_000 + "\n"


def columns_without_end() -> str:
    return "".join(",".join(f"{row}" for _ in range(60_000)) + "\n" for row in range(4))


def four_thousand_columns() -> str:
    head = ",".join(f"x{k}" for k in range(4000))
    return head + "\n" + ("1," * 3999 + "1\n") * 20


def names_all_alike() -> str:
    return ",".join(["x"] * 4000) + "\n" + ("1," * 3999 + "1\n") * 3


def name_without_end() -> str:
    return "t," + "beta " * 40_000 + "[deg]\n0,1\n1,2\n2,3\n"


def brackets_without_end() -> str:
    return "t," + "([{<" * 20_000 + "\n0,1\n1,2\n2,3\n"


def blank_lines() -> str:
    return "t,beta\n" + "\n" * 1_000_000 + "0,1\n1,2\n"


def delimiters() -> str:
    return ",;\t|" * 50_000 + "\n"


def comments() -> str:
    return "#,#,#\n" * 100_000


def other_widths() -> str:
    return "".join("1," * (k % 50) + "1\n" for k in range(5000))


def every_sign() -> str:
    signs = "".join(chr(k) for k in range(0x3000) if k not in (10, 13, 44))
    return f"t,{signs}\n" + "".join(f"{k},{signs[k]}\n" for k in range(2000))


def turned_around() -> str:
    return "t,\u202ebeta\u202c,\u200b\u2066p\u2069\n" + "0,1,\u202e2\n" * 100


def zeros_between() -> str:
    return "t,beta\n" + "".join(f"{k},{k}\n\0" for k in range(1000))


def terminal_signs() -> str:
    return "t,\x1b]0;beta\x07\x1b[2J\n" + "0,1\n1,2\n" * 50 + "\x1b[31m,3\n"


def times_of_all_ages() -> str:
    stamps = ("0001-01-01T00:00:00", "9999-12-31T23:59:59.999999999", "1677-09-21 00:12:43")
    return "t,beta\n" + "".join(f"{stamps[k % 3]},{k}\n" for k in range(300))


def days_out_of_range() -> str:
    return "t,beta\n" + "".join(f"{k % 400:03d} 25:61:61,{k}\n" for k in range(300))


def extreme_numbers() -> str:
    values = ("1e400", "-1e400", "1e308", "-1.8e308", "5e-324", "-0", "nan", "inf", "0x1p3")
    return "t,beta\n" + "".join(f"{k}e300,{values[k % 9]}\n" for k in range(300))


def backwards() -> str:
    return "t,beta\n" + "".join(f"{-(10.0**k)},{k}\n" for k in range(300))


TEXTS: dict[str, Callable[[], str]] = {
    make.__name__: make
    for make in (
        unclosed_quote,
        every_quote_open,
        one_line_without_end,
        numbers_without_end,
        columns_without_end,
        four_thousand_columns,
        names_all_alike,
        name_without_end,
        brackets_without_end,
        blank_lines,
        delimiters,
        comments,
        other_widths,
        every_sign,
        turned_around,
        zeros_between,
        terminal_signs,
        times_of_all_ages,
        days_out_of_range,
        extreme_numbers,
        backwards,
    )
}
