"""Which batches of a live flight came, so that one that comes again is known."""

from array import array

KEPT = 200_000
"""Newest batches that are known, of a source that numbers them one up."""
NONE = -1


class KnownBatches:
    """Digests of batches by their sequence, in 16 bytes each: objects would take ten times that."""

    def __init__(self, kept: int = KEPT) -> None:
        self._kept = kept
        self._sequences, self._digests = array("q"), array("Q")

    def note(self, sequence: int, digest: int) -> None:
        """Remember a batch; the one `kept` numbers before it goes. digest: below 2**64."""
        slot = sequence % self._kept
        if (lacking := slot + 1 - len(self._sequences)) > 0:
            self._sequences.extend([NONE] * lacking)
            self._digests.extend([0] * lacking)
        self._sequences[slot], self._digests[slot] = sequence, digest

    def digest(self, sequence: int) -> int | None:
        """Of the batch of this number; None where it did not come, or long ago."""
        slot = sequence % self._kept
        is_known = slot < len(self._sequences) and self._sequences[slot] == sequence
        return self._digests[slot] if is_known else None
