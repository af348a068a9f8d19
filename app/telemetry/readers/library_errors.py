"""What the libraries of file formats raise over a bad file, as one kind of error.

h5py, scipy, pyarrow and the others answer a damaged file with any exception there is, from KeyError
to their own; and they print and warn on the way.
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
    """Turn whatever a library raises over a file of this kind into one TelemetryError.

    What it prints and warns is dropped. A library that is not installed and a disk without room are
    no fault of the file and stay as they are.
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
            f"reading this {title} file takes more memory than there is: export the time range and "
            "the signals of this test"
        ) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise
        raise TelemetryError(
            f"the {title} file is damaged or cut short ({_reason(error)}): copy or export it again"
        ) from error


def too_deep(title: str) -> str:
    """Say that groups or structures lie in one another too deeply to be a recording."""
    return (
        f"the {title} file holds groups or structures nested too deeply: export the signals of "
        "this test in a flat table"
    )


def _reason(error: Exception) -> str:
    """The first line of what the library says, without its dots, or else the kind of error."""
    message = str(error).strip()
    line = message.splitlines()[0].rstrip(".: ") if message else ""
    printable = "".join(letter if letter.isprintable() else "?" for letter in line)
    return printable[:LONGEST_REASON] or type(error).__name__
