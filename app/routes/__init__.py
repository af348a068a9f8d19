"""REST and WebSocket routes, one file a resource: load, call, reply."""
