"""Many calls of every operation with edge cases; every response must match the document.

The file is not named test_*, since collecting it takes 20 s; `make fuzz` runs it by name.
"""

import pytest
from hypothesis import settings

from tests.app.test_openapi import CALLS, answered, described, known, session

__all__ = ["known", "session"]
schema = described()


@pytest.mark.fuzz
@schema.parametrize()
@settings(CALLS, max_examples=12)
def test_every_response_to_many_calls_is_documented(case, session, known):
    answered(case, session, known[1])
