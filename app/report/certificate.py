"""The certificate of a monitor as a page that prints: what fresh flights said of it."""

import json
from datetime import UTC, datetime

from app.recipes import to_plain
from app.report.page import TEMPLATES
from app.scoring.wording import PROMISED
from core import __version__
from core.channels import CHANNELS
from core.evaluation.certificate import Share, certificate, warnings_of
from core.evaluation.rates import clopper_pearson
from core.monitor import Monitor
from core.monitor.calibration import threshold
from core.monitor.combination import members_of


def certificate_page(monitor: Monitor, name: str, digest: str, created: str = "") -> str:
    """Return the certificate as HTML that needs no other file.

    digest: SHA-256 of the monitor's file.   created: when it was trained, UTC in ISO 8601.
    ValueError for a monitor that was not tested on fresh flights.
    """
    found, epsilon = monitor.evaluation, monitor.recipe.epsilon
    told = certificate(found, epsilon)
    if found is None or told is None:
        raise ValueError(
            f"the monitor {name} was not tested on fresh flights, so there is nothing to certify: "
            "train it with test flights"
        )
    prevention = found.get("prevention")
    limits = [] if monitor.limits is None else zip(CHANNELS, monitor.limits, strict=True)
    return TEMPLATES.get_template("certificate.html").render(
        name=name,
        digest=digest,
        created=created,
        monitor=monitor,
        recipe=to_plain(monitor.recipe),
        whole_recipe=json.dumps(
            to_plain(monitor.recipe) | {"dataset": monitor.dataset_recipe},
            indent=1,
            ensure_ascii=False,
        ),
        members=[(member, to_plain(member.recipe)) for member in members_of(monitor)],
        written=datetime.now(UTC).isoformat(),
        above=monitor.alert_above(),
        promised=PROMISED[monitor.recipe.guarantee],
        limits=[(channel, float(limit)) for channel, limit in limits if limit < float("inf")],
        told=told,
        found=found,
        false_alarm=Share(found["at_epsilon"]["false_alerts"], found["n_safe"])
        if found["n_safe"]
        else None,
        leads=found.get("leads"),
        warnings=warnings_of(found, epsilon),
        prevention=prevention,
        stopped=clopper_pearson(prevention["stopped"], prevention["n_safe"]).tolist()
        if prevention
        else None,
        robustness=list(found.get("robustness", {}).values()),
        groups=found.get("groups"),
        thresholds=_thresholds(monitor),
        version=__version__,
    )


def _thresholds(monitor: Monitor) -> list[tuple[str, float]]:
    """Each group and the highest score at which it alerts; nothing where failures are pooled."""
    if monitor.groups is None:
        return []
    of_groups = zip(monitor.groups.rule.names, monitor.groups.alphas, strict=True)
    return [(name, threshold(monitor.alert_above(), alphas)) for name, alphas in of_groups]
