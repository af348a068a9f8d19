"""`forewarn campaign`: a whole build-up from plan to the last point, and what stops it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.campaigns import clearing
from app.campaigns.campaign import load
from app.campaigns.point import FlownPoint
from app.cli import main
from app.commands import campaign as command
from app.commands.sample_flight import table
from core.clearance.with_monitor import WithMonitor
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator
from core.recipe import from_plain

QUICK = ("--n-exceeding", "20", "--n-aircraft", "100", "--imperfections", "none")
TEST = ("--aircraft", "attas_id_16kft", "--control-law", "none", "--limit", "Ny=0.3g")
NOISE = [
    word
    for sigma in (
        "Ny=0.003g",
        "p=0.1deg/s",
        "r=0.1deg/s",
        "beta=0.05deg",
        "delta_a=0.02deg",
        "delta_r=0.02deg",
    )
    for word in ("--noise", sigma)
]


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Two steps and a point, on an ATTAS without law; nothing flown."""
    path = tmp_path / "campaign.json"
    plan = ("campaign", "new", str(path), "--name", "Rudder", "--steps", "0.6", "0.8", "1")
    assert main([*plan, *TEST, *NOISE, *QUICK]) == 0
    return path


def recorded(campaign: Path, scale: float = 1.0) -> str:
    """The next point flown by the nominal aircraft, as CSV."""
    planned = load(campaign)
    test = planned.test_of(planned.next.point)
    assert isinstance(test, DatasetRecipe)
    simulator = LateralSimulator(test)
    theta = simulator.plant.nominal[np.newaxis]
    y = simulator.fly(theta, np.random.default_rng(1), np.array([scale]))[0].y[0]
    path = campaign.with_name("flight.csv")
    path.write_text(table(y, simulator.recipe.dt))
    return str(path)


def run(campaign: Path, action: str, *options: str) -> int:
    """Run an action on the campaign."""
    return main(["campaign", action, str(campaign), *options])


def test_a_build_up_is_planned_cleared_flown_and_identified(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each state after the other, by name; at the end a recipe for the next monitor."""
    assert run(campaign, "confirm", "--by", "Ann") == 0
    assert run(campaign, "fly", recorded(campaign), "--by", "Bob") == 0
    told = capsys.readouterr().out
    assert "60%: complete: flight.csv" in told
    assert run(campaign, "clear", "--by", "Ann") == 0
    told = capsys.readouterr().out
    assert "80%: on condition" in told
    assert "fly a second one to exclude it" in told
    assert "largest recommended amplitude" in told
    assert run(campaign, "confirm", "--by", "Ann") == 0
    assert load(campaign).next.point.state == "cleared"
    assert run(campaign, "fly", recorded(campaign), "--by", "Bob") == 0
    point = load(campaign).flown("")[1]
    assert point.flown is not None
    assert point.clearing is not None
    assert point.flown.reached == pytest.approx(point.clearing.reached[1], abs=0.05)
    capsys.readouterr()
    assert run(campaign, "show") == 0
    told = capsys.readouterr().out
    assert "next: 100%" in told
    assert told.count("complete") == 2
    assert run(campaign, "identify", "--json") == 0
    (plain,) = json.loads(capsys.readouterr().out)
    assert plain["sources"] == ["60%", "80%"]
    named = {parameter["name"]: parameter for parameter in plain["parameters"]}
    assert named["N_beta"]["after"][1] < 0.3 * named["N_beta"]["before"][1]
    assert not named["L_da"]["determined"]
    assert run(campaign, "report") == 0
    page = campaign.with_suffix(".html").read_text(encoding="utf-8")
    assert "Next: 100%" in page
    assert page.count('class="flown"') == 2
    assert page.count('class="predicted"') == 2, "interval and strokes of one point"
    assert "N_y and surface sensors" in page
    assert "not determined" in page
    assert "http" not in page
    recipe = campaign.with_name("recipe.json")
    assert run(campaign, "recipe", "-o", str(recipe)) == 0
    dataset = from_plain(DatasetRecipe(), json.loads(recipe.read_text())["dataset"])
    assert (
        "identified from 60% (flight.csv, 5.10 to 11.00 s), 80% (" in dataset.aircraft.description
    )


def test_a_flight_of_another_aircraft_holds_the_next_point(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rudder transducer reads half, so the identified aircraft is far from the prior."""
    flight = Path(recorded(campaign))
    rows = [line.split(",") for line in flight.read_text().splitlines()]
    for row in rows[1:]:
        row[-1] = str(0.5 * float(row[-1]))
    flight.write_text("\n".join(map(",".join, rows)))
    assert run(campaign, "fly", str(flight), "--by", "Bob") == 0
    assert "flown without clearance, while planned" in capsys.readouterr().out
    assert run(campaign, "clear", "--by", "Ann") == 1
    told = capsys.readouterr().out
    assert "80%: hold: clearance withdrawn" in told
    assert run(campaign, "confirm", "--by", "Ann") == 1
    assert "'80%' cannot be confirmed in state 'hold'" in capsys.readouterr().err


def test_an_exceedance_is_printed(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(campaign, "fly", recorded(campaign, 3.0), "--by", "Bob") == 0
    assert "EXCEEDED Ny at" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("action", "options", "words"),
    [
        ("clear", ("--by", "Ann"), "no step flown before '60%'"),
        ("identify", (), "no point is complete"),
        ("abort", ("--by", "Ann"), "no reason was given"),
        ("fly", ("none.csv", "--by", "Ann"), "none.csv"),
        ("fly", ("FLIGHT", "--by", "Ann", "--start", "1"), "one of --start and --end"),
        ("fly", ("FLIGHT", "--by", "Ann", "--start", "0", "--end", "99"), "not inside"),
    ],
)
def test_a_refused_action_changes_nothing(
    campaign: Path,
    capsys: pytest.CaptureFixture[str],
    action: str,
    options: tuple[str, ...],
    words: str,
) -> None:
    before = campaign.read_bytes()
    given = [recorded(campaign) if option == "FLIGHT" else option for option in options]
    assert run(campaign, action, *given) == 1
    assert words in capsys.readouterr().err
    assert campaign.read_bytes() == before


def test_hold_and_abort_are_stored_with_their_reasons(campaign: Path) -> None:
    assert run(campaign, "hold", "--by", "Ann", "--why", "cloud") == 0
    assert load(campaign).next.point.events[-1].words == "cloud"
    assert run(campaign, "abort", "--by", "Ann", "--why", "bird strike") == 0
    assert load(campaign).next.point.name == "80%"


def test_a_point_is_aborted_in_flight(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    why = ("--by", "Ann", "--why", "flutter")
    assert run(campaign, "abort", *why, "--start", "0", "--end", "9") == 1
    assert "give it with --recording" in capsys.readouterr().err
    assert run(campaign, "abort", *why, "--recording", recorded(campaign)) == 0
    assert "aborted: flutter; flight.csv, entire recording: reached" in capsys.readouterr().out
    flown = load(campaign).points[0].flown
    assert flown is not None
    assert (flown.y, flown.exceeded) == ((), "")


def test_a_page_is_written_before_and_after_all_flights(campaign: Path) -> None:
    assert run(campaign, "report") == 0
    page = campaign.with_suffix(".html").read_text(encoding="utf-8")
    assert "engineering decision required" in page
    for _ in range(3):
        assert run(campaign, "abort", "--by", "<b>Ann</b>", "--why", "weather") == 0
    assert run(campaign, "report") == 0
    page = campaign.with_suffix(".html").read_text(encoding="utf-8")
    assert "Every point is complete or aborted" in page
    assert "<b>Ann" not in page


def test_a_refused_point_gets_a_smaller_step(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign, by = tmp_path / "campaign.json", ("--by", "Ann")
    plan = ("--name", "Rudder", "--steps", "0.52", "1", "--amplitude", "7.36")
    assert run(campaign, "new", *plan, *TEST, *NOISE, *QUICK) == 0
    assert run(campaign, "smaller", *by) == 1
    assert "no smaller step is proposed before '52%'" in capsys.readouterr().err
    assert run(campaign, "fly", recorded(campaign), *by) == 0
    capsys.readouterr()
    assert run(campaign, "clear", *by) == 1
    told = capsys.readouterr().out
    step = load(campaign).smaller_step
    assert step is not None
    assert f"proposed: fly {step.name}" in told
    assert run(campaign, "report") == 0
    assert f"Proposed: fly {step.name}" in campaign.with_suffix(".html").read_text(encoding="utf-8")
    assert run(campaign, "smaller", *by) == 0
    assert load(campaign).next.point.name == step.name


def test_a_clearance_is_computed_with_the_monitor_of_its_point(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    risks = np.full(120, 0.3)
    monkeypatch.setattr(clearing, "with_monitor", lambda rule, *_: WithMonitor(rule.recipe, risks))
    campaign, by = tmp_path / "campaign.json", ("--by", "Ann")
    plan = ("--name", "Rudder", "--steps", "0.6", "1")
    wider = [word.replace("0.3g", "0.305g") for word in TEST]
    assert run(campaign, "new", *plan, *wider, *NOISE, "--n-exceeding", "60", *QUICK[2:]) == 0
    assert run(campaign, "fly", recorded(campaign), *by) == 0
    run(campaign, "clear", *by, "--with-monitor")
    known = load(campaign).next.point.clearing
    assert known is not None
    assert known.monitor_epsilon is not None
    assert f"ε = {known.monitor_epsilon:.2g}" in capsys.readouterr().out


def test_a_campaign_is_never_overwritten(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "new", str(campaign), "--name", "x"]) == 1
    assert f"{campaign} exists" in capsys.readouterr().err


def test_a_recording_with_gaps_or_several_manoeuvres_is_refused(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = Path(recorded(campaign))
    head, *rows = flight.read_text().splitlines()
    step = float(rows[1].split(",")[0])
    twice = rows + [
        ",".join([f"{(len(rows) + k) * step:.9g}", *row.split(",")[1:]])
        for k, row in enumerate(rows)
    ]
    flight.write_text("\n".join([head, *twice]))
    assert run(campaign, "fly", str(flight), "--by", "Bob") == 1
    assert "choose the point" in capsys.readouterr().err
    assert run(campaign, "fly", str(flight), "--by", "Bob", "--start", "4.5", "--end", "11") == 0
    for k in range(140, 150):
        rows[k] = rows[k].split(",")[0] + ",,,,,,"
    flight.write_text("\n".join([head, *rows]))
    assert run(campaign, "fly", str(flight), "--by", "Bob") == 1
    assert "are missing from" in capsys.readouterr().err


def test_points_at_another_flight_condition_are_added(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = ("--condition", "M 0.6", "--steps", "0.5", "0.9", "--passes-below", "0.8")
    assert run(campaign, "add", *plan, *TEST, *NOISE, "--imperfections", "none") == 0
    told = capsys.readouterr().out
    assert "90% M 0.6" in told
    assert load(campaign).points[-1].passes_below == 0.8
    assert run(campaign, "report") == 0
    page = campaign.with_suffix(".html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2
    assert run(campaign, "add", *plan, *TEST) == 1
    assert "two flight conditions have the same name" in capsys.readouterr().err


def test_a_decision_made_during_the_command_is_not_overwritten(
    campaign: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = recorded(campaign)
    known = command.flown_point

    def slowly(*about: Any) -> FlownPoint:
        assert run(campaign, "hold", "--by", "Ben", "--why", "hydraulics") == 0
        return known(*about)

    monkeypatch.setattr(command, "flown_point", slowly)
    assert run(campaign, "fly", file, "--by", "Bob") == 1
    assert "changed" in capsys.readouterr().err
    assert load(campaign).next.point.events[-1].words == "hydraulics"


def test_a_flight_condition_needs_its_aircraft(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(campaign, "add", "--condition", "Mach 0.6") == 1
    assert "give --aircraft" in capsys.readouterr().err


def test_a_build_up_is_flown_with_sample_flights(tmp_path: Path) -> None:
    """The campaign of the guide as printed, on a smaller calibration."""
    path = tmp_path / "rudder.json"
    small = ["--n-exceeding", "20", "--n-aircraft", "100"]
    steps = ["--steps", "0.4", "0.6", "0.8", "1"]
    plan = ["--name", "Rudder build-up", "--aircraft", "attas_id_16kft"]
    assert main(["campaign", "new", str(path), *plan, *steps, *small]) == 0
    planned = load(path).conditions[0].test.maneuver.peak_deg
    for number, step in enumerate((0.4, 0.6, 0.8, 1.0)):
        flight = tmp_path / f"flight{number}.csv"
        options = ["--aircraft", "attas_id_16kft", "--outcome", "random", "--seed", "3"]
        amplitude = ["--amplitude", f"{step * planned:g}"]
        assert main(["sample-flight", *options, *amplitude, "--out", str(flight)]) == 0
        if not number:
            assert run(path, "confirm", "--by", "Ann") == 0
        assert run(path, "fly", str(flight), "--by", "Bob") == 0
    assert load(path).is_over
