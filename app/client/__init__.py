"""Send telemetry to a Forewarn server from another program."""

from app.client.client import LiveClient
from app.client.outbox import PushFailed

__all__ = ["LiveClient", "PushFailed"]
