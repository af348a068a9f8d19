"""Hostile files, each made by the writer of its name."""

from collections.abc import Callable
from pathlib import Path

from tests.fuzzing.hostile_arrays import ARRAYS
from tests.fuzzing.hostile_records import RECORDS
from tests.fuzzing.hostile_text import TEXTS


def _text(make: Callable[[], str]) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(make().encode())


HOSTILE: dict[str, Callable[[Path], object]] = {
    **{name: _text(make) for name, make in TEXTS.items()},
    **ARRAYS,
    **RECORDS,
}
READABLE = frozenset(
    (
        "unclosed_quote",
        "numbers_without_end",
        "four_thousand_columns",
        "names_all_alike",
        "name_without_end",
        "brackets_without_end",
        "every_sign",
        "turned_around",
        "terminal_signs",
        "days_out_of_range",
        "backwards",
        "groups_in_circles",
        "groups_in_groups",
        "many_objects",
        "odd_names",
        "channel_outside",
        "packets_of_all_kinds",
        "packets_of_all_times",
        "odd_names_of_columns",
    )
)
"""Those that hold a signal all the same."""
ENDLESS = frozenset(("blocks_in_circles", "messages_of_messages"))
"""Those that the library that reads them comes to no end with, so that the limit of time does."""
FEW_HOSTILE = frozenset(
    (
        "unclosed_quote",
        "lists_in_lists",
        "matlab_bomb",
        "groups_in_circles",
        "netcdf_records",
        "message_of_itself",
        "channel_outside",
        "packets_of_all_times",
        "zip_bomb",
        "empty",
    )
)
"""One of about every format, for a short run."""
