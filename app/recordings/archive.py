"""Score the recordings of a folder tree into Parquet files that other programs read as they are.

    OUT/summary.parquet        a row for each flight and scoring; metadata: time, monitors
        files.parquet          a row for each file of the source, with the reason if it failed
                               and the flight that it is a copy of, which alone is scored
        samples/monitor=M/aircraft=A/month=YYYY-MM/ID.parquet
        flights/ID.json        the scorings of a flight with their manoeuvres; written after its
                               samples, so that interrupted work continues there

ID is a digest of the file's path. files.parquet is written last; both tables have equal metadata. A
flight is scored again when its file, a monitor, the mapping, a setting or the program has changed.
"""

import hashlib
import json
import pickle
import re
import signal
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from io import BytesIO
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from app import json_codec
from app.assessment.outcome import WITHOUT_VERDICT
from app.messages import limited_channels
from app.recordings.exports import EXPORTS, ExportColumn, columns
from app.recordings.files import digest_of
from app.recordings.remote_files import RemoteFile, remote_files
from app.recordings.scored import scoring_fields
from app.recordings.scored_file import Scored, ScoreRequest, labels, load_monitors, score_file
from app.store.tables import now
from app.telemetry.mapping.applying import time_zero
from app.telemetry.mapping.group_times import DOUBTED
from app.telemetry.mapping.proposal import Proposal
from app.telemetry.readers import isolation
from core import __version__
from core.monitor import Monitor
from core.tasks import Tasks
from core.whole_file import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

ID_LETTERS = 16
RECORDS, SAMPLES = "flights", "samples"
UNKNOWN = "__HIVE_DEFAULT_PARTITION__"
"""Name of a partition without a value."""
FIRST_DATE = 1e8
"""Times of samples above this are seconds since 1970 [s]."""
MONTH = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(0[1-9]|1[0-2])(?:[-_.]?(?:0[1-9]|[12]\d|3[01]))?(?!\d)"
)
"""A date in a path, with or without its day."""
Count = Literal[
    "n_samples",
    "manoeuvres",
    "exceedances",
    "exceedances_as_recorded",
    "exceedances_outside",
    "alerts",
    "warned_in_time",
    "warned_late",
    "misses",
    "false_alarms",
    "quiet",
    "no_verdict",
    "valid",
    "not_valid",
    "validity_unknown",
]
COUNTS: tuple[str, ...] = get_args(Count)
SUMMARY = (
    dict.fromkeys(("monitor", "aircraft", "flight", "month", "samples"), "string")
    | dict.fromkeys(("epsilon", "start", "end", "peak_risk", "mapping_confidence"), "float64")
    | dict.fromkeys(COUNTS, "int64")
)
FILES = dict.fromkeys(("flight", "digest", "error", "copy_of"), "string") | {"size": "int64"}
"""Types of the columns of the tables."""
LAYOUT = 4
"""Version of the records; a record of another version is made again."""
DETAILS = ("mapping", "time_zero", "request", "details")
"""Fields of a record besides the rows of the summary."""
ABOUT = b"forewarn"
"""Key of the metadata of a table."""


@dataclass(frozen=True)
class ArchiveRequest:
    """score: the file is the folder of the recordings, unless `url` gives them.

    aircraft: None: the first folder's name.   workers: processes that score at once.
    """

    score: ScoreRequest
    out: Path
    aircraft: str | None = None
    workers: int = 1
    url: str = ""

    @property
    def source(self) -> str:
        return self.url or str(self.score.file)

    def absolute(self) -> "ArchiveRequest":
        """The same with absolute paths, for other processes and machines."""
        monitors = tuple(path.absolute() for path in self.score.monitors)
        score = replace(self.score, monitors=monitors, file=self.score.file.absolute())
        return replace(self, score=score)


@dataclass(frozen=True)
class Archived:
    """Numbers of flights.   failed: reason by file.   copies: flight with the same content.

    doubted: flights whose mapping is a guess.
    """

    scored: int
    unchanged: int
    doubted: int
    failed: dict[str, str]
    copies: dict[str, str]

    @property
    def is_done(self) -> bool:
        return self.scored + self.unchanged > 0


@dataclass(frozen=True)
class ArchiveFile:
    """A file to score.   path: for a remote file, that of its copy."""

    path: Path
    flight: str
    remote: RemoteFile | None = None

    @property
    def record(self) -> str:
        """Name of the file with its result."""
        return f"{RECORDS}/{record_id(self.flight)}.json"

    @property
    def size(self) -> int:
        return self.remote.size if self.remote else self.path.stat().st_size

    @contextmanager
    def at_hand(self) -> Iterator["ArchiveFile"]:
        """The same on this machine; a copy of a remote file is deleted afterwards. OSError."""
        if self.remote is None:
            yield self
            return
        with self.remote.fetched() as path:
            yield replace(self, path=path)


class ArchiveScorer:
    """Scores the files of an archive with monitors that are loaded once."""

    def __init__(self, request: ArchiveRequest) -> None:
        self._request = request
        self._monitors: list[Monitor] = load_monitors(request.score)
        score = request.score
        self._digests = {path: digest_of(path) for path in score.monitors}
        several = labels(score)
        self._names = several if len(several) > 1 else [score.monitors[0].stem]
        self._about = {
            "monitors": [self._digests[path] for path in score.monitors],
            "epsilons": score.epsilons,
            "mapping": score.mapping and score.mapping.to_plain(),
            "rate": score.rate and asdict(score.rate),
            "group": score.group,
            "recipe": asdict(score.recipe),
            "aircraft": request.aircraft,
            "version": __version__,
            "layout": LAYOUT,
        }

    def about(self) -> dict[str, Any]:
        """When the archive was scored, its source and monitors. Stored with its tables."""
        score = self._request.score
        pairs = [
            (monitor, path, monitor.check_epsilon(epsilon))
            for monitor, path in zip(self._monitors, score.monitors, strict=True)
            for epsilon in score.epsilons
        ]
        monitors = [
            {
                "name": name,
                "file": path.name,
                "digest": self._digests[path],
                "epsilon": epsilon,
                "alert_above": monitor.alert_above(epsilon),
                "lead": monitor.lead,
                "channels": [
                    channel.model_dump()
                    for channel in limited_channels(monitor.dictionary, monitor.specification)
                ],
            }
            for name, (monitor, path, epsilon) in zip(self._names, pairs, strict=True)
        ]
        source = self._request.source
        return {"scored": now(), "version": __version__, "source": source, "monitors": monitors}

    def __call__(self, file: ArchiveFile) -> dict[str, Any]:
        """The record of a flight, stored unless it is unchanged. OSError if it cannot be stored."""
        stamp = file.remote.stamp if file.remote else ""
        before = read_record(self._request.out, file.record)
        if stamp and stamp == before.get("stamp") and before["key"] == self._key(before["digest"]):
            return before | {"is_unchanged": True}
        try:
            with file.at_hand() as file:
                if not file.path.is_file():
                    raise ValueError(_no_file(file.path))
                content = digest_of(file.path)
                if before.get("key") == self._key(content):
                    return before | {"is_unchanged": True}
                request = replace(self._request.score, file=file.path)
                scored = score_file(request, monitors=self._monitors)
                size = file.path.stat().st_size
        except Exception as error:  # whatever is wrong with one file, the others are scored
            (self._request.out / file.record).unlink(missing_ok=True)
            return {"flight": file.flight, "error": _reason(error, file)}
        confidence = {"mapping_confidence": _confidence(scored.proposal)}
        rows = [
            self._stored(file, each, name) | confidence
            for each, name in zip(scored.scored, self._names, strict=True)
        ]
        record = {"flight": file.flight, "key": self._key(content), "digest": content}
        record |= {"scorings": rows, "size": size, "stamp": stamp}
        mapping = scored.mapping.to_plain()
        details = {
            "mapping": mapping,
            "time_zero": time_zero(scored.contents, scored.mapping),
            "request": self._request.score.recipe.to_plain(),
            "details": [self._details(each) for each in scored.scored],
        }
        _write(self._request.out / file.record, json_codec.encode(record | details))
        return record

    def _key(self, content: str) -> str:
        """Digest of everything that determines a result.   content: SHA-256 of the file."""
        return hashlib.sha256(json_codec.encode({**self._about, "file": content})).hexdigest()

    def _details(self, scored: Scored) -> dict[str, Any]:
        details = scoring_fields(scored.recording, scored.monitor, {})
        del details["mapping"]
        return details | {"monitor_digest": self._digests[scored.path]}

    def _stored(self, file: ArchiveFile, scored: Scored, name: str) -> dict[str, Any]:
        """Write the samples of a scoring; return its row of the summary."""
        parts = file.flight.split("/")
        aircraft = self._request.aircraft or (parts[0] if len(parts) > 1 else None)
        samples = scored.recording.samples
        month = month_of(file.flight, float(samples["t"][0]) if len(samples) else 0.0)
        path = "/".join(
            [
                SAMPLES,
                f"monitor={quote(name, safe=' ')}",
                f"aircraft={UNKNOWN if aircraft is None else quote(aircraft, safe=' ')}",
                f"month={month or UNKNOWN}",
                f"{record_id(file.flight)}.parquet",
            ]
        )
        row = {"monitor": name, "aircraft": aircraft, "flight": file.flight, "month": month}
        row |= summary_of(scored) | {"samples": path}
        about = {
            "flight": file.flight,
            "epsilon": scored.recording.epsilon,
            "monitor": self._digests[scored.path],
            "limits_in_force": scored.recording.limits_in_force,
        }
        of_flight = ExportColumn(
            "flight", "", np.zeros(len(samples), np.int32), words=(file.flight,)
        )
        of_samples = columns(samples, scored.monitor.dictionary, always_attitude=True)
        content = BytesIO()
        EXPORTS["parquet"].write([of_flight, *of_samples], about, content)
        _write(self._request.out / path, content.getvalue())
        return row


def summary_of(scored: Scored) -> dict[str, Any]:
    """Row of the summary for a scoring: counts of manoeuvres, and of alerts as runs; times [s].

    Each manoeuvre is warned in time or late, a miss, a false alarm, quiet or without a verdict;
    each exceedance is warned in time or late, a miss or without a verdict. `exceedances` excludes
    those as recorded only, not from trim.
    """
    recording = scored.recording
    outcomes = [manoeuvre.outcome for manoeuvre in recording.manoeuvres]
    valid = [manoeuvre.validity.valid for manoeuvre in recording.manoeuvres]
    risks = [each.peak_risk for each in recording.manoeuvres if each.peak_risk is not None]
    t = recording.samples["t"]
    return {
        "epsilon": recording.epsilon,
        "start": float(t[0]) if len(t) else None,
        "end": float(t[-1]) if len(t) else None,
        "n_samples": len(t),
        "manoeuvres": len(outcomes),
        "exceedances": sum(each.exceedance is not None for each in recording.manoeuvres),
        "exceedances_as_recorded": sum(
            each.exceedance is None and each.recorded_exceedance is not None
            for each in recording.manoeuvres
        ),
        "exceedances_outside": len(recording.outside_exceedances),
        "alerts": sum(len(each.alerts) for each in recording.manoeuvres),
        "warned_in_time": outcomes.count("timely_alert"),
        "warned_late": outcomes.count("late_alert"),
        "misses": outcomes.count("missed"),
        "false_alarms": outcomes.count("false_alert"),
        "quiet": outcomes.count("quiet"),
        "no_verdict": sum(each in WITHOUT_VERDICT for each in outcomes),
        "valid": valid.count(True),
        "not_valid": valid.count(False),
        "validity_unknown": valid.count(None),
        "peak_risk": max(risks, default=None),
    }


def month_of(flight: str, start: float) -> str | None:
    """Month of a flight as YYYY-MM: from its first sample, else from its path, else None."""
    if start > FIRST_DATE:
        return datetime.fromtimestamp(start, UTC).strftime("%Y-%m")
    dates = MONTH.findall(flight)
    return "-".join(dates[-1]) if dates else None


def score_archive(
    request: ArchiveRequest,
    progress: Callable[[int, int], None] = lambda *_: None,
    executor: Executor | None = None,
) -> Archived:
    """Score what has changed in an archive, and write its tables.

    executor: of a cluster whose workers reach the same absolute paths; else this machine's
    processes.
    ValueError for a source or monitors that cannot be used; OSError.
    """
    request = request.absolute()
    scorer = ArchiveScorer(request)
    files = list(_files(request))
    if not files:
        raise ValueError(f"{request.source} holds no files: give a folder of recordings")
    out = request.out
    stored = _names(out, RECORDS, ".json")
    present = {file.record for file in files}
    if stored and not stored & present:
        raise ValueError(
            f"{out} holds the results of other recordings than {request.source}: give another --out"
        )
    if left_out := _monitors_in(out) - {path.name for path in request.score.monitors}:
        raise ValueError(
            f"{out} also holds the results of {', '.join(sorted(left_out))}, which was not given: "
            "give all its monitors, or another --out"
        )
    for name in stored - present:
        (out / name).unlink()
    copies = _copies(files)
    results: list[dict[str, Any]] = [
        {"flight": flight, "copy_of": first} for flight, first in copies.items()
    ]
    different = [file for file in files if file.flight not in copies]
    for result in _scored(scorer, request, different, executor):
        results.append(result)
        progress(len(results), len(files))
    results.sort(key=lambda result: result["flight"])
    rows = [row for result in results for row in result.get("scorings", ())]
    about = scorer.about()
    _write(out / "summary.parquet", _table(rows, SUMMARY, about))
    _write(out / "files.parquet", _table(results, FILES, about))
    for name in _names(out, SAMPLES, ".parquet") - {row["samples"] for row in rows}:
        (out / name).unlink()
    failed = {each["flight"]: each["error"] for each in results if "error" in each}
    unchanged = sum(bool(each.get("is_unchanged")) for each in results)
    n_scored = len(results) - len(failed) - len(copies) - unchanged
    doubted = len({row["flight"] for row in rows if is_guess(row["mapping_confidence"])})
    return Archived(n_scored, unchanged, doubted, failed, copies)


def _names(out: Path, below: str, ending: str) -> set[str]:
    """Names of the files below one of the folders of an archive; empty if there is none."""
    return {path.relative_to(out).as_posix() for path in (out / below).rglob(f"*{ending}")}


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def is_guess(confidence: float | None) -> bool:
    """confidence: of the mapping; None if it was given."""
    return confidence is not None and confidence < DOUBTED


def _confidence(proposal: Proposal | None) -> float | None:
    """The lowest of the mapping's channels; None if the mapping was given."""
    if proposal is None:
        return None
    each = (proposal.rationales.get(key) for key in proposal.mapping.channels)
    return min((rationale.confidence for rationale in each if rationale), default=None)


def _monitors_in(out: Path) -> set[str]:
    """Files of the monitors whose results a folder holds."""
    from pyarrow.parquet import read_schema

    with suppress(OSError, ValueError):
        about = stored_about(read_schema(out / "files.parquet"))
        return {monitor["file"] for monitor in about.get("monitors", ())}
    return set()


def stored_about(schema: "pa.Schema") -> dict[str, Any]:
    """`ArchiveScorer.about` as stored in the schema of a table; empty if it is absent."""
    return json.loads((schema.metadata or {}).get(ABOUT, b"{}"))


def _files(request: ArchiveRequest) -> Iterator[ArchiveFile]:
    out = request.out
    if out.is_file():
        raise ValueError(f"{out} is a file: give a folder for the results")
    if request.url:
        for remote in remote_files(request.url):
            yield ArchiveFile(Path(remote.name), remote.name, remote)
        return
    root = request.score.file
    if not root.is_dir():
        raise ValueError(f"{root} is not a folder: give the folder of the recordings")
    if out.resolve().is_relative_to(root.resolve()):
        raise ValueError(f"the results in {out} would lie among the recordings: give another --out")
    for path in sorted(root.rglob("*")):
        inside = path.relative_to(root)
        is_hidden = any(part.startswith(".") for part in inside.parts)
        if not is_hidden and (not path.is_dir() or path.is_symlink()):
            yield ArchiveFile(path, inside.as_posix())


def record_id(flight: str) -> str:
    """ID of a flight, from its path in the source."""
    return hashlib.sha256(flight.encode()).hexdigest()[:ID_LETTERS]


def _no_file(path: Path) -> str:
    """Why something that is no file is not read."""
    if path.is_dir():
        return "a link to a folder: give that folder as the source"
    if path.is_symlink():
        return f"a link to {path.readlink()}, which does not exist: mend or delete it"
    return "a pipe or device: copy its content to a file"


def _copies(files: list[ArchiveFile]) -> dict[str, str]:
    """Flights whose files equal that of another flight: the first one with this content."""
    by_size, first = defaultdict[int, list[ArchiveFile]](list), dict[str, str]()
    for file in files:
        if file.remote or file.path.is_file():
            by_size[file.size].append(file)
    copies = {}
    for file in (file for equal in by_size.values() if len(equal) > 1 for file in equal):
        with suppress(OSError):  # it is named when it is scored
            content = file.remote.digest() if file.remote else digest_of(file.path)
            if first.setdefault(content, file.flight) != file.flight:
                copies[file.flight] = first[content]
    return copies


def _scored(
    scorer: ArchiveScorer,
    request: ArchiveRequest,
    files: list[ArchiveFile],
    executor: Executor | None,
) -> Iterator[dict[str, Any]]:
    """The record of each file, as it is done. Readers are processes that read many files."""
    if executor is None and request.workers == 1:
        with isolation.kept_readers():
            yield from map(scorer, files)
        return
    with ExitStack() as resources:
        if executor is None:
            context = get_context("spawn")
            pool = ProcessPoolExecutor(request.workers, context, _ignore_interrupts)
            executor = resources.enter_context(pool)
        tasks, packed = resources.enter_context(Tasks(executor)), pickle.dumps(request)
        try:
            for done in as_completed([tasks.submit(_score, packed, file) for file in files]):
                yield done.result()
        except BrokenExecutor as error:
            raise OSError(
                "a process was ended by the system, often by lack of memory: give fewer --workers; "
                "the same command continues"
            ) from error


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers


_RESOURCES = ExitStack()
"""Readers of a worker process, open until it ends."""


@cache
def _opened(packed: bytes) -> ArchiveScorer:
    _RESOURCES.enter_context(isolation.kept_readers())
    return ArchiveScorer(pickle.loads(packed))


def _score(packed: bytes, file: ArchiveFile) -> dict[str, Any]:
    """packed: the request; each process loads its monitors once."""
    return _opened(packed)(file)


def read_record(out: Path, name: str) -> dict[str, Any]:
    """The stored record of a flight; empty if there is none, or if its samples are missing."""
    try:
        record = json.loads((out / name).read_bytes())
        samples = [row["samples"] for row in record["scorings"]]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    for name in DETAILS:
        record.pop(name, None)
    return record if all((out / name).is_file() for name in samples) else {}


def _reason(error: Exception, file: ArchiveFile) -> str:
    words = str(error) if isinstance(error, ValueError | OSError) else repr(error)
    return words.removeprefix(f"{file.path}: ")


def _table(rows: list[dict[str, Any]], kinds: dict[str, str], about: dict[str, Any]) -> bytes:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    fields = [(name, pa.type_for_alias(kind)) for name, kind in kinds.items()]
    schema = pa.schema(fields, {ABOUT: json_codec.encode(about)})
    content = BytesIO()
    write_table(pa.Table.from_pylist(rows, schema), content)
    return content.getvalue()
