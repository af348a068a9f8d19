"""Whether a record holds what a journal gives."""

from app.flights.shown_flight import ShownFlight
from app.store.assessments import StoredAssessments


def is_as_shown(flight: ShownFlight, stored: StoredAssessments) -> bool:
    """Whether a record equals a flight bit for bit, as far as it goes."""
    if len(stored) and stored.seq[-1] >= len(flight.samples):
        return False
    samples, names = flight.samples[stored.seq], ("t", "y", "p_value", "alert", "state", "y_hat")
    return tuple(flight.reasons[k] for k in stored.seq) == stored.reasons and all(
        samples[name].tobytes() == getattr(stored, name).tobytes() for name in names
    )
