"""Quote an input value in an error."""

from reprlib import Repr
from typing import Any

MOST_SIGNS = 80
_short = Repr()
_short.maxstring = _short.maxother = _short.maxlong = MOST_SIGNS


def quoted(value: Any) -> str:
    """The repr of a value; a long one shortened to its beginning and end."""
    return _short.repr(value)
