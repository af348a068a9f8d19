"""A campaign as a value and a file: its states, and refused input."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import beta

from app.campaigns.campaign import Campaign, load, points_at
from app.campaigns.clearing import clearing_in_words
from app.campaigns.point import (
    CampaignError,
    Clearing,
    Condition,
    FlownPoint,
    Point,
    percent_at_most,
)
from core.clearance.clearance import ClearanceError, ClearanceRecipe
from core.evaluation.lead_sweep import TESTS
from core.recipe import RecipeError

TEST = TESTS["ATTAS"]
FLOWN = FlownPoint("flight.csv, 1.00 to 7.00 s", ((0.0, 1e-3, 0.1, 0.2, 0.3, 0.4),) * 30, 0.55)


def build_up(
    name: str,
    condition: Condition,
    fractions: tuple[float, ...],
    recipe: ClearanceRecipe,
    passes_below: float = 1.0,
) -> Campaign:
    points = points_at(condition, fractions, passes_below)
    return Campaign(name, (condition,), points, recipe)


def planned() -> Campaign:
    """Three points."""
    recipe = ClearanceRecipe(epsilon=0.1)
    return build_up("Büild-up", Condition("", TEST), (0.5, 0.75, 1.0), recipe)


def test_points_are_shares_of_the_planned_amplitude() -> None:
    campaign = planned()
    assert [point.name for point in campaign.points] == ["50%", "75%", "100%"]
    assert campaign.test_of(campaign.points[0]).maneuver.peak_deg == pytest.approx(9.63 / 2)
    assert campaign.next.point.name == "50%"
    assert {point.state for point in campaign.points} == {"planned"}


def test_each_state_has_a_name_and_a_time() -> None:
    """The next point is the first that is neither complete nor aborted."""
    campaign = planned().changed(0, "cleared", " Ann ", "first point")
    campaign = campaign.changed(0, "complete", "Bob", flown=FLOWN)
    assert [event.state for event in campaign.points[0].events] == ["cleared", "complete"]
    assert campaign.points[0].events[0].by == "Ann"
    assert campaign.points[0].events[0].at.endswith("+00:00")
    assert campaign.flown("")[0].flown == FLOWN
    assert campaign.next == (1, campaign.points[1])
    campaign = campaign.changed(1, "aborted", "Bob", "gust")
    build_up = campaign.build_up(campaign.next.point)
    assert [step.maneuver.peak_deg for step in build_up.flown] == [pytest.approx(9.63 / 2)]
    over = campaign.changed(2, "aborted", "Bob", "weather")
    with pytest.raises(CampaignError, match="the campaign is over"):
        _ = over.next


def held(amplitude_deg: float | None, cleared: bool = False) -> Campaign:
    """50 % flown; 75 % of 9.63 deg refused, with this largest recommended amplitude."""
    clearing = Clearing(
        cleared, 0.2, 0.1, (0.7, 0.9, 1.1), amplitude_deg, (), 210, 1_000, ClearanceRecipe(), ()
    )
    campaign = planned().changed(0, "complete", "Bob", flown=FLOWN)
    return campaign.changed(1, "hold", "Ann", clearing=clearing)


def test_a_refused_point_gets_a_smaller_step_at_the_recommended_amplitude() -> None:
    """Rounded down to a percent of the planned amplitude; the refused point stays after it."""
    campaign = held(6.6).with_smaller_step("Ann")
    assert [point.name for point in campaign.points] == ["50%", "68%", "75%", "100%"]
    number, step = campaign.next
    assert (number, step.peak_deg) == (1, pytest.approx(0.68 * 9.63))
    assert step.events[-1].words == "smaller step before 75%"
    assert [part.maneuver.peak_deg for part in campaign.build_up(step).flown] == [9.63 / 2]
    assert campaign.points[2] == held(6.6).points[1]


@pytest.mark.parametrize(
    ("amplitude_deg", "cleared"),
    [(None, False), (5.3, False), (7.3, False), (6.6, True)],
    ids=["withdrawn", "barely above the last step", "not smaller", "cleared and held by a person"],
)
def test_no_smaller_step_is_proposed(amplitude_deg: float | None, cleared: bool) -> None:
    campaign = held(amplitude_deg, cleared)
    assert campaign.smaller_step is None
    with pytest.raises(CampaignError, match="no smaller step is proposed before '75%'"):
        campaign.with_smaller_step("Ann")


def test_no_smaller_step_is_proposed_twice_or_afterwards() -> None:
    campaign = held(6.6).with_smaller_step("Ann")
    assert campaign.smaller_step is None
    campaign = campaign.changed(1, "aborted", "Bob", "gust")
    assert campaign.smaller_step is None
    for number in (2, 3):
        campaign = campaign.changed(number, "aborted", "Bob", "gust")
    assert campaign.smaller_step is None


def test_a_file_holds_the_whole_campaign(tmp_path: Path) -> None:
    clearing = Clearing(
        True,
        0.02,
        0.1,
        (0.5, 0.7, 0.9),
        9.1,
        (),
        210,
        1_000,
        ClearanceRecipe(),
        ("50%",),
        0.2,
        0.01,
    )
    campaign = planned().changed(0, "complete", "Bob", flown=FLOWN)
    campaign = campaign.changed(1, "on condition", "Ann", "p-value 0.02", clearing=clearing)
    campaign.save(tmp_path / "c.json")
    assert load(tmp_path / "c.json") == campaign
    assert "Büild-up" in (tmp_path / "c.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("fractions", "words"),
    [
        ((1.0,), "has 2 to 50"),
        ((0.5, 0.5), "one sign and grow"),
        ((0.8, 0.5), "one sign and grow"),
        ((0.0, 0.5), "one sign and grow"),
        ((0.501, 0.502), "two points have the same name"),
        ((-0.5, 0.6), "one sign and grow"),
        ((0.5, float("inf")), "at most 1"),
        ((0.5, float("nan")), "one sign and grow"),
    ],
)
def test_points_that_do_not_build_up_are_refused(fractions: tuple[float, ...], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        build_up("c", Condition("", TEST), fractions, ClearanceRecipe())


def with_flown(plain: dict[str, Any], **changes: Any) -> dict[str, Any]:
    plain["points"][0]["flown"] |= changes
    return plain


def with_event(plain: dict[str, Any], **changes: Any) -> dict[str, Any]:
    plain["points"][0]["events"][0] |= changes
    return plain


def complete_last(plain: dict[str, Any]) -> dict[str, Any]:
    first, last = plain["points"][0], plain["points"][2]
    last |= {key: first[key] for key in ("events", "flown")}
    return plain


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda plain: plain | {"format": "other"}, "is not a campaign file"),
        (lambda plain: plain | {"version": 3}, "of version 3"),
        (lambda plain: {k: v for k, v in plain.items() if k != "points"}, "lacks 'points'"),
        (lambda plain: plain | {"points": [{"name": 3}]}, "points.0"),
        (
            lambda plain: (
                plain | {"conditions": [{"name": "", "test": {"aircraft": {"kind": "b52"}}}]}
            ),
            "b52",
        ),
        (lambda plain: plain | {"conditions": 3}, "is damaged"),
        (lambda plain: plain | {"conditions": [{"name": "M .8", "test": {}}]}, "flight condition"),
        (lambda plain: plain | {"clearance": {"epsilon": 2.0}}, "epsilon"),
        (lambda plain: plain | {"name": ["c"]}, "give a text"),
        (lambda plain: plain | {"name": "c" * 201}, "has 201 characters"),
        (lambda plain: with_flown(plain, y=[[0.0] * 6] * 2 + [[0.0] * 5]), r"shape \(0, 0\)"),
        (lambda plain: with_flown(plain, y=[[0.0] * 5] * 3), "5 channels"),
        (lambda plain: with_flown(plain, y=[]), "lacks flown samples"),
        (lambda plain: with_flown(plain, reached=-5.0), "a part of a limit, 0 or more"),
        (lambda plain: with_event(plain, at="yesterday"), "in ISO 8601"),
        (lambda plain: with_event(plain, by=" "), "no name was given"),
        (lambda plain: with_event(plain, state="cleared"), "only a complete point"),
        (lambda plain: with_event(plain, state="aborted"), "and has flown samples"),
        (lambda plain: with_event(with_flown(plain, y=[]), state="hold"), "complete or aborted"),
        (lambda plain: plain | {"points": plain["points"][1:] + plain["points"][:1]}, "grow"),
        (lambda plain: complete_last(plain), "in order"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, damage, words: str) -> None:
    path = tmp_path / "c.json"
    planned().completed(FLOWN, "Bob").save(path)
    path.write_text(json.dumps(damage(json.loads(path.read_text()))))
    with pytest.raises(CampaignError, match=words):
        load(path)


def test_missing_and_broken_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="is not readable"):
        load(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("{")
    with pytest.raises(RecipeError, match="JSON"):
        load(tmp_path / "text.json")


def test_a_decision_needs_a_name() -> None:
    with pytest.raises(CampaignError, match="person who decides"):
        planned().changed(0, "cleared", " ")


def test_a_first_point_has_no_build_up() -> None:
    with pytest.raises(ClearanceError, match="no flown step"):
        planned().build_up(Point("x", 1.0))


def test_a_file_of_version_1_has_one_flight_condition(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    planned().save(path)
    plain = json.loads(path.read_text(encoding="utf-8"))
    plain |= {"version": 1, "test": plain.pop("conditions")[0]["test"]}
    for point in plain["points"]:
        del point["condition"], point["passes_below"], point["criteria"], point["monitor"]
    path.write_text(json.dumps(plain), encoding="utf-8")
    assert load(path) == planned()


def test_steps_of_another_flight_condition_clear_no_point() -> None:
    """At each condition a person clears the first point."""
    campaign = planned().extended(Condition("M 0.8", TEST), (0.5, 1.0))
    assert [point.name for point in campaign.points[3:]] == ["50% M 0.8", "100% M 0.8"]
    for number in range(3):
        campaign = campaign.changed(number, "complete", "Bob", flown=FLOWN)
    assert campaign.next.point.condition == "M 0.8"
    with pytest.raises(ClearanceError, match="no flown step"):
        campaign.build_up(campaign.next.point)
    campaign = campaign.confirmed("Ann")
    assert campaign.next.point.state == "cleared"
    with pytest.raises(CampaignError, match="two flight conditions have the same name"):
        campaign.extended(Condition("M 0.8", TEST), (0.6, 0.7))


def test_a_step_above_the_planned_amplitude_is_not_planned_and_an_old_file_with_one_opens(
    tmp_path: Path,
) -> None:
    path = tmp_path / "c.json"
    campaign = planned()
    with pytest.raises(CampaignError, match=r"steps=0\.5 2 .* at most 1"):
        campaign.extended(Condition("M 0.8", TEST), (0.5, 2.0))
    last = replace(campaign.points[-1], name="200%", peak_deg=2.0 * campaign.points[-1].peak_deg)
    old = replace(campaign, points=(*campaign.points, last))
    old.save(path)
    assert load(path) == old


def test_a_point_beyond_its_criterion_is_not_passed() -> None:
    plan = "c", Condition("", TEST), (0.5, 1.0), ClearanceRecipe()
    campaign = build_up(*plan, passes_below=0.5)
    campaign = campaign.completed(FLOWN, "Bob")
    assert campaign.points[0].failed
    assert "NOT PASSED: the criterion is below 50%" in campaign.points[0].events[-1].words
    with pytest.raises(CampaignError, match="above 0, at most 1"):
        build_up(*plan, passes_below=1.1)


def test_the_probability_of_any_exceedance_is_bounded_by_the_sum() -> None:
    """Each cleared point adds epsilon times its exceeding aircraft; all of them if rare."""
    recipe = ClearanceRecipe(epsilon=0.1)
    about = (0.1, (0.5, 0.7, 0.9), 9.1, ())

    def clearing(p_value: float | None, share: float, *, cleared: bool = True) -> Clearing:
        return Clearing(cleared, p_value, *about, 210, 1_000, recipe, ("50%",), share)

    campaign = planned()
    assert campaign.exceeding_at_most == 0.0
    campaign = campaign.changed(0, "complete", "Bob", clearing=clearing(None, 0.004), flown=FLOWN)
    campaign = campaign.changed(1, "complete", "Bob", clearing=clearing(0.02, 0.3), flown=FLOWN)
    campaign = campaign.changed(2, "hold", "Bob", clearing=clearing(0.5, 0.6, cleared=False))
    rare, often = (float(beta.ppf(0.95, k + 1, 1_000 - k)) for k in (4, 300))
    assert 0.004 < rare < 0.01
    assert campaign.exceeding_at_most == pytest.approx(rare + 0.1 * often)
    (first, _, _) = (point.clearing for point in campaign.points)
    assert first
    assert "(at most 0.92 %, 95 % confidence)" in clearing_in_words(first)


@pytest.mark.parametrize(
    ("p_value", "error", "words", "is_close"),
    [
        (0.09, 0.012, "p-value 0.09 ± 0.01, cleared up to 0.05: ", False),
        (0.045, 0.006, "p-value 0.045 ± 0.006, cleared up to 0.05, close", True),
        (0.07, None, "p-value 0.07, cleared up to 0.05: ", False),
    ],
)
def test_a_clearance_gives_the_error_of_its_p_value(
    p_value: float, error: float | None, words: str, is_close: bool
) -> None:
    """Without one, as in files of earlier versions, it is left out."""
    about = (0.05, (0.5, 0.7, 0.9), 9.1, (), 210, 1_000, ClearanceRecipe(), ("50%",), 0.3)
    clearing = Clearing(p_value <= 0.05, p_value, *about, error)
    assert clearing_in_words(clearing).startswith(words)
    assert clearing.is_close == is_close


def test_amplitudes_build_up_within_the_actuator_limits() -> None:
    maneuver = TEST.maneuver.with_peak(-9.63)
    left = build_up(
        "c", Condition("", replace(TEST, maneuver=maneuver)), (0.5, 1.0), ClearanceRecipe()
    )
    assert [point.peak_deg for point in left.points] == [pytest.approx(-4.815), -9.63]
    law = TEST.control_law
    stops = replace(law, actuator=replace(law.actuator, position_limit_deg=9.0))
    with pytest.raises(CampaignError, match="goes to 9 deg at most"):
        build_up(
            "c", Condition("", replace(TEST, control_law=stops)), (0.5, 1.0), ClearanceRecipe()
        )


def test_clearing_a_point_after_an_aborted_first_one_needs_a_reason() -> None:
    campaign = planned().aborted("Bob", "N_y exceeded, broke off")
    with pytest.raises(CampaignError, match=r"50% aborted.*give the reason"):
        campaign.confirmed("Ann")
    cleared = campaign.confirmed("Ann", "gust, not the point")
    assert cleared.next.point.state == "cleared"
    with pytest.raises(CampaignError, match="is already cleared"):
        cleared.confirmed("Ann")


def test_a_point_aborted_in_flight_reports_the_limit_reached() -> None:
    """It is not a step to compute from, but its exceedance counts."""
    campaign = planned().completed(FLOWN, "Bob")
    part = FlownPoint("gust.csv, all of it", (), 1.2, "Ny at 7.00 s")
    campaign = campaign.aborted("Bob", "broke off", part)
    point = campaign.points[1]
    assert point.events[-1].words == (
        "broke off; gust.csv, all of it: reached 120% of a limit, EXCEEDED Ny at 7.00 s"
    )
    assert point.failed
    assert campaign.last_flown("") == point
    assert [point.name for point in campaign.flown("")] == ["50%"]
    assert planned().aborted("Bob", "weather").points[0].flown is None


def test_a_bound_is_rounded_up() -> None:
    assert [percent_at_most(share) for share in (0.0, 0.00015, 0.0002, 0.05)] == [
        "0.00 %",
        "0.02 %",
        "0.02 %",
        "5.00 %",
    ]
