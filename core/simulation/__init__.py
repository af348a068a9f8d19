"""From an uncertain aircraft and a planned manoeuvre to batches of closed-loop rollouts."""
