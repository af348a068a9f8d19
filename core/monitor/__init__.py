"""Monitors: train on labelled trajectories, assess flights, save and load as one file."""

from core.monitor.assessment import Assessment, Assessments, State
from core.monitor.combination import combine
from core.monitor.file.loading import load
from core.monitor.monitor import Monitor
from core.monitor.recipe import MonitorRecipe
from core.monitor.training import train

__all__ = [
    "Assessment",
    "Assessments",
    "Monitor",
    "MonitorRecipe",
    "State",
    "combine",
    "load",
    "train",
]
