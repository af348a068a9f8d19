"""Evaluation: what fresh rollouts say of a monitor, of its method, and of a planned test."""
