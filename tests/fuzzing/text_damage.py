"""Damage to text tables by people, spreadsheets and other programs."""

from collections.abc import Callable
from random import Random

CELLS = (
    *("", " ", "NaN", "nan", "-inf", "1e400", "-1e400", "1e-400", "1e308", "-1e308", "5e-324"),
    *("0x1p3", "0x10", "1_000", "1,5", "1.5.2", "--1", "+-1", "1e", "e5", ".", "-", "1d5", "1 000"),
    *("1'000", "$5", "5%", "TRUE", "null", "#REF!", "=1+1", "12:60:61", "24:00:00", "-1:00:00"),
    *("2024-02-30 12:00:00", "9999-12-31T23:59:59.999999999Z", "0001-01-01T00:00:00", "366 1:2:3"),
    *("1600-01-01 00:00:00", "2300-01-01 00:00:00", "31.12.2024 23:59:59,9999999999", "000:00:00"),
    *("99999999999999999999", "-9223372036854775809", "0" * 400, "9" * 400, "1." + "3" * 400),
    *("١٢٣", "１２３", "½", "²", "−5", "1\u00a0000", "\ufeff1", "\u200b2", "\u202e3", "e\u0301"),
    *("\0", "a\0b", "\x1a", "\x1b[31m", "\x85", "\u2028", "\v", "\f", "\ufffd", "\U0001f6e9"),
    *('"', '""', '"a', 'a"b', '"1"2', '"1', "'1'", '"1\n2"', "\\", "\\n", "#", "//", ";", "|"),
    *("word", "a b", "[deg]", "(deg/s)", "x" * 5000),
)
MOST = 2_000_000
"""Signs that a table may grow to."""
SIGNS = (",", ";", "\t", "|", " ", "  ", '"', ".", ":", "\r", "\n", "\r\n", "\0")


def lines_of(text: str) -> list[str]:
    return text.split("\n")


def another_cell(rng: Random, text: str) -> str:
    """Some cells say something else."""
    lines = lines_of(text)
    for _ in range(rng.choice((1, 1, 3, 30))):
        at = rng.randrange(len(lines))
        sign = next((sign for sign in ",;\t|" if sign in lines[at]), " ")
        found = lines[at].split(sign)
        found[rng.randrange(len(found))] = rng.choice(CELLS)
        lines[at] = sign.join(found)
    return "\n".join(lines)


def another_column(rng: Random, text: str) -> str:
    """A whole column says something else."""
    lines, chosen = lines_of(text), rng.sample(CELLS, 2)
    sign = next((sign for sign in ",;\t|" if sign in lines[-2 % len(lines)]), " ")
    column, first = rng.randrange(6), rng.choice((0, 1, 2, len(lines) // 2))
    for at in range(first, len(lines)):
        found = lines[at].split(sign)
        if column < len(found):
            found[column] = rng.choice(chosen)
            lines[at] = sign.join(found)
    return "\n".join(lines)


def another_sign(rng: Random, text: str) -> str:
    """One sign becomes another, in places or all over."""
    was, becomes = rng.sample(SIGNS, 2)
    return text.replace(was, becomes, rng.choice((-1, 1, 5)))


def inserted_sign(rng: Random, text: str) -> str:
    for _ in range(rng.choice((1, 2, 20))):
        at = rng.randint(0, len(text))
        text = text[:at] + rng.choice((*SIGNS, *CELLS)) + text[at:]
    return text


def other_lines(rng: Random, text: str) -> str:
    """Lines are lost, doubled, moved, joined, emptied."""
    lines = lines_of(text)
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            del lines[at : to + 1]
        case 1:
            lines[at:at] = lines[to : to + rng.choice((1, 5, 200))] * rng.choice((1, 3))
        case 2:
            rng.shuffle(lines)
        case 3:
            lines[at] = lines[at] + lines[to]
        case 4:
            lines[at:at] = [""] * rng.choice((1, 100))
        case _:
            lines = [*lines[:1], *sorted(lines[1:], reverse=True)]
    return "\n".join(lines)


def mixed_ends(rng: Random, text: str) -> str:
    return "".join(line + rng.choice(("\n", "\r", "\r\n", "\n\r")) for line in lines_of(text))


def wide(rng: Random, text: str) -> str:
    """Rows of so many columns that they are barely one table."""
    sign, times = rng.choice(",;\t| "), rng.choice((2, 10, 50, 200))
    times = min(times, 1 + MOST // len(text)) if text else times
    lines = lines_of(text)[: max(4, 6000 // times)]
    return "\n".join(sign.join([line] * times) for line in lines)


def long(rng: Random, text: str) -> str:
    """One line is longer than all others together."""
    lines = lines_of(text)
    length = rng.choice((100, 5000, 50_000))
    lines[rng.randrange(len(lines))] += rng.choice(("x", "1", ",", '"', " ", "1,")) * length
    return "\n".join(lines)


def above(rng: Random, text: str) -> str:
    """More stands above the table."""
    line = rng.choice(("# note", "x=1", "", ",,,,", "1;2", "name: value", "[section]", '"'))
    return f"{line}\n" * rng.choice((1, 10, 600)) + text


DAMAGES: tuple[Callable[[Random, str], str], ...] = (
    another_cell,
    another_cell,
    another_cell,
    another_column,
    another_column,
    another_sign,
    inserted_sign,
    other_lines,
    other_lines,
    mixed_ends,
    wide,
    long,
    above,
)
