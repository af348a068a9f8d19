"""Collect rollouts to train on: see `core.planned_test.collection`."""

from core.planned_test.collection import *  # noqa: F403
