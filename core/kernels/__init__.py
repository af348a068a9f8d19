"""Compiled kernels, the SIMD lanes they use, and the modules that call them.

Kernels know only arrays and numbers. Their compiled code, including constants, is cached on disk
until a file in this folder changes, so they must not use constants from elsewhere.

A literal argument, such as 0 or True, compiles a kernel again: write np.int64(0), np.bool_(True).
"""

N_CHANNELS = 6
"""Length of a sample y; core.channels names the entries."""
