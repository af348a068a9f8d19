"""Archives: results of `forewarn score-archive` by aircraft, month, monitor and flight."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query
from pydantic import BaseModel, Field

from app.http.problems import Problem, problem_responses
from app.messages import ChannelLimit
from app.recordings.archive import Count
from app.recordings.archives import ArchiveFilter, Archives, FilesState, ScoredArchive
from app.routes.dependencies import PAGED, Described, Finite, ListPart, PartDep, json_response, part
from app.routes.scorings import MOST_BINS, ScoringFacts, Tiles

router = APIRouter(prefix="/api/v1/archives", tags=["archives"])
ArchivesDep = Annotated[Archives, part("archives")]
FlightId = Annotated[str, Path(pattern="^[0-9a-f]{16}$", description="of the flight's path")]
MonitorName = Annotated[str, Query(description="name; the first monitor if absent")]
Sort = Literal["flight", "peak_risk"] | Count
UNREADABLE = problem_responses(409)


class ArchiveMonitor(BaseModel):
    """A monitor at an epsilon, by which the archive is scored."""

    name: str = Field(description="name of the scoring in the tables")
    file: str = Field(description="name of the portable monitor")
    digest: str = Field(description="its SHA-256")
    epsilon: float
    alert_above: float = Field(description="risk above which a sample alerts")
    lead: float = Field(description="promised by the monitor [s]")
    channels: list[ChannelLimit]


class ArchiveInfo(BaseModel):
    """An archive. One that cannot be read has only the first four fields."""

    id: str
    name: str
    folder: str
    problem: str = Field(description="why it cannot be read; empty if it can")
    scored: str | None = Field(default=None, description="UTC, ISO 8601: end of the last run")
    version: str | None = Field(default=None, description="of the program, in the last run")
    source: str | None = Field(default=None, description="folder of the recordings")
    monitors: list[ArchiveMonitor] = Field(default=[])
    n_flights: int = Field(default=0, description="scored flights")
    n_failed: int = Field(default=0, description="files that could not be scored")
    n_copies: int = Field(default=0, description="files equal to another, which alone is scored")
    aircraft: list[str] = Field(default=[], description="names, the first 1000")
    months: list[str] = Field(default=[], description="as YYYY-MM, the first 1000")


class ArchiveCounts(Described):
    """Counts of manoeuvres, except of samples and `alerts`, which are runs of alerts.

    manoeuvres = warned_in_time + warned_late + misses + false_alarms + quiet + no_verdict. An
    exceedance that is not warned in time or late nor a miss is one without a verdict.
    """

    monitor: str
    aircraft: str | None = Field(default=None, description="null if not known, or not asked for")
    month: str | None = Field(default=None, description="as YYYY-MM; null as for the aircraft")
    n_samples: int
    manoeuvres: int
    exceedances: int = Field(description="from trim")
    exceedances_as_recorded: int = Field(description="as recorded only, not from trim")
    exceedances_outside: int = Field(description="outside every manoeuvre")
    alerts: int
    warned_in_time: int
    warned_late: int
    misses: int
    false_alarms: int
    quiet: int
    no_verdict: int
    valid: int = Field(description="manoeuvres to which the monitor applies")
    not_valid: int
    validity_unknown: int
    peak_risk: float | None


class ArchiveGroup(ArchiveCounts):
    """Sums over the flights of a monitor, aircraft or month."""

    flights: int


class ArchiveRow(ArchiveCounts):
    """A flight as one monitor scored it."""

    id: str = Field(description="of the flight")
    flight: str = Field(description="path in the source")
    epsilon: float
    start: float | None = Field(description="[s]")
    end: float | None = Field(description="[s]")
    mapping_confidence: float | None = None
    """the least in a channel of a proposed mapping, 0 to 1; null if it was given"""
    samples: str = Field(description="path of the samples in the archive")
    mapping_is_guess: bool = Field(description="its confidence is low: check the mapping")


class ArchiveFlight(ScoringFacts, ArchiveRow):  # pyright: ignore[reportIncompatibleVariableOverride]
    """A flight as one monitor scored it, with its manoeuvres; `tiles` has its samples."""

    monitors: list[str] = Field(description="names of all that scored it")
    digest: str = Field(description="SHA-256 of the file")
    size: int = Field(description="of the file [bytes]")


class SourceFile(BaseModel):
    """A file of the source."""

    flight: str = Field(description="path in the source")
    digest: str | None = Field(description="SHA-256; null if it was not scored")
    error: str | None = Field(description="why it was not scored")
    copy_of: str | None = Field(description="the flight with equal content")
    size: int | None = Field(description="[bytes]")


def _filter(
    text: Annotated[str, Query(description="part of the flight's path")] = "",
    aircraft: Annotated[str | None, Query(description="empty: not known")] = None,
    month: Annotated[str | None, Query(description="as YYYY-MM; empty: not known")] = None,
    monitor: Annotated[str | None, Query(description="name")] = None,
    some: Annotated[list[Count] | None, Query(description="has at least one of each")] = None,
) -> ArchiveFilter:
    return ArchiveFilter(text, aircraft, month, monitor, tuple(some or ()))


FilterDep = Annotated[ArchiveFilter, Depends(_filter)]


def _first(part: ListPart, archive: ScoredArchive) -> int:
    """Number of the part's first row. Problem if the archive was scored since the part before."""
    if not part.cursor:
        return 0
    first, _, scored = part.cursor.partition("~")
    if not first.isdigit() or len(first) > 15:
        raise Problem(
            422, f"cursor={part.cursor!r}: use that of the `Link`", "urn:forewarn:request"
        )
    if scored != archive.tables().about["scored"]:
        raise Problem(
            409, "the archive was scored again: read the list again", "urn:forewarn:archive"
        )
    return int(first)


def _answer(part: ListPart, archive: ScoredArchive, first: int, rows: list[dict[str, Any]]) -> Any:
    if len(rows) == part.limit:
        part.link_to(f"{first + part.limit}~{archive.tables().about['scored']}")
    link = part.response.headers.get("link")
    return json_response(rows, headers={"Link": link} if link else None)


@router.get("")
def list_archives(archives: ArchivesDep) -> list[ArchiveInfo]:
    """The archives of FOREWARN_ARCHIVES, also those that cannot be read."""
    return json_response(archives.listed())


@router.get("/{archive_id}", responses=UNREADABLE)
def read_archive(archive_id: str, archives: ArchivesDep) -> ArchiveInfo:
    """One archive; 409 if its folder holds none, or one that is not scored to the end."""
    return json_response(archives.get(archive_id).about())


@router.get("/{archive_id}/summary", responses=UNREADABLE | PAGED)
def read_archive_summary(
    archive_id: str,
    archives: ArchivesDep,
    part: PartDep,
    wanted: FilterDep,
    by: Annotated[
        list[Literal["aircraft", "month"]] | None, Query(description="groups, besides monitors")
    ] = None,
) -> list[ArchiveGroup]:
    """Sums by monitor, and by aircraft and month if asked for; each in alphabetical order."""
    archive = archives.get(archive_id)
    first = _first(part, archive)
    keys = tuple(dict.fromkeys(by or ()))
    return _answer(part, archive, first, archive.summary(wanted, keys, part.limit, first))


@router.get("/{archive_id}/flights", responses=UNREADABLE | PAGED)
def list_archived_flights(
    archive_id: str,
    archives: ArchivesDep,
    part: PartDep,
    wanted: FilterDep,
    sort: Annotated[Sort, Query(description="largest first; `flight` by path")] = "misses",
) -> list[ArchiveRow]:
    """Flights, a row for each monitor."""
    archive = archives.get(archive_id)
    first = _first(part, archive)
    return _answer(part, archive, first, archive.flights(wanted, sort, part.limit, first))


@router.get("/{archive_id}/files", responses=UNREADABLE | PAGED)
def list_archived_files(
    archive_id: str,
    archives: ArchivesDep,
    part: PartDep,
    text: Annotated[str, Query(description="part of the path")] = "",
    state: Annotated[FilesState | None, Query(description="all if absent")] = None,
) -> list[SourceFile]:
    """Files of the source by path, with the reason where one was not scored."""
    archive = archives.get(archive_id)
    first = _first(part, archive)
    return _answer(part, archive, first, archive.files(state, text, part.limit, first))


@router.get("/{archive_id}/flights/{flight_id}", responses=UNREADABLE)
def read_archived_flight(
    archive_id: str, flight_id: FlightId, archives: ArchivesDep, monitor: MonitorName = ""
) -> ArchiveFlight:
    """A flight with a verdict on each manoeuvre; 409 while it is scored again."""
    return json_response(archives.get(archive_id).flight(flight_id, monitor))


@router.get("/{archive_id}/flights/{flight_id}/tiles", responses=UNREADABLE)
def read_archived_tiles(
    archive_id: str,
    flight_id: FlightId,
    archives: ArchivesDep,
    monitor: MonitorName = "",
    start: Annotated[Finite | None, Query(description="[s]; that of the flight if absent")] = None,
    end: Annotated[Finite | None, Query(description="[s]; that of the flight if absent")] = None,
    bins: Annotated[int, Query(ge=1, le=MOST_BINS, description="most bins")] = 1000,
) -> Tiles:
    """An interval of a flight in bins, with exact extremes."""
    return json_response(archives.get(archive_id).tiles(flight_id, monitor, start, end, bins))
