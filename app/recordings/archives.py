"""The archives that the server shows: results of `forewarn score-archive`, read as they are.

A page asks for rows of the tables: they are read once, and again when they have changed.
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from app.assessment import sample_type
from app.recordings.archive import (
    COUNTS,
    FILES,
    ID_LETTERS,
    RECORDS,
    SUMMARY,
    is_guess,
    record_id,
    stored_about,
)
from app.recordings.exports import ANGLES
from app.recordings.remote_files import result_folder
from app.recordings.scoring_answers import tiled, worded
from app.recordings.tiles import Samples, make_tiles, window_between
from app.store.repository import NotFound
from core.monitor import State
from core.monitor.assessment import STATES

if TYPE_CHECKING:
    import pyarrow as pa

TABLES = "summary.parquet", "files.parquet"
MOST_NAMES = 1000
"""Aircraft and months that are listed to choose from."""
SORTED_BY = ("misses", "exceedances")
"""Further keys of each sorted list, largest first."""
FilesState = Literal["failed", "copy", "scored"]


class ArchiveError(ValueError):
    """A folder is not an archive, or not complete at the moment."""


@dataclass(frozen=True)
class ArchiveFilter:
    """None: any.   text: part of the flight's path.   aircraft, month: "" for those without one.

    some: names of COUNTS of which a flight has at least one each.
    """

    text: str = ""
    aircraft: str | None = None
    month: str | None = None
    monitor: str | None = None
    some: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ArchiveTables:
    """Both tables, and `about`, their metadata."""

    about: dict[str, Any]
    summary: "pa.Table"
    files: "pa.Table"


class ScoredArchive:
    """The results in one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.id = hashlib.sha256(str(folder).encode()).hexdigest()[:ID_LETTERS]
        self._lock = Lock()
        self._stamp: list[tuple[int, ...]] = []
        self._tables: ArchiveTables | None = None

    def tables(self) -> ArchiveTables:
        """ArchiveError if the folder does not hold both tables of one run."""
        with self._lock:
            try:
                stamp = [_stamp(self.folder / name) for name in TABLES]
                if self._tables is None or stamp != self._stamp:
                    self._tables = self._read()
                    self._stamp = stamp
                return self._tables
            except OSError as error:
                self._tables = None
                raise ArchiveError(self._why(error)) from None

    def about(self) -> dict[str, Any]:
        """Numbers of flights and files, names to filter by, and when which monitors scored them."""
        tables = self.tables()
        failed = len(tables.files) - tables.files["error"].null_count
        copies = len(tables.files) - tables.files["copy_of"].null_count
        return tables.about | {
            "id": self.id,
            "name": self.folder.name,
            "folder": str(self.folder),
            "problem": "",
            "n_flights": len(tables.files) - failed - copies,
            "n_failed": failed,
            "n_copies": copies,
            "aircraft": _names(tables.summary["aircraft"].unique()),
            "months": _names(tables.summary["month"].unique()),
        }

    def summary(
        self, wanted: ArchiveFilter, by: Sequence[str], limit: int, first: int
    ) -> list[dict[str, Any]]:
        """Sums over the flights of each monitor, and of each aircraft or month on request."""
        keys = [*by, "monitor"]
        sums = [(name, "sum") for name in COUNTS]
        groups = _chosen(self.tables().summary, wanted).group_by(keys)
        table = groups.aggregate([*sums, ("flight", "count"), ("peak_risk", "max")])
        renamed = {f"{name}_sum": name for name in COUNTS}
        renamed |= {"flight_count": "flights", "peak_risk_max": "peak_risk"}
        table = table.rename_columns([renamed.get(name, name) for name in table.column_names])
        table = table.sort_by([(key, "ascending") for key in keys])
        return table.slice(first, limit).to_pylist()

    def flights(
        self, wanted: ArchiveFilter, sort: str, limit: int, first: int
    ) -> list[dict[str, Any]]:
        """Rows of the summary, largest `sort` first; `flight` sorts alphabetically."""
        table = _chosen(self.tables().summary, wanted)
        if sort != "flight":
            order = dict.fromkeys((sort, *SORTED_BY), "descending")
            table = table.sort_by([*order.items()])
        table = table.slice(first, limit)
        return [{"id": record_id(row["flight"]), **_marked(row)} for row in table.to_pylist()]

    def files(
        self, state: FilesState | None, text: str, limit: int, first: int
    ) -> list[dict[str, Any]]:
        """Files of the source, by path.   state: None for all."""
        import pyarrow.compute as pc

        failed, copied = ~pc.field("error").is_null(), ~pc.field("copy_of").is_null()
        states = {"failed": failed, "copy": copied, "scored": ~failed & ~copied}
        table = _chosen(self.tables().files, ArchiveFilter(text))
        if state is not None:
            table = table.filter(states[state])
        return table.slice(first, limit).to_pylist()

    def flight(self, flight_id: str, monitor: str = "") -> dict[str, Any]:
        """A scoring of a flight with its manoeuvres.   monitor: its name, "" for the first.

        NotFound; ArchiveError if it is being scored again, or not by the monitors of the tables.
        """
        about = self.tables().about
        record = self._record(flight_id)
        names = [row["monitor"] for row in record["scorings"]]
        known = {each["name"]: each for each in about["monitors"]}
        name = monitor or names[0]
        if name not in names:
            raise NotFound(f"no scoring by {name!r}: choose {', '.join(names)}")
        k = names.index(name)
        row, details, scorer = record["scorings"][k], record["details"][k], known.get(name)
        if scorer is None or details["monitor_digest"] != scorer["digest"]:
            raise ArchiveError(self._again(row["flight"]))
        details |= {"manoeuvres": worded(details["manoeuvres"])}
        of_file = {key: record[key] for key in ("digest", "size", "request", "time_zero")}
        of_monitor = {key: scorer[key] for key in ("alert_above", "channels")}
        return _marked(row) | details | of_file | of_monitor | {"id": flight_id, "monitors": names}

    def tiles(
        self, flight_id: str, monitor: str, start: float | None, end: float | None, bins: int
    ) -> dict[str, Any]:
        """Bins of a scoring's samples, as a scored recording's. As `flight`."""
        flight = self.flight(flight_id, monitor)
        name = flight["samples"]
        keys = tuple(channel["key"] for channel in flight["channels"])
        try:
            samples, made = _samples(self._inside(name), _stamp(self.folder / name), keys)
        except (OSError, ValueError, KeyError) as error:
            raise ArchiveError(f"{self._again(flight['flight'])} ({error})") from None
        between = (
            flight["start"] if start is None else start,
            flight["end"] if end is None else end,
        )
        window = window_between(samples, made, *between, bins)
        return tiled(flight["dt"], keys, samples, window)

    def _inside(self, name: str) -> Path:
        """Path of a file of the archive. PermissionError for a link out of its folder."""
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder.resolve()):
            raise PermissionError(f"{name} is a link out of {self.folder}: replace it by the file")
        return path

    def _read(self) -> ArchiveTables:
        import pyarrow as pa
        from pyarrow.parquet import ParquetFile

        try:
            tables = [ParquetFile(self._inside(name)).read() for name in TABLES]
            about = [stored_about(table.schema) for table in tables]
        except pa.ArrowException as error:
            raise ArchiveError(f"{self.folder} is damaged: {error}: {SCORE_AGAIN}") from None
        whole = [
            kinds.keys() <= {*table.column_names}
            for table, kinds in zip(tables, (SUMMARY, FILES), strict=True)
        ]
        if not all(whole) or about[0] != about[1] or "monitors" not in about[0]:
            raise ArchiveError(
                f"{self.folder} is being written, or by another version: {SCORE_AGAIN}"
            )
        return ArchiveTables(about[0], *tables)

    def _record(self, flight_id: str) -> dict[str, Any]:
        name = f"{RECORDS}/{flight_id}.json"
        with suppress(FileNotFoundError):
            try:
                record = json.loads(self._inside(name).read_bytes())
                return record if {"scorings", "details", "request"} <= record.keys() else {}[""]
            except (ValueError, KeyError, AttributeError):
                raise ArchiveError(f"{name} is damaged: {SCORE_AGAIN}") from None
        raise NotFound(f"no flight {flight_id}: it is new, or its file was deleted or not read")

    def _why(self, error: OSError) -> str:
        if not self.folder.is_dir():
            return f"there is no folder {self.folder}: check --archive and FOREWARN_ARCHIVES"
        if isinstance(error, FileNotFoundError):
            return f"{self.folder} holds no complete results: {SCORE_AGAIN}"
        return f"{self.folder} cannot be read: {error.strerror or error}"

    def _again(self, flight: str) -> str:
        return f"{flight} is being scored again, or was: {SCORE_AGAIN}"


def _stamp(path: Path) -> tuple[int, ...]:
    """Changes with the content of a file. OSError."""
    about = path.stat()
    return about.st_mtime_ns, about.st_size, about.st_ino


class Archives:
    """The archives of the server."""

    def __init__(self, folders: Sequence[str]) -> None:
        each = [ScoredArchive(result_folder(folder)) for folder in folders]
        self._by_id = {archive.id: archive for archive in each}

    def get(self, archive_id: str) -> ScoredArchive:
        """NotFound."""
        try:
            return self._by_id[archive_id]
        except KeyError:
            raise NotFound(f"there is no archive {archive_id!r}: it was removed") from None

    def listed(self) -> list[dict[str, Any]]:
        """`about` of each; one that cannot be read has only the reason, as `problem`."""
        return [_about(archive) for archive in self._by_id.values()]


SCORE_AGAIN = "give the same `forewarn score-archive` command again, or wait for its end"


def _about(archive: ScoredArchive) -> dict[str, Any]:
    try:
        return archive.about()
    except ArchiveError as error:
        place = {"name": archive.folder.name, "folder": str(archive.folder)}
        return {"id": archive.id, **place, "problem": str(error)}


def _marked(row: dict[str, Any]) -> dict[str, Any]:
    return row | {"mapping_is_guess": is_guess(row["mapping_confidence"])}


def _names(column: Any) -> list[str]:
    return sorted(name for name in column.to_pylist() if name is not None)[:MOST_NAMES]


def _chosen(table: "pa.Table", wanted: ArchiveFilter) -> "pa.Table":
    import pyarrow.compute as pc

    conditions: list[Any] = []
    if text := wanted.text.strip():
        match: Any = pc.match_substring  # pyright: ignore[reportAttributeAccessIssue]
        conditions.append(match(pc.field("flight"), text, ignore_case=True))
    for name in ("aircraft", "month", "monitor"):
        value = getattr(wanted, name)
        if value is not None:
            field = pc.field(name)
            conditions.append(field == value if value else field.is_null())
    conditions += [pc.field(name) > 0 for name in wanted.some]
    for condition in conditions:
        table = table.filter(condition)
    return table


@lru_cache(maxsize=4)
def _samples(path: Path, _stamp: tuple[int, ...], keys: tuple[str, ...]) -> tuple[Samples, Samples]:
    """Samples of a scoring and their tiles. KeyError; ValueError; OSError.

    _stamp: of the file, so that it is read again once that has changed. A page asks for many
    windows of a flight.
    """
    from pyarrow.parquet import ParquetFile

    table = ParquetFile(path).read()
    samples = np.empty(len(table), sample_type(len(keys)))

    def values(name: str) -> Any:
        return table[name].to_numpy()

    for name in ("t", "p_value", "alert", "manoeuvre"):
        samples[name] = values(name)
    samples["withdrawn"] = values("withdrawn_p_value")
    states, codes = np.unique(values("state"), return_inverse=True)
    samples["state"] = np.array([STATES.index(State(state)) for state in states], "u1")[codes]
    for k, key in enumerate(keys):
        samples["y"][:, k], samples["y_hat"][:, k] = values(key), values(f"predicted_{key}")
    for k, angle in enumerate(ANGLES):
        samples["attitude"][:, k] = np.nan if angle in keys else values(angle)
    samples["trim"] = np.nan
    return samples, make_tiles(samples)
