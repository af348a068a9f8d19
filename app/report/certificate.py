"""The certificate of a monitor as a printable page: its test on fresh flights."""

import json
from datetime import UTC, datetime

from app.assessment.wording import PROMISED, alerts_above
from app.recipes import labels
from app.recipes.recipes import to_plain
from app.report.facts import limited
from app.report.page import TEMPLATES
from core import __version__
from core.channels import LATERAL
from core.dataset import FLOWN
from core.evaluation.certificate import Share, calibrated_on, certificate, miss_rate_of, warnings_of
from core.evaluation.method_choice import kept_in_words
from core.evaluation.rates import clopper_pearson
from core.limits.limits import IntervalLimits, Limits
from core.monitor import Monitor
from core.monitor.calibration import threshold
from core.monitor.combination import members_of


def certificate_page(monitor: Monitor, name: str, digest: str, created: str = "") -> str:
    """Render the certificate as self-contained HTML.

    digest: SHA-256 of the monitor's file.   created: when it was trained, UTC in ISO 8601.
    ValueError for a monitor that was not tested on fresh flights.
    """
    evaluation, epsilon = monitor.evaluation, monitor.recipe.epsilon
    summary = certificate(evaluation, epsilon)
    if evaluation is None or summary is None:
        raise ValueError(
            f"the monitor {name} was not tested on fresh flights, so there is nothing to certify: "
            "train it with test flights"
        )
    prevention = evaluation.get("prevention")
    tried = evaluation.get("methods", [])
    dataset = {key: value for key, value in monitor.dataset_recipe.items() if key != FLOWN}
    magnitudes = monitor.specification if isinstance(monitor.specification, Limits) else None
    return TEMPLATES.get_template("certificate.html").render(
        name=name,
        digest=digest,
        created=created,
        monitor=monitor,
        recipe=to_plain(monitor.recipe),
        whole_recipe=json.dumps(
            to_plain(monitor.recipe) | {"dataset": dataset},
            indent=1,
            ensure_ascii=False,
        ),
        members=[(member, to_plain(member.recipe)) for member in members_of(monitor)],
        written=datetime.now(UTC).isoformat(),
        alerts_above=alerts_above(epsilon, monitor.alert_above(), monitor.recipe.guarantee),
        promised=PROMISED[monitor.recipe.guarantee],
        limits=limited(LATERAL, magnitudes),
        intervals=_intervals(monitor),
        summary=summary,
        evaluation=evaluation,
        flights=evaluation.get("flights", {}),
        simulator=evaluation.get("simulator"),
        flown=evaluation.get("flown", []),
        mixture=calibrated_on(evaluation),
        methods=[(labels.TRIED.get(method["name"], method["name"]), method) for method in tried],
        kept=kept_in_words(epsilon, tried[0]["n_unsafe"]) if tried else "",
        interval_of=lambda k, n: "{:.1%} to {:.1%}".format(*clopper_pearson(k, n)),
        false_alarm=Share(evaluation["at_epsilon"]["false_alerts"], evaluation["n_safe"])
        if evaluation["n_safe"]
        else None,
        leads=evaluation.get("leads"),
        warnings=warnings_of(evaluation, epsilon),
        prevention=prevention,
        stopped=clopper_pearson(prevention["stopped"], prevention["n_safe"]).tolist()
        if prevention
        else None,
        robustness=list(evaluation.get("robustness", {}).values()),
        miss_rate_of=miss_rate_of,
        groups=evaluation.get("groups"),
        thresholds=_thresholds(monitor),
        version=__version__,
    )


def _intervals(monitor: Monitor) -> list[str]:
    """Limits that are intervals, or the label, in words; empty for magnitudes and unknown ones."""
    specification = monitor.specification
    if isinstance(specification, str):
        return [f"known only by the {specification}"]
    if not isinstance(specification, IntervalLimits):
        return []
    by_key = monitor.dictionary.by_key
    return [
        f"{by_key[key].label} {by_key[key].symbol} "
        + " and ".join(
            f"{word} {by_key[key].read(end)}"
            for word, end in (("above", interval.low), ("below", interval.high))
            if end is not None
        )
        for key, interval in specification.intervals.items()
    ]


def _thresholds(monitor: Monitor) -> list[tuple[str, float]]:
    if monitor.groups is None:
        return []
    of_groups = zip(monitor.groups.rule.names, monitor.groups.alphas, strict=True)
    return [(name, threshold(monitor.alert_above(), alphas)) for name, alphas in of_groups]
