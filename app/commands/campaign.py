"""`forewarn campaign`: plan a build-up, then clear, fly and identify its points one by one."""

import argparse
from collections.abc import Callable
from pathlib import Path

from app import json_codec
from app.assessment.segments import Interval
from app.campaigns.campaign import USUAL_STEPS, Campaign, load, points_at
from app.campaigns.clearing import checklist, clear_next, identification_plain, identified, updated
from app.campaigns.flying import aborted_flight, flown_point
from app.campaigns.point import CampaignError, Condition, FlownPoint, Point, percent_at_most
from app.commands.options.fields import add_fields, given_fields
from app.commands.options.option import add_json, add_output, add_scheduler, option
from app.commands.options.recipe import add_recipe_options, plain_recipe
from app.commands.output.results import check_file, print_result, progress_bar
from app.commands.output.scores import read_mapping
from app.jobs.cluster import executor_at
from app.recipes.recipes import to_plain
from app.recordings.mapped_recording import MappedRecording
from app.telemetry.mapping.proposal import propose
from app.telemetry.reading import columns_of
from core.clearance.clearance import ClearanceRecipe
from core.clearance.identification import Identification
from core.planned_test.planned_test import ManeuverTest
from core.whole_file import write_whole


def add(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    every = {name: actions.add_parser(name, help=text) for name, (text, _) in ACTIONS.items()}
    for action in every.values():
        option(action, "file CAMPAIGN.json", "the campaign", type=Path)
    for name in ("clear", "confirm", "smaller", "hold", "abort", "fly"):
        option(every[name], "--by NAME", "who decides", required=True)
    for name in ("confirm", "smaller", "hold", "abort"):
        option(every[name], "--why TEXT", "reason", default="")
    option(every["fly"], "recording RECORDING", "telemetry in any known format", type=Path)
    option(every["abort"], "--recording FILE", "recording of a point aborted in flight", type=Path)
    for name in ("fly", "abort"):
        option(every[name], "--start START", "start of the manoeuvre with its trim [s]", type=float)
        option(every[name], "--end END", "end of the manoeuvre [s]", type=float)
        option(every[name], "--mapping FILE", "mapping, as `score` writes it", type=Path)
    text = "the point's monitor, trained afterwards, is a part of the clearance"
    option(every["clear"], "--with-monitor", text)
    add_scheduler(every["clear"])
    condition = "name of the flight condition"
    _add_plan(every["new"])
    _add_points(every["add"])
    option(every["new"], "--condition NAME", condition, default="")
    option(every["add"], "--condition NAME", condition, required=True)
    add_output(every["report"], "HTML", "file to write; named after the campaign if absent")
    add_output(every["recipe"], "FILE", "file to write; named after the campaign if absent")
    for name in ACTIONS.keys() - {"report", "recipe"}:
        add_json(every[name])


def _add_points(parser: argparse.ArgumentParser) -> None:
    add_recipe_options(parser)
    option(
        parser,
        "--steps SHARE",
        "shares of the planned amplitude, increasing; "
        f"{' '.join(f'{step:g}' for step in USUAL_STEPS)} if absent",
        type=float,
        nargs="+",
        default=USUAL_STEPS,
    )
    option(
        parser,
        "--passes-below NUMBER",
        "share of a limit to stay below; 1 if absent",
        type=float,
        default=1.0,
    )
    option(parser, "--criteria TEXT", "other pass criteria of each point", default="")


def _add_plan(new: argparse.ArgumentParser) -> None:
    _add_points(new)
    option(new, "--name NAME", "name of the campaign", required=True)
    add_fields(new, ClearanceRecipe, "epsilon", "guarantee", prefix="clearance_")
    add_fields(new, ClearanceRecipe, "n_exceeding", "n_aircraft")


def run(options: argparse.Namespace) -> int:
    return ACTIONS[options.action][1](options)


def _new(options: argparse.Namespace) -> int:
    check_file(options.file)
    if options.file.exists():
        raise CampaignError(f"{options.file} exists: give another file for a new campaign")
    test: ManeuverTest = plain_recipe(options)["dataset"]
    promised = given_fields(options, ClearanceRecipe, "epsilon", "guarantee", prefix="clearance_")
    sizes = given_fields(options, ClearanceRecipe, "n_exceeding", "n_aircraft")
    recipe = ClearanceRecipe(**promised, **sizes)
    condition = Condition(options.condition, test)
    points = points_at(condition, options.steps, options.passes_below, options.criteria)
    campaign = Campaign(options.name, (condition,), points, recipe)
    return _done(options, None, campaign, lines(campaign))


def _add(options: argparse.Namespace) -> int:
    before = load(options.file)
    if options.aircraft is None and options.recipe is None:
        raise CampaignError(
            "no aircraft was given: give --aircraft for that flight condition, or --recipe"
        )
    test: ManeuverTest = plain_recipe(options)["dataset"]
    condition = Condition(options.condition, test)
    campaign = before.extended(condition, options.steps, options.passes_below, options.criteria)
    return _done(options, before, campaign, lines(campaign))


def _show(options: argparse.Namespace) -> int:
    campaign = load(options.file)
    print_result(options, "\n".join(lines(campaign)), to_plain(campaign))
    return 0


def _clear(options: argparse.Namespace) -> int:
    before = load(options.file)
    with (
        executor_at(options.scheduler) as executor,
        progress_bar("simulated aircraft") as progress,
    ):
        campaign = clear_next(
            before, options.by, progress, executor, monitored=options.with_monitor
        )
    point = campaign.next.point
    text = [f"{point.name}: {point.state}: {point.events[-1].words}"]
    if point.state == "on condition":
        text += [
            "confirm before the flight:",
            *(f"  - {item}" for item in checklist(campaign, point)),
        ]
    if point.clearing and point.clearing.amplitude_deg is not None:
        text.append(_recommended(point))
    if step := campaign.smaller_step:
        text.append(
            f"proposed: fly {step.name} ({step.peak_deg:.3g} deg) first, with `forewarn campaign "
            "smaller`; its clearance is computed as for any point"
        )
    return _done(options, before, campaign, text, ok=point.state == "on condition")


def _recommended(point: Point) -> str:
    clearing = point.clearing
    assert clearing is not None
    return (
        f"largest recommended amplitude {clearing.amplitude_deg:.3g} deg (this point: "
        f"{point.peak_deg:.3g}): at this amplitude, at most a share {clearing.recipe.epsilon:g} of "
        "flights exceeds a limit; this is a separate promise"
    )


def _decide(options: argparse.Namespace) -> int:
    """Confirm or hold the next point, or plan the smaller step before it."""
    before = load(options.file)
    after = DECISIONS[options.action](before, options.by, options.why)
    return _decided(options, before, after, before.next.number)


DECISIONS = {
    "confirm": Campaign.confirmed,
    "smaller": Campaign.with_smaller_step,
    "hold": Campaign.on_hold,
}


def _abort(options: argparse.Namespace) -> int:
    before = load(options.file)
    if options.recording is None and (options.start, options.end) != (None, None):
        raise CampaignError(
            "--start and --end need a recording: give it with --recording, or leave them out"
        )
    flown = _cut(aborted_flight, options, before) if options.recording else None
    after = before.aborted(options.by, options.why, flown)
    return _decided(options, before, after, before.next.number)


def _fly(options: argparse.Namespace) -> int:
    before = load(options.file)
    after = before.completed(_cut(flown_point, options, before), options.by)
    return _decided(options, before, after, before.next.number)


def _decided(options: argparse.Namespace, before: Campaign, after: Campaign, number: int) -> int:
    """Save what was decided of a point, and print it."""
    point = after.points[number]
    text = f"{point.name}: {point.state}: {point.events[-1].words}".rstrip(": ")
    return _done(options, before, after, [text])


def _cut(
    cut: Callable[..., FlownPoint], options: argparse.Namespace, campaign: Campaign
) -> FlownPoint:
    """The next point, cut from the given recording."""
    point = campaign.next.point
    if (options.start is None) != (options.end is None):
        raise CampaignError("one of --start and --end was given: give both, or neither")
    interval = None if options.start is None else Interval(options.start, options.end, point.name)
    mapping = None if options.mapping is None else read_mapping(options.mapping)
    with columns_of(options.recording) as columns:
        test = campaign.test_of(point)
        mapping = mapping or propose(columns, dictionary=test.dictionary).mapping
        recorded = MappedRecording.of(columns, mapping).scorable()
        return cut(options.recording.name, recorded, test, interval)


def _identify(options: argparse.Namespace) -> int:
    campaign = load(options.file)
    flown = [each for each in campaign.conditions if campaign.flown(each.name)]
    if not flown:
        raise CampaignError("no point is complete: fly one first, then identify the aircraft")
    results = [identified(campaign, condition.name) for condition in flown]
    text = "\n".join(line for result in results for line in identification_lines(result))
    print_result(options, text, [identification_plain(result) for result in results])
    return 0


def _recipe(options: argparse.Namespace) -> int:
    campaign = load(options.file)
    out = check_file(options.out or options.file.with_suffix(".recipe.json"))
    point = campaign.next.point
    plain = {"dataset": to_plain(updated(campaign, point))}
    if point.clearing and (monitor := point.clearing.monitor):
        plain["monitor"] = to_plain(monitor)
    write_whole(out, json_codec.encode(plain))
    aircraft = "as planned"
    if campaign.condition_of(point).is_identifiable:
        steps = ", ".join(step.name for step in campaign.flown(point.condition))
        aircraft = f"as identified from {steps}"
    text = (
        f"written: {out}, for {point.name} with the aircraft {aircraft}; "
        f"train with `forewarn train --recipe {out}`"
    )
    print_result(options, text, {"file": str(out)} | plain)
    return 0


def _report(options: argparse.Namespace) -> int:
    from app.report.campaign import campaign_page  # slow to import, only needed here

    out = check_file(options.out or options.file.with_suffix(".html"))
    write_whole(out, campaign_page(load(options.file)).encode())
    print_result(options, f"written: {out}", {"file": str(out)})
    return 0


ACTIONS = {
    "new": ("plan a campaign; write its file", _new),
    "add": ("plan more points, at another flight condition", _add),
    "show": ("list the points with predicted and flown results", _show),
    "clear": ("compute whether the next point may be flown", _clear),
    "confirm": ("confirm the checklist and clear the next point", _decide),
    "smaller": ("plan the proposed smaller step before the next point", _decide),
    "hold": ("hold the next point", _decide),
    "abort": ("cancel the next point, or record its aborted flight", _abort),
    "fly": ("attach the recording of the next point and complete it", _fly),
    "identify": ("identify the aircraft from complete points", _identify),
    "recipe": ("write a recipe to train the next point's monitor", _recipe),
    "report": ("write the next point's card and all results as HTML", _report),
}


def _done(
    options: argparse.Namespace,
    before: Campaign | None,
    campaign: Campaign,
    text: list[str],
    *,
    ok: bool = True,
) -> int:
    """Save the campaign, then print. Returns 1 where the point may not be flown.

    CampaignError if the file was changed after it was read; the changed file stays.
    """
    if before is not None and load(options.file) != before:
        raise CampaignError(
            f"{options.file} was changed during this command, so nothing was written: show the "
            "campaign, then decide"
        )
    campaign.save(options.file)
    print_result(options, "\n".join([*text, f"written: {options.file}"]), to_plain(campaign))
    return 0 if ok else 1


def lines(campaign: Campaign) -> list[str]:
    """A campaign as a table with one line for each point, and the next point's last event."""
    aircraft = [condition.aircraft for condition in campaign.conditions]
    width = max(10, *(len(point.name) for point in campaign.points))
    rows = [
        f"{campaign.name}: {'; '.join(dict.fromkeys(aircraft))}",
        f"  {'point':{width}} {'amplitude':>10}  {'state':14} {'predicted':>20} {'reached':>8}",
        *(_row(point, width) for point in campaign.points),
    ]
    if any(point.clearing for point in campaign.points):
        rows.append(
            "probability that any point cleared by computation exceeds a limit"
            f"{' without an alert in time' if campaign.is_monitored else ''}: at most "
            + percent_at_most(campaign.exceeding_at_most)
        )
    if not campaign.is_over:
        point = campaign.next.point
        last = point.events[-1] if point.events else None
        rows.append(
            f"next: {point.name}" + (f", {last.by} at {last.at}: {last.words}" if last else "")
        )
    return rows


def _row(point: Point, width: int) -> str:
    predicted = reached = ""
    if point.clearing:
        low, middle, high = point.clearing.reached
        predicted = f"{middle:.0%} ({low:.0%} to {high:.0%})"
    if point.flown:
        reached = f"{point.flown.reached:.0%}{'!' if point.failed else ''}"
    return (
        f"  {point.name:{width}} {point.peak_deg:6.3g} deg  {point.state:14} {predicted:>20} "
        f"{reached:>8}"
    )


def identification_lines(result: Identification) -> list[str]:
    """Each parameter before and after, and R2 of each segment's channels."""
    rows = [
        f"identified from {', '.join(result.sources)}",
        f"  {'':8} {'before':>20} {'after':>20}   remaining sigma",
    ]
    for k, name in enumerate(result.names):
        before, after = result.prior_sigma[k], result.sigma[k]
        left = f"{after / before:.0%}" if before else "certain"
        mark = ", not determined" if name in result.undetermined else ""
        rows.append(
            f"  {name:8} {result.prior_mean[k]:>10.4g} ± {before:<7.2g} "
            f"{result.mean[k]:>10.4g} ± {after:<7.2g}   {left}{mark}"
        )
    for source, r2 in zip(result.sources, result.r2, strict=True):
        explained = ", ".join(
            f"{key} {share:.3f}" for key, share in zip(("beta", "p", "r", "N_y"), r2, strict=True)
        )
        rows.append(f"R2 of {source}: {explained}")
    rows.append(
        f"mean squared distance from the prior: {result.distance:.2f}; about 1 or less is expected"
    )
    return rows
