"""What commands share that print: progress, results, tables, lines."""
