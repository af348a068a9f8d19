"""The stored table of near and foreign aircraft, and a part of it recomputed."""

import csv

import pytest
from pydantic import TypeAdapter

from core.evaluation.lead_sweep import TESTS
from tests.studies.near_foreign import PLANNED, SHOWN, NearRecipe, Row, in_words, study
from tests.support.places import DATA, ROOT

KINDS = ["own", "nominal", "factor 1.25", "factor 1.5", "factor 2"]
KINDS += ["lag 0.2 s", "lag 0.3 s", "lag 0.5 s", "other type"]


def kept() -> list[Row]:
    """The table written by `make studies`."""
    with (DATA / "near_foreign.csv").open() as file:
        return TypeAdapter(list[Row]).validate_python(list(csv.DictReader(file)))


def test_every_method_flies_every_kind_of_every_test() -> None:
    names = {(row.test, row.method, row.kind) for row in kept()}
    methods = NearRecipe().methods
    assert names == {(t, m, k) for t in TESTS for m in methods for k in KINDS}


def test_another_type_is_withdrawn_or_alerted_on_in_time() -> None:
    assert all(row.missed == 0 for row in kept() if row.kind == "other type")


def test_the_guide_gives_the_figures_of_the_table() -> None:
    text = (ROOT / "static" / "guide" / "method.md").read_text(encoding="utf-8")
    rows = {(row.test, row.method, row.kind): row for row in kept()}
    for kind in (kind for kind in KINDS if kind != "nominal"):
        cells = []
        for method in SHOWN:
            missed = (rows[test, method, kind].missed for test in TESTS)
            quiet = (rows[test, method, kind].quiet for test in TESTS)
            cells.append(
                " / ".join(" ".join(f"{x:.2f}"[1:] for x in part) for part in (missed, quiet))
            )
        assert f"| {' | '.join(cells)} |" in text, kind


def test_the_guide_gives_the_worst_aircraft_by_scope() -> None:
    text = (ROOT / "static" / "guide" / "method.md").read_text(encoding="utf-8")
    rows = {(row.test, row.method, row.kind): row for row in kept()}
    for kind in (kind for kind in KINDS if kind not in ("nominal", "other type")):
        cells = []
        for method in (PLANNED, SHOWN[-1]):
            found = [rows[test, method, kind] for test in TESTS]
            shares = [row.missed for row in found]
            worst = [row.worst_misses / row.worst_failures for row in found]
            cells += [" ".join(f"{x:.2f}"[1:] for x in part) for part in (shares, worst)]
        assert f"| {' | '.join(cells)} |" in text, kind


def test_the_default_keeps_its_promise_near_the_planned_aircraft() -> None:
    for row in kept():
        if row.method == SHOWN[-1]:
            assert row.missed <= NearRecipe().epsilon, row
            assert row.worst_misses <= 0.4 * row.worst_failures, row


def test_a_small_study_has_a_row_for_each_kind() -> None:
    recipe = NearRecipe(
        tests=("F-16",), methods=SHOWN[:1], factors=(1.5,), lags_s=(0.3,),
        n_monitors=1, n_unsafe=50, n_aircraft=20, most_failures=5,
    )  # fmt: skip
    rows = list(study(recipe))
    assert [row.kind for row in rows] == ["own", "nominal", "factor 1.5", "lag 0.3 s", "other type"]
    for row in rows:
        assert 0 < row.n_aircraft <= 20
        assert row.missed_low <= row.missed <= row.missed_high
        assert row.worst_misses <= row.worst_failures
    assert len(in_words(rows).splitlines()) == 6


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(ValueError, match="'magic' is unknown; there are linear"):
        NearRecipe(methods=("magic",))
