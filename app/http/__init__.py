"""Layers around every HTTP request: limits, security, sessions, idempotency, errors."""
