"""`forewarn sweep`: its table, rows and figure, and bad arguments."""

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from app.cli import main

SMALL = [
    "sweep",
    "--tests",
    "ATTAS",
    "--leads",
    "0.25,1.6",
    "--n-monitors",
    "1",
    "--n-test",
    "60",
    "--n-unsafe",
    "25",
]


def test_the_table_has_each_method_and_the_leads_that_none_reaches(capsys, tmp_path) -> None:
    out, figure = tmp_path / "sweep.csv", tmp_path / "sweep.svg"
    options = ["--reactions", "0.25,2", "-o", str(out), "--figure", str(figure)]
    assert main([*SMALL, *options]) == 0
    text = capsys.readouterr().out
    assert "ATTAS: " in text
    assert "no method lets safe flights pass 1.6 s ahead" in text
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert {row["method"] for row in rows} >= {"linear + nearest neighbor", "test card: rest"}
    assert {float(row["reaction_s"]) for row in rows} == {0.25, 2.0}
    assert all(0 <= float(row["prevented"]) <= 1 for row in rows)
    assert {"ATTAS", "test card: rest", "1 in 20 has failed"} <= texts(figure)
    assert main([*SMALL, "--figure", str(out)]) != 0
    assert "a figure's name ends in .png or .svg" in capsys.readouterr().err
    assert main([*SMALL, "--methods", "fortune"]) != 0
    assert "'fortune' was given: choose linear + nearest neighbor" in capsys.readouterr().err


def test_json_has_a_row_for_each_lead_and_reaction_time(capsys) -> None:
    assert main([*SMALL, "--methods", "predicted magnitude", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["lead"] for row in rows] == pytest.approx([0.25] * 5 + [1.6] * 5)
    assert {row["method"] for row in rows} == {"predicted magnitude"}


def texts(figure: Path) -> set[str]:
    words = ElementTree.parse(figure).iter("{http://www.w3.org/2000/svg}text")
    return {"".join(word.itertext()) for word in words}
