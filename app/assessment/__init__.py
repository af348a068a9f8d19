"""Score a recording: detect manoeuvres, assess them, check validity, give a verdict on each.

Start at `score`: it returns one table of samples and one verdict for each manoeuvre.
"""

from app.assessment.recorded import MissingChannels
from app.assessment.score import score, score_at_each
from app.assessment.scored import BETWEEN, ScoredManoeuvre, ScoredRecording, sample_type
from app.assessment.segments import Interval, ScoringRecipe, manoeuvres_in

__all__ = [
    "BETWEEN",
    "Interval",
    "MissingChannels",
    "ScoredManoeuvre",
    "ScoredRecording",
    "ScoringRecipe",
    "manoeuvres_in",
    "sample_type",
    "score",
    "score_at_each",
]
