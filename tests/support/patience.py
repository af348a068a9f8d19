"""Time limit for waits in tests, long enough for a busy machine."""

PATIENCE = 120
"""[s] Who takes longer hangs; the first call of a machine compiles kernels."""
