"""Long work off the event loop: what may be asked for, and how it is done."""
