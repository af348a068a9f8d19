"""Long work in worker threads: its requests, its kinds, and the queue."""
