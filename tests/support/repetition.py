"""How often a law is tried: a part of the cases by `make test`, all by `make fuzz`."""

import os

IS_CAMPAIGN = bool(os.environ.get("FOREWARN_CAMPAIGN"))
LEAST = 10


def examples(n: int) -> int:
    """Cases that Hypothesis draws where the campaign draws n."""
    return n if IS_CAMPAIGN else min(n, max(LEAST, n // 5))
