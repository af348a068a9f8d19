"""Output that commands share: progress, results, scores."""
