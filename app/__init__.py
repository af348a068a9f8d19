"""The application around the numerics: command line, files, figures."""
