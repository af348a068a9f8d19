"""Receive, read, map, store and delete recordings.

An upload is written and read in a folder under `incoming`, which moves into its place when it is
complete. A failure, a client that disconnects or a server crash leaves nothing behind.
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from app.recordings.files import RecordingFiles, digest_of, reporting_full_disk
from app.recordings.flown_journal import FlownJournal, link_or_copy
from app.recordings.mapped_columns import propose_mapping, signature, with_mapping
from app.recordings.mapped_recording import MappedRecording, RecentMappings
from app.recordings.rollouts import SentRollouts, failures_of, receive_rollouts
from app.recordings.upload import Received, SentField, receive
from app.recordings.workers import Busy, Workers, run_to_end
from app.store.recordings import MappedColumns, RememberedMapping
from app.store.store import NotFound, Store, StoreError
from app.store.tables import new_id
from app.telemetry.contents import Columns, open_columns
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.readers import isolation
from app.telemetry.reading import read_file
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import KNOWN
from core.channels import LATERAL, Channel, Dictionary
from core.limits.flight_limits import QBAR
from core.recipe import instead_of

LOG = logging.getLogger("forewarn")
MOST_UPLOADS = 8
"""Most uploads at once."""
SHUTDOWN_WAIT_S = 5.0
"""How long a shutdown waits for uploads."""


class Abandoned(Exception):
    """The client disconnected before the answer."""


@dataclass(frozen=True)
class Upload:
    """A file to receive.

    name: original file name.   length: declared by the client [bytes], or 0.
    body: content in chunks.   is_abandoned: whether the client has disconnected.
    monitor: id of the one that the mapping is proposed for, if any.
    """

    name: str
    aircraft: str | None
    length: int
    body: AsyncIterator[bytes]
    is_abandoned: Callable[[], Awaitable[bool]]
    monitor: str | None = None


class Recordings:
    """The recordings of a server; leaving the context ends all uploads."""

    def __init__(self, store: Store, root: Path) -> None:
        self.store = store
        self.files = RecordingFiles(root)
        self.workers = Workers()
        self.readers = Workers(queue=MOST_UPLOADS)
        self._recent = RecentMappings()
        self._uploads: set[asyncio.Task[Any]] = set()

    async def __aenter__(self) -> Self:
        try:
            await run_to_end(self._recover)
        except (StoreError, OSError) as error:
            LOG.warning("incomplete recordings of a crashed server remain for now: %s", error)
        return self

    async def __aexit__(self, *error: object) -> None:
        for workers in (self.readers, self.workers):
            await asyncio.to_thread(workers.close)
        if self._uploads:
            _, late = await asyncio.wait(self._uploads, timeout=SHUTDOWN_WAIT_S)
            for upload in late:
                upload.cancel()
            await asyncio.gather(*late, return_exceptions=True)

    @property
    def under_way(self) -> int:
        return len(self._uploads)

    async def receive(self, upload: Upload) -> str:
        """Store an upload; return its id.

        Busy; NoSpace; Stalled; Abandoned; NotFound; TelemetryError if the file cannot be read.
        """
        recording_id = new_id()
        with self._uploading():
            try:
                dictionary = await run_to_end(self.dictionary_of, upload.monitor)
                folder = await run_to_end(self._begin, recording_id, upload.length)
                received = await receive(upload.body, folder / "file", self.files.require)
                if received.size == 0:
                    raise TelemetryError("the file is empty: choose a file with telemetry")
                stored, mapped = await self.readers.run(self._read, folder, upload, dictionary)
                if await upload.is_abandoned():
                    raise Abandoned
                about = upload.name, upload.aircraft, received, stored
                await run_to_end(self._admit, recording_id, *about)
                self._recent.add(recording_id, mapped)
            except BaseException:
                await run_to_end(self._drop, recording_id)
                raise
        return recording_id

    async def receive_rollouts(self, fields: AsyncIterator[SentField], length: int) -> SentRollouts:
        """Receive files of rollouts into a folder, which the caller drops by `drop_rollouts`.

        length: declared by the client [bytes], or 0.
        Busy; NoSpace; NotFound; Stalled; TelemetryError.
        """
        upload_id = new_id()
        with self._uploading():
            try:
                sent = SentRollouts(await run_to_end(self._begin, upload_id, length))
                await receive_rollouts(fields, sent, self.files.require)
                await run_to_end(self._check, sent)
            except BaseException:
                await run_to_end(self.files.reject, upload_id)
                raise
        return sent

    def _check(self, sent: SentRollouts) -> None:
        """NotFound for an unknown recording, scoring or dataset; TelemetryError for a label."""
        if sent.dataset:
            self.store.datasets.info(sent.dataset)
        failures_of(sent.labels, self.names_of(sent.recordings))

    def names_of(self, flights: Iterable[str]) -> dict[str, str]:
        """Names of recordings, given as ID or ID/SCORING. NotFound."""
        names: dict[str, str] = {}
        for each in flights:
            recording_id, _, scoring_id = each.partition("/")
            names[each] = self.store.recordings.info(recording_id).name
            if scoring_id:
                self.store.scorings.info(recording_id, scoring_id)
        return names

    def drop_rollouts(self, sent: SentRollouts) -> None:
        self.files.reject(sent.folder.name)

    @contextmanager
    def _uploading(self) -> Iterator[None]:
        """Count the caller among the uploads. Busy."""
        if len(self._uploads) >= MOST_UPLOADS:
            raise Busy(f"{MOST_UPLOADS} uploads are in progress, the maximum: try again soon")
        task = asyncio.current_task()
        assert task is not None
        self._uploads.add(task)
        try:
            yield
        finally:
            self._uploads.discard(task)

    def add_journal(self, flown: FlownJournal) -> str:
        """Store the journal of an ended flight with a confirmed mapping; runs in a thread.

        Returns its id. NoSpace; TelemetryError if it has too few samples; StoreError.
        """
        recording_id = new_id()
        try:
            size = flown.path.stat().st_size
            folder = self._begin(recording_id, size)
            link_or_copy(flown.path, folder / "file")
            received = Received(size, digest_of(folder / "file"))
            with reporting_full_disk():
                read_file(folder / "file", folder / "columns", name=flown.name)
            columns = open_columns(folder / "columns")
            proposed, _ = propose_mapping(columns, None)
            mapped = MappedRecording.of(columns, flown.mapping_for(columns))
            confirmed = _confirmed(proposed, mapped, columns)
            self._admit(recording_id, flown.name, flown.aircraft, received, confirmed, flown)
        except BaseException:
            self._drop(recording_id)
            raise
        return recording_id

    def dictionary_of(self, monitor_id: str | None) -> Dictionary:
        """The dictionary of a stored monitor; the lateral one without a monitor. NotFound."""
        if monitor_id is None:
            return LATERAL
        return Dictionary.from_stored(self.store.monitors.info(monitor_id).dictionary)

    def channels(self) -> list[Channel]:
        """All known channels: TARGETS, and those of built-in and stored dictionaries.

        A key comes with each of its units.
        """
        own = (channel for known in self.store.dictionaries() for channel in known.channels)
        return list(dict.fromkeys((*KNOWN.values(), QBAR, *own)))

    def proposed_for(self, recording_id: str, dictionary: Dictionary) -> MappedColumns:
        """A proposal for a monitor's dictionary; a confirmed mapping stays in it. NotFound."""
        info = self.store.recordings.info(recording_id)
        stored = self.store.recordings.mapped_columns(recording_id)
        columns = self.columns(recording_id)
        before = self.store.mappings.find(info.aircraft, signature(columns.contents))
        if info.mapping_state == "confirmed":
            before = RememberedMapping(info.aircraft or "", stored.mapping)
        with self.present(recording_id):
            proposed, mapped = propose_mapping(
                columns, before, dictionary, self.channels(), stored.statistics
            )
        self._recent.add(recording_id, mapped)
        if proposed.mapping != stored.mapping:
            return replace(proposed, mapping_state="proposed")
        return replace(
            proposed, mapping_state=stored.mapping_state, confirmed_over=stored.confirmed_over
        )

    def check_channels(self, mapping: Mapping) -> None:
        """TelemetryError for a channel that no dictionary here has."""
        if mapping.channels.keys() <= KNOWN.keys():
            return
        known = [*dict.fromkeys(channel.key for channel in self.channels())]
        for key in mapping.channels:
            if key not in known:
                raise TelemetryError(
                    f"the mapping has an unknown channel {key!r}: {instead_of(key, known)}"
                )

    def columns(self, recording_id: str) -> Columns:
        """The columns of a recording. NotFound; StoreError if its folder is missing."""
        with self.present(recording_id):
            return self.files.columns(recording_id)

    def mapped(self, recording_id: str, mapping: Mapping | None = None) -> MappedRecording:
        """The channels of a recording, by default under its own mapping. NotFound; StoreError."""
        stored = self.store.recordings.mapped_columns(recording_id)
        mapping = Mapping.from_plain(stored.mapping) if mapping is None else mapping
        with self.present(recording_id):
            return self._recent.mapped(
                recording_id, mapping, lambda: self.files.columns(recording_id)
            )

    def confirm_mapping(
        self, recording_id: str, mapping: Mapping, aircraft: str | None, *, remember: bool
    ) -> None:
        """Store a mapping, and propose it for the aircraft's next recording. NotFound;
        TelemetryError.

        aircraft: replaces that of the upload. Without an aircraft nothing is remembered, because
        the next recording may be from an aircraft with other signs.
        """
        mapped = self.mapped(recording_id, mapping)
        mapped.scorable()
        columns = self.columns(recording_id)
        before = self.store.recordings.mapped_columns(recording_id)
        confirmed = _confirmed(before, mapped, columns)
        self.store.recordings.confirm_mapping(recording_id, confirmed, aircraft)
        aircraft = self.store.recordings.info(recording_id).aircraft
        if remember and aircraft:
            self.store.mappings.save(aircraft, signature(columns.contents), confirmed.mapping)

    def delete(self, recording_id: str) -> None:
        """Delete a recording with its folder. InUse while it is replayed; KeptPermanently."""
        self.store.recordings.withdraw(recording_id)
        self._recent.forget(recording_id)
        self.files.discard(recording_id)
        self.store.recordings.purge(recording_id)

    @contextmanager
    def present(self, recording_id: str) -> Iterator[None]:
        """Turn missing files into NotFound if the recording was deleted, else StoreError."""
        try:
            with self.files.present(recording_id):
                yield
        except StoreError as error:
            if isinstance(error.__cause__, FileNotFoundError):
                self.store.recordings.info(recording_id)
            raise

    def _begin(self, recording_id: str, length: int) -> Path:
        self.files.require(length)
        isolation.warm_up()
        return self.files.create(recording_id)

    def _read(
        self, folder: Path, upload: Upload, dictionary: Dictionary
    ) -> tuple[MappedColumns, MappedRecording]:
        """Read the file in a folder, and propose a mapping of its columns."""
        with reporting_full_disk():
            read_file(folder / "file", folder / "columns", name=upload.name)
        columns = open_columns(folder / "columns")
        key = signature(columns.contents)
        remembered = self.store.mappings.find(upload.aircraft, key)
        return propose_mapping(columns, remembered, dictionary, self.channels())

    def _admit(
        self,
        recording_id: str,
        name: str,
        aircraft: str | None,
        received: Received,
        mapped: MappedColumns,
        flown: FlownJournal | None = None,
    ) -> None:
        """Add a recording: first a hidden row, then the folder, then show the row."""
        folder = self.files.incoming / recording_id
        self.store.recordings.add(
            recording_id,
            name,
            received.size,
            received.digest,
            open_columns(folder / "columns").contents.format,
            aircraft,
            mapped,
        )
        with reporting_full_disk():
            self.files.admit(recording_id)
        if flown is None:
            self.store.recordings.complete(recording_id)
        else:
            self.store.recordings.complete(recording_id, flown.flight_id, flown.markers)

    def _drop(self, recording_id: str) -> None:
        """Remove all traces of a recording that failed to arrive."""
        try:
            self.files.reject(recording_id)
            with suppress(NotFound):
                self.store.recordings.withdraw(recording_id)
            self.files.discard(recording_id)
            self.store.recordings.purge(recording_id)
        except Exception:
            LOG.exception("recording %s is removed at the next start", recording_id)

    def _recover(self) -> None:
        for recording_id in self.store.recordings.incomplete():
            self.files.discard(recording_id)
            self.store.recordings.purge(recording_id)
        recordings = [info.id for info in self.store.recordings.all()]
        self.files.clear(recordings, self.store.scorings.ids())


def _confirmed(before: MappedColumns, mapped: MappedRecording, columns: Columns) -> MappedColumns:
    warnings = find_warnings(columns, mapped.mapping, mapped.applied)
    confirmed = with_mapping(before, mapped)
    return replace(confirmed, mapping_state="confirmed", confirmed_over=warnings)
