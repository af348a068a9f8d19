"""Live telemetry: from samples as they arrive to what is said of them, by what had come so far."""
