"""All that is compiled: kernels and the lanes they compute on; the modules around call them.

Kernels know arrays and numbers only. Their compiled code, constants included, is stored on disk for
as long as this folder stays the same, so they take no constant from elsewhere.
"""

N_CHANNELS = 6
"""Length of a sample y; core.channels names its entries."""
