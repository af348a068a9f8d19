"""Evaluation: what fresh rollouts say of a monitor, of its method, and of a planned test."""

THRESHOLD = "threshold on today's value"
"""Name, in files, of the rule beside which methods are tried."""
IN_WORDS = "threshold on the current value"
