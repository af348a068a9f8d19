"""Turn the errors of file format libraries into one kind of error.

For damaged files h5py, scipy, pyarrow and others raise all kinds of exceptions, from KeyError to
their own, and they print and warn.
"""

import errno
import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

from app.telemetry.recording import TelemetryError

NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
LONGEST_REASON = 120


@contextmanager
def library_errors(title: str) -> Iterator[None]:
    """Turn any error of a library into one TelemetryError. title: kind of file.

    Output and warnings are dropped. A missing library and a full disk are not faults of the file;
    their errors pass unchanged.
    """
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    except (TelemetryError, ImportError):
        raise
    except RecursionError as error:
        raise TelemetryError(too_deep(title)) from error
    except MemoryError as error:
        raise TelemetryError(
            f"reading this {title} file needs more memory than available: export only the time "
            "range and signals of this test"
        ) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise
        raise TelemetryError(
            f"the {title} file is damaged or cut short ({_reason(error)}): copy or export it again"
        ) from error


def too_deep(title: str) -> str:
    """Message for groups or structures that are nested too deeply."""
    return (
        f"groups or structures of the {title} file are nested too deeply: export the signals of "
        "this test in a flat table"
    )


def _reason(error: Exception) -> str:
    """First line of the library's message, otherwise the type of the error."""
    message = str(error).strip()
    line = message.splitlines()[0].rstrip(".: ") if message else ""
    printable = "".join(letter if letter.isprintable() else "?" for letter in line)
    return printable[:LONGEST_REASON] or type(error).__name__
