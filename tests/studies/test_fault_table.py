"""The stored fault table, and a part of it recomputed."""

import csv

import pytest
from pydantic import TypeAdapter

from tests.studies.fault_table import (
    FAULTS,
    KINDS,
    MEANS,
    NO_FAULT,
    SENSORS,
    FaultCounts,
    FaultTableRecipe,
    fault_table,
    in_words,
)
from tests.support.places import DATA, ROOT

ROUNDING = 1
"""Flights that rounding on another processor may move across a bound."""


def kept() -> dict[tuple[str, str, str], FaultCounts]:
    """The table written by `make studies`."""
    with (DATA / "fault_table.csv").open() as file:
        rows = TypeAdapter(list[FaultCounts]).validate_python(list(csv.DictReader(file)))
    return {(row.sensor, row.fault, row.kind): row for row in rows}


def test_every_fault_of_every_sensor_is_in_the_table() -> None:
    faults = {(sensor, fault) for sensor in SENSORS for fault in FAULTS} | {(NO_FAULT, NO_FAULT)}
    assert kept().keys() == {(*fault, kind) for fault in faults for kind in KINDS}


def test_flights_without_a_fault_are_rarely_called_faulty() -> None:
    for kind in KINDS:
        row = kept()[NO_FAULT, NO_FAULT, kind]
        assert (row.mapping, row.compatibility) == (0, 0)
        assert row.found <= ROUNDING


def test_wrong_signs_and_units_of_monitored_channels_are_always_found() -> None:
    """Except for the aileron, which a rudder doublet does not use."""
    for sensor in ("beta", "p", "r", "Ny", "delta_r"):
        for fault in ("sign", "unit"):
            for kind in KINDS:
                row = kept()[sensor, fault, kind]
                assert row.found == row.n, row


def test_kinematics_find_a_gain_error_that_validity_cannot() -> None:
    for sensor in ("beta", "p", "r", "phi", "psi"):
        for kind in KINDS:
            row = kept()[sensor, "gain x0.8", kind]
            assert row.compatibility >= row.n - ROUNDING, row
            assert sensor in ("r", "p") or row.validity <= row.n // 2, row


def test_a_recomputed_part_equals_the_table() -> None:
    """One fault, all flights of the table: their number decides the draws."""
    recipe = FaultTableRecipe(sensors=("r",), faults=("gain x0.8",))
    rows = list(fault_table(recipe))
    assert [row.fault for row in rows] == [NO_FAULT, NO_FAULT, "gain x0.8", "gain x0.8"]
    for row in rows:
        before = kept()[row.sensor, row.fault, row.kind]
        assert row.n == before.n == recipe.n_flights
        for name in MEANS:
            assert abs(getattr(row, name) - getattr(before, name)) <= ROUNDING, (row, name)


def test_the_guide_gives_the_figures_of_the_table() -> None:
    rows = {sensor: [kept()[sensor, "gain x0.8", kind] for kind in KINDS] for sensor in SENSORS}
    found = {sensor: sum(row.found for row in both) for sensor, both in rows.items()}
    page = ROOT / "static" / "guide" / "method.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert (
        f"of {sum(row.n for row in rows['beta'])} flights with a scale of 0.8 it finds "
        f"{found['beta']} of sideslip, {found['p']} of roll rate, {found['r']} of yaw rate and "
        f"{found['Ny']} of lateral acceleration"
    ) in text


def test_each_fault_is_one_printed_line() -> None:
    lines = in_words(list(kept().values())).splitlines()
    assert len(lines) == 2 + 1 + len(SENSORS) * len(FAULTS)
    assert all(f" {name.replace('_', ' ')}" in lines[1] for name in MEANS)


def test_unknown_sensors_and_faults_are_refused() -> None:
    with pytest.raises(ValueError, match="sensors 'q': choose beta, p"):
        FaultTableRecipe(sensors=("q",))
    with pytest.raises(ValueError, match="faults 'stuck': choose gain"):
        FaultTableRecipe(faults=("stuck",))
    with pytest.raises(ValueError, match="n_flights=0 was given: it must be at least 1"):
        FaultTableRecipe(n_flights=0)
