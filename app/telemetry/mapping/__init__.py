"""Which signal of a file is which channel: in what unit, with what sign, or derived from what."""
