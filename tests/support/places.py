"""Where the tests find what lies outside them."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The checkout."""
SHARED = ROOT.parent / "shared"
"""Published numbers and flight records, beside the checkout; they are not part of it."""
RECORDS = SHARED / "data"
DATA = ROOT / "tests" / "data"
"""Files that earlier versions of the program wrote."""
