"""The planned test: its recipe, the rollouts collected for it, and a suggested amplitude."""
