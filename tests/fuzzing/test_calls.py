"""Many calls of every operation with edge cases; every response must match the document."""

import pytest
from hypothesis import settings
from schemathesis.core.result import Ok
from schemathesis.pytest.lazy import get_all_tests

from tests.app.test_openapi import CALLS, answered, described, known, session
from tests.support.api import document

__all__ = ["known", "session"]
ENDLESS = "/api/v1/events"
"""Its response, a stream, never ends."""
OPERATIONS = [
    (method, path)
    for path, item in document()["paths"].items()
    for method in item
    if path != ENDLESS
]


@settings(CALLS, max_examples=12)
def call(case, session, known):
    answered(case, session, known[1])


@pytest.mark.fuzz
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_response_to_many_calls_is_documented(method, path, session, known):
    """Its cases are built here: each process of a test run would take 20 s to collect them all."""
    schema = described().include(method=method.upper(), path=path)
    (made,) = get_all_tests(schema=schema, test_func=call, settings=None, given_kwargs={})
    assert isinstance(made, Ok)
    made.ok()[1](session=session, known=known)
