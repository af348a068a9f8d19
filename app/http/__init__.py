"""What every HTTP request passes: bounds, security, sessions, idempotency, errors."""
