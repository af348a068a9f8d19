"""Scoring recordings: manoeuvres, assessments, whether the monitor applies, and a verdict on each.

`score` is the way in; what it returns is one table of samples and a verdict a manoeuvre.
"""

from app.scoring.ready import MissingChannels
from app.scoring.recipe import Interval, ScoringRecipe
from app.scoring.score import manoeuvres_in, score, score_at_each
from app.scoring.scored import BETWEEN, SAMPLE, ScoredManoeuvre, ScoredRecording

__all__ = [
    "BETWEEN",
    "SAMPLE",
    "Interval",
    "MissingChannels",
    "ScoredManoeuvre",
    "ScoredRecording",
    "ScoringRecipe",
    "manoeuvres_in",
    "score",
    "score_at_each",
]
