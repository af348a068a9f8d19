"""Readers of file formats, one module per format; each file is read in its own process."""
