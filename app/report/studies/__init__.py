"""What studies found, in words, tables and figures: methods, leads, campaigns."""
