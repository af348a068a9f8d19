"""Batches that came before are known by their number, the newest of them."""

from app.flights.sources.live import KnownBatches


def test_the_newest_batches_are_known_and_no_other() -> None:
    known = KnownBatches(kept=10)
    for sequence in (*range(25), 2**53):
        assert known.digest(sequence) is None
        known.note(sequence, 2**64 - 1 - sequence)
    newest = {k: known.digest(k) for k in range(30) if known.digest(k) is not None}
    lost = 2**53 % 10
    assert newest == {k: 2**64 - 1 - k for k in range(15, 25) if k % 10 != lost}
    assert known.digest(2**53) == 2**64 - 1 - 2**53
