"""Scoring recordings: manoeuvres, assessments, the right to speak, and a verdict on each.

`score` is the way in; what it returns is one table of samples and a verdict a manoeuvre.
"""

from app.scoring.order import ScoringOrder, Span
from app.scoring.ready import MissingChannels
from app.scoring.score import manoeuvres_in, score, score_at_each
from app.scoring.scored import BETWEEN, SAMPLE, ScoredRecording, ScoredStretch

__all__ = [
    "BETWEEN",
    "SAMPLE",
    "MissingChannels",
    "ScoredRecording",
    "ScoredStretch",
    "ScoringOrder",
    "Span",
    "manoeuvres_in",
    "score",
    "score_at_each",
]
