"""Locations outside the tests."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The checkout."""
SHARED = ROOT.parent / "shared"
"""Published numbers and flight records, beside the checkout; they are not part of it."""
RECORDS = SHARED / "data"
DATA = ROOT / "tests" / "data"
"""Files that the program wrote, in this version and before."""
VERSION_0_1_0 = ROOT / "tests" / "data" / "version_0_1_0"
"""Monitors, expected p-values and a data directory that version 0.1.0 made."""
