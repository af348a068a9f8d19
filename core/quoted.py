"""What was given, as an error repeats it."""

from reprlib import Repr
from typing import Any

MOST_SIGNS = 80
_short = Repr()
_short.maxstring = _short.maxother = _short.maxlong = MOST_SIGNS


def quoted(value: Any) -> str:
    """A value as Python writes it; of one that is long its beginning and its end."""
    return _short.repr(value)
