"""Find units in the lines above a text table, without interpreting them."""

import re
from collections.abc import Sequence

from app.telemetry.units import spelled

MARKED_UNIT = re.compile(r"\[([^\[\]]*)\]|\{([^{}]*)\}|<([^<>]*)>|\(([^()]*)\)")
UNIT_AT_END = re.compile(rf"\S\s*(?:{MARKED_UNIT.pattern})$")
UNIT_WORD = re.compile(
    r"""
    s | secs? | seconds? | ms(ec)? | us(ec)? | [µμ]s | ns | min | h | hrs? | hours | days
    | m?rad | degs? | degrees? | [°º] | rev | turn | sr
    | [mckµ]?m | ft | feet | foot | in(ch)? | nmi? | mi(le)?
    | kn | k?ts? | knots? | k[itc]as | mach | mph | km?ph | kmh | fpm | rpm | [km]?hz
    | m?g | g[0n] | gee | kg | lb[smf]? | slug | t | (da|k)?n | ftlb
    | [hkm]?pa | m?bar | psi[ag]? | psf | inhg | mmhg | atm
    | [°º]?[kcf] | deg[cf] | celsius | kelvin
    | [mk]?v | [mkµ]?a | [mk]?w | k?j | ohm | gauss | [µn]?t
    | % | percent | pct | bool(ean)? | bits? | counts? | cnt | raw | enum | flag
    | per | sq | (rad|deg|m|f|d)ps2? | rads
    | [hms]{2,3} | yyyy | dd | utc
    """,
    re.VERBOSE,
)
SURE_UNIT = re.compile(
    r"s|secs?|seconds?|sek|ms|degs?|degrees?|grad|rad|[°º%]|kts?|ft|hz|[°º]c|degc|[hk]pa|.+[/*·^].+"
)
NO_UNIT = frozenset({"", "-", "--", "1", "n/a", "na", "none", "nd", "unitless", "no unit"})


def unit_in(name: str) -> str:
    """Unit in brackets at the end of a name, "" for none.

    Parentheses count only if the text reads like a unit: "p (deg/s)", but not "beta (filtered)".
    """
    match = UNIT_AT_END.search(name)
    if not match:
        return ""
    *bracketed, in_parentheses = match.groups()
    sure = next((text.strip() for text in bracketed if text is not None), None)
    unit = sure if sure is not None else in_parentheses.strip()
    if unit.isdigit() or (sure is None and not reads_like_unit(unit)):
        return ""
    return "" if unit.lower() in NO_UNIT else unit


def unit_of_cell(cell: str) -> str:
    """Unit in a cell of a row of units: "[deg]", "(deg)" or "deg"; "" for a sign of none."""
    match = MARKED_UNIT.fullmatch(cell)
    unit = next(text for text in match.groups() if text is not None) if match else cell
    return "" if unit.strip().lower() in NO_UNIT else unit.strip()


def are_units(row: Sequence[str]) -> bool:
    """Whether cells are units, not names: half of them can be units and one certainly is."""
    marked = {unit_of_cell(cell) for cell in row if MARKED_UNIT.fullmatch(cell)} - {""}
    bare = [unit for cell in row if (unit := unit_of_cell(cell))]
    possible = [unit for unit in bare if unit in marked or reads_like_unit(unit)]
    certain = [unit for unit in bare if unit in marked or SURE_UNIT.fullmatch(unit.lower())]
    return bool(certain) and 2 * len(possible) >= len(bare)


def reads_like_unit(text: str) -> bool:
    """Whether a text is a known unit, or consists of unit words, powers and fractions."""
    if spelled(text):
        return True
    words = [w for w in re.split(r"[\s/*·.^:²³⁻\d+-]+", text.lower()) if w]
    return bool(words) and all(map(UNIT_WORD.fullmatch, words))
