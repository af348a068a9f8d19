"""Evaluation of a monitor, of its method and of a planned test, on fresh rollouts."""

THRESHOLD = "threshold on today's value"
"""Name, in files, of the rule with which methods are compared."""
IN_WORDS = "threshold on the current value"
