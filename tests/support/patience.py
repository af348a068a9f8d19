"""How long a test waits for what must come: no test fails by the clock of a busy machine."""

PATIENCE = 120
"""[s] Who takes longer hangs; the first call of a machine compiles kernels."""
