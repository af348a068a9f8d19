"""Live telemetry: assessments of samples as they arrive, from the samples received so far."""
