"""The batches that a live flight has received, to recognise repetitions."""

from array import array

KEPT = 200_000
"""Newest batches remembered, if the source numbers them consecutively."""
NONE = -1


class KnownBatches:
    """Digests of batches by sequence, 16 bytes each: a tenth of what objects would take."""

    def __init__(self, kept: int = KEPT) -> None:
        self._kept = kept
        self._sequences, self._digests = array("q"), array("Q")

    def note(self, sequence: int, digest: int) -> None:
        """Remember a batch, in place of the one `kept` numbers before. digest: below 2**64."""
        slot = sequence % self._kept
        if (lacking := slot + 1 - len(self._sequences)) > 0:
            self._sequences.extend([NONE] * lacking)
            self._digests.extend([0] * lacking)
        self._sequences[slot], self._digests[slot] = sequence, digest

    def digest(self, sequence: int) -> int | None:
        """Digest of a batch; None if it is unknown or too old."""
        slot = sequence % self._kept
        is_known = slot < len(self._sequences) and self._sequences[slot] == sequence
        return self._digests[slot] if is_known else None
