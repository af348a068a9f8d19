"""The readers of file formats, one module a format, each run in a process of its own."""
