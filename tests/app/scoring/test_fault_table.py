"""The table of faults: the one that is kept, and a part of it made again."""

import csv

import pytest
from pydantic import TypeAdapter

from app.commands.fault_table import MEANS, in_words
from app.scoring.fault_table import (
    FAULTS,
    KINDS,
    NO_FAULT,
    SENSORS,
    FaultTableRecipe,
    FoundFaults,
    fault_table,
)
from tests.support.places import DATA, ROOT

ROUNDING = 1
"""Flights that another processor's rounding may tip over a bound."""


def kept() -> dict[tuple[str, str, str], FoundFaults]:
    """The table as `forewarn fault-table` wrote it."""
    with (DATA / "fault_table.csv").open() as file:
        rows = TypeAdapter(list[FoundFaults]).validate_python(list(csv.DictReader(file)))
    return {(row.sensor, row.fault, row.kind): row for row in rows}


def test_every_fault_of_every_sensor_is_in_the_table() -> None:
    faults = {(sensor, fault) for sensor in SENSORS for fault in FAULTS} | {(NO_FAULT, NO_FAULT)}
    assert kept().keys() == {(*fault, kind) for fault in faults for kind in KINDS}


def test_flights_without_a_fault_are_hardly_ever_called_faulty() -> None:
    for kind in KINDS:
        row = kept()[NO_FAULT, NO_FAULT, kind]
        assert (row.mapping, row.compatibility) == (0, 0)
        assert row.found <= ROUNDING


def test_what_turns_or_spoils_a_monitored_channel_is_always_found() -> None:
    """But for the aileron, which a rudder doublet leaves alone."""
    for sensor in ("beta", "p", "r", "Ny", "delta_r"):
        for fault in ("sign", "unit"):
            for kind in KINDS:
                row = kept()[sensor, fault, kind]
                assert row.found == row.n, row


def test_a_fifth_of_the_scale_is_found_by_kinematics_where_validity_cannot() -> None:
    for sensor in ("beta", "p", "r", "phi", "psi"):
        for kind in KINDS:
            row = kept()[sensor, "gain x0.8", kind]
            assert row.compatibility >= row.n - ROUNDING, row
            assert sensor in ("r", "p") or row.validity <= row.n // 2, row


def test_a_part_made_again_is_that_of_the_table() -> None:
    """All flights of the table, as their number decides the draws, of one fault."""
    recipe = FaultTableRecipe(sensors=("r",), faults=("gain x0.8",))
    rows = list(fault_table(recipe))
    assert [row.fault for row in rows] == [NO_FAULT, NO_FAULT, "gain x0.8", "gain x0.8"]
    for row in rows:
        before = kept()[row.sensor, row.fault, row.kind]
        assert row.n == before.n == recipe.n_flights
        for name in MEANS:
            assert abs(getattr(row, name) - getattr(before, name)) <= ROUNDING, (row, name)


def test_the_readme_says_what_the_table_does() -> None:
    rows = {sensor: [kept()[sensor, "gain x0.8", kind] for kind in KINDS] for sensor in SENSORS}
    found = {sensor: sum(row.found for row in both) for sensor, both in rows.items()}
    said = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert (
        f"of {sum(row.n for row in rows['beta'])} flights with a scale of 0.8 it finds "
        f"{found['beta']} of sideslip, {found['p']} of roll rate, {found['r']} of yaw rate and "
        f"{found['Ny']} of lateral acceleration"
    ) in said


def test_it_is_printed_a_line_a_fault() -> None:
    lines = in_words(list(kept().values())).splitlines()
    assert len(lines) == 2 + 1 + len(SENSORS) * len(FAULTS)
    assert all(f" {name.replace('_', ' ')}" in lines[1] for name in MEANS)


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="sensors 'q': choose beta, p"):
        FaultTableRecipe(sensors=("q",))
    with pytest.raises(ValueError, match="faults 'stuck': choose gain"):
        FaultTableRecipe(faults=("stuck",))
    with pytest.raises(ValueError, match="n_flights=0 was given: it must be at least 1"):
        FaultTableRecipe(n_flights=0)
