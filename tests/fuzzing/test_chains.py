"""Chains of calls, from create to delete; every response must match the document."""

from typing import Any

import pytest
from hypothesis import Phase, seed, settings
from schemathesis import checks

from tests.app.test_openapi import CALLS, CHECKS, described, known, session
from tests.support.patience import PATIENCE
from tests.support.recorded import csv_of

__all__ = ["known", "session"]

RAW = ("text/csv", "application/octet-stream")
"""What a file is sent as; in a form it stays as drawn."""
GROUPS = ["datasets", "flights", "jobs", "monitors", "recordings|scorings|markers"]
"""Tags whose operations are chained."""
SEEDS = 16
"""Of two chains each: the simplest, and a drawn one."""
EACH = settings(
    CALLS,
    derandomize=False,
    database=None,
    phases=[Phase.generate],
    max_examples=2,
    stateful_step_count=12,
)


def available(ctx: Any, response: Any, case: Any) -> bool | None:
    """What was created is there; what a job will make, not yet."""
    parent = ctx.internals.find_parent(case_id=case.id)
    if parent and ctx.internals.find_response(case_id=parent.id).status_code == 202:
        return None
    return checks.ensure_resource_availability(ctx, response, case)


CHAINED = [
    *CHECKS,
    checks.negative_data_rejection,
    checks.missing_required_header,
    checks.use_after_free,
    available,
]


def named(body: dict[str, Any], ids: dict[str, Any]) -> dict[str, Any]:
    """A drawn body, naming what is stored."""
    there = {key: ids[f"{key}_id"] for key in ("monitor", "dataset", "recording", "scoring")}
    body = body | {key: there[key] for key in set(there) & set(body) if isinstance(body[key], str)}
    if source := body.get("source"):
        if source["kind"] == "simulated":  # no stored dataset has a recipe to simulate by
            source = {"kind": "recording", "recording": "", "scoring": ""}
        body |= {"source": named(source, ids), "epsilon": None}
    return body


@pytest.fixture(scope="module")
def files(session, known, flights) -> dict[str, bytes]:
    """A file that each upload takes."""
    portable = session.get(f"/api/v1/monitors/{known[1]['monitor_id']}/file").content
    recording = csv_of(flights[0])
    return {"/api/v1/recordings": recording, "/api/v1/monitors": portable}


@pytest.mark.fuzz
@pytest.mark.parametrize("group", GROUPS)
def test_every_response_in_a_chain_of_calls_is_documented(group, session, known, files):
    ids = known[1]
    schema = described().include(tag_regex=f"^({group})$").exclude(path_regex="/events$")
    created = []

    class Chain(schema.as_state_machine()):
        def get_call_kwargs(self, case: Any) -> dict[str, Any]:
            sent = {"app": session.app, "session": session, "timeout": PATIENCE}
            is_file = case.media_type in RAW and case.meta.generation.mode.is_positive
            # rollouts stay as drawn: a job reads them, and its dataset would come at any time
            return sent | {"data": files[case.path]} if is_file and case.path in files else sent

        def before_call(self, case: Any) -> None:
            """A call that may be accepted names what is there, and sends a file that is one."""
            if case.meta.generation.mode.is_positive:
                if isinstance(case.body, dict) and case.media_type == "application/json":
                    case.body = named(case.body, ids)
                if case.method != "DELETE":
                    linked = case._override.path_parameters if case._override else {}
                    free = set(case.path_parameters) & set(ids) - set(linked)
                    case.path_parameters |= {key: ids[key] for key in free}
            super().before_call(case)

        def validate_response(self, response: Any, case: Any, **_: Any) -> None:
            if case.method == "POST" and response.status_code in (201, 202):
                created.append(case.operation.path)
            case.validate_response(response, checks=CHAINED)

        def teardown(self) -> None:
            """End flights and cancel jobs, of which there may be few."""
            for flight in session.get("/api/v1/flights").json():
                if flight["progress"] == "running":
                    session.post(f"/api/v1/flights/{flight['id']}/end")
            for job in session.get("/api/v1/jobs").json():
                if job["status"] == "queued":
                    session.post(f"/api/v1/jobs/{job['id']}/cancel")
            super().teardown()

    for number in range(SEEDS):  # each alone, for what is drawn depends on what is stored
        seed(number)(Chain).run(settings=EACH)
    assert created or group == "jobs"  # which others create
