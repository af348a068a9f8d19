"""Reports as self-contained HTML files that print well."""
