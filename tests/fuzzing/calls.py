"""Many calls of every operation, its edge cases among them: every answer is as described.

Not named as a test, since only collecting it takes 20 s: `make fuzz` names the file.
"""

import pytest
from hypothesis import settings

from tests.app.test_openapi import CALLS, answered, described, known, session

__all__ = ["known", "session"]
schema = described()


@pytest.mark.fuzz
@schema.parametrize()
@settings(CALLS, max_examples=12)
def test_every_answer_to_many_calls_is_one_that_the_document_names(case, session, known):
    answered(case, session, known[1])
