"""All that is compiled: kernels and the lanes they compute on; the modules around call them."""
