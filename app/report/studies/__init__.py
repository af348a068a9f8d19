"""Results of studies in words, tables and figures: methods, leads, campaigns."""
