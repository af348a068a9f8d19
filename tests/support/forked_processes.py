"""Processes that are forked from one with the imports done.

All that start some share this context: only one list of modules is imported, the last that is set.
"""

import multiprocessing

PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload(
    [
        "tests.faults.server",
        "tests.support.store_writer",
        # what a server imports as it starts
        "alembic.command",
        "sqlalchemy.dialects.sqlite.pysqlite",
        "uvloop",
    ]
)
