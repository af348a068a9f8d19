"""Stored monitors: their portable files, with columns of their main properties.

Also the aircraft that users upload for the scenes of a monitor's flights.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from threading import Lock
from typing import Annotated, Any

from pydantic import Field
from sqlalchemy import Connection, Engine, Row, Select, delete, func, insert, select

from app.recipes.recipes import SentRecipe, to_plain
from app.store import monitor_upload
from app.store.database import Damaged
from app.store.repository import (
    Entries,
    Entry,
    InUse,
    Repository,
    Time,
    Writer,
    columns,
    fetch,
    require,
)
from app.store.tables import (
    airframes,
    datasets,
    display_monitors,
    flights,
    monitor_parts,
    monitor_set_cases,
    monitor_sets,
    monitors,
    new_id,
    now,
    recordings,
    scorings,
)
from core.evaluation.certificate import Share, certificate, warnings_of
from core.limits.limits import PlainSpecification, specification_to_plain
from core.monitor import Monitor, MonitorRecipe
from core.monitor.calibration import alert_above
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError

PART_BYTES = 1024 * 1024
OWN = (
    "dataset_digest", "dataset_recipe", "seed", "version", "dt", "h", "lead", "n_unsafe", "n_early",
    "smallest_epsilon",
)  # fmt: skip
"""Fields that a monitor has under the same names."""
SUPPORT, EVALUATION = "support", "evaluation"
"""SUPPORT: key of the validity calibration, stored inside the column of the evaluation."""
MOST_IN_MEMORY = 4
"""Monitors kept in memory with their search trees."""


@dataclass(frozen=True)
class SupportInfo(Entry):
    """Flights that a monitor's validity is calibrated on."""

    n_safe: int
    """fresh flights that stayed safe"""
    n_unsafe: int
    """fresh flights that failed"""
    level: float
    """largest share of either kind called invalid"""


@dataclass(frozen=True)
class MonitorInfo(Entry):
    """A monitor without its arrays."""

    id: str
    name: str
    created: Time
    digest: str
    """SHA-256 of its portable file"""
    dataset_id: str | None
    """stored dataset it was trained on, if any"""
    dataset_digest: str
    """SHA-256 of its training data"""
    dataset_recipe: SentRecipe
    """planned test it was trained for"""
    recipe: dict[str, Any]
    """predictor, score, calibration and their parameters"""
    seed: int | None
    version: str
    """version of the program that trained it"""
    dt: float
    """required sample interval [s]"""
    h: int
    """lead in samples"""
    lead: float
    """effective lead, h dt [s]"""
    n_unsafe: int
    """failures in calibration"""
    n_early: int
    """failures too early for a timely alert"""
    smallest_epsilon: float
    """smallest miss rate it supports"""
    epsilon: float
    """default miss rate"""
    specification: Annotated[PlainSpecification, Field(serialization_alias="limits")]
    """by channel; a label for limits known only by verdicts; null if unknown"""
    dictionary: dict[str, Any] | None
    """channels of its samples; null for the six lateral ones"""
    support: SupportInfo | None
    """null if its validity is not calibrated: it cannot tell whether a flight resembles its
    training"""
    missed: Share | None
    """failing fresh flights that were valid and had no timely alert, at the given or default
    epsilon or the nearest one tested; null if none was flown"""
    quiet: Share | None
    """safe fresh flights that stayed valid and without an alert, likewise"""
    warnings: list[str]
    """reasons not to rely on it, likewise; a missing evaluation is one"""

    def alert_above(self, epsilon: float) -> float:
        """Risk above which it alerts, for a miss rate that it supports."""
        guarantee = self.recipe.get("guarantee", MonitorRecipe.guarantee)  # older have none
        return alert_above(epsilon, self.n_unsafe, guarantee)


class MonitorRepository(Entries[MonitorInfo]):
    """Monitors by id."""

    table, parts, entry = monitors, monitor_parts, MonitorInfo

    def __init__(self, engine: Engine, writer: Writer) -> None:
        super().__init__(engine, writer)
        self._loaded: OrderedDict[str, Monitor] = OrderedDict()
        self._loaded_lock = Lock()

    def add(self, monitor: Monitor, name: str, dataset_id: str | None = None) -> MonitorInfo:
        """Store a trained monitor.

        dataset_id: stored dataset it was trained on; NotFound if not stored, ValueError if the
        digests differ.
        """
        return self._add(monitor, monitor.to_bytes(), name, dataset_id)

    def add_file(self, content: bytes, name: str) -> MonitorInfo:
        """Store a portable monitor unchanged. MonitorFileError if it is not a valid monitor.

        A separate process reads it first, see app.store.monitor_upload.
        It is linked to its training dataset if that is stored here.
        """
        monitor_upload.check(content, name)
        monitor = from_bytes(content, name)
        same = select(datasets.c.id).where(
            datasets.c.digest == monitor.dataset_digest, datasets.c.complete
        )
        with self._reading() as connection:
            dataset_id = connection.execute(same.order_by(datasets.c.created)).scalars().first()
        return self._add(monitor, content, name, dataset_id)

    def _add(
        self, monitor: Monitor, content: bytes, name: str, dataset_id: str | None
    ) -> MonitorInfo:
        if dataset_id is not None:
            self._check_dataset(monitor, dataset_id)
        support, evaluation = monitor.support, monitor.evaluation
        measured = _measured(evaluation, monitor.recipe.epsilon, support is not None)
        info = MonitorInfo(
            id=new_id(),
            name=name,
            created=now(),
            digest=hashlib.sha256(content).hexdigest(),
            dataset_id=dataset_id,
            recipe=to_plain(monitor.recipe),
            epsilon=monitor.recipe.epsilon,
            specification=specification_to_plain(monitor.specification),
            dictionary=monitor.dictionary.stored,
            support=support and SupportInfo(len(support.safe), len(support.unsafe), support.level),
            **measured,
            **{name: getattr(monitor, name) for name in OWN},
        )
        if info.support is not None:
            evaluation = (evaluation or {}) | {SUPPORT: asdict(info.support)}
        row = vars(info) | {EVALUATION: evaluation}
        for name in (SUPPORT, *measured):
            del row[name]
        self._add_in_parts(monitors, row, monitor_parts, _parts(info.id, content))
        return info

    def _check_dataset(self, monitor: Monitor, dataset_id: str) -> None:
        query = select(datasets.c.digest).where(datasets.c.complete, datasets.c.id == dataset_id)
        with self._reading() as connection:
            digest = fetch(connection, query, "dataset", dataset_id).digest
        if digest != monitor.dataset_digest:
            raise ValueError(
                f"dataset {dataset_id} is not the one this monitor was trained on (the digests "
                "differ): give the dataset it was trained on, or none"
            )

    def info(self, identity: str, epsilon: float | None = None) -> MonitorInfo:
        """epsilon: for its warnings; None for its default."""
        query = self._query().where(monitors.c.id == identity)
        with self._reading() as connection:
            return self._entry(fetch(connection, query, "monitor", identity), epsilon)

    def get(self, monitor_id: str) -> Monitor:
        """The monitor, ready to assess; the last few stay in memory."""
        with self._loaded_lock:
            if monitor_id in self._loaded:
                self._loaded.move_to_end(monitor_id)
                return self._loaded[monitor_id]
        try:
            monitor = from_bytes(self.file(monitor_id), f"stored monitor {monitor_id}")
        except MonitorFileError as error:
            raise Damaged(str(error)) from error
        if monitor.evaluation is None:  # older files did not contain it
            monitor = replace(monitor, evaluation=self.evaluation(monitor_id))
        with self._loaded_lock:
            self._loaded[monitor_id] = monitor
            while len(self._loaded) > MOST_IN_MEMORY:
                self._loaded.popitem(last=False)
        return monitor

    def file(self, monitor_id: str) -> bytes:
        """The portable file, byte for byte as it was added. StoreError if damaged."""
        query = select(monitor_parts.c.content).where(monitor_parts.c.monitor_id == monitor_id)
        with self._reading() as connection:
            info = self._fetch(connection, monitor_id)
            content = b"".join(
                connection.execute(query.order_by(monitor_parts.c.part)).scalars().all()
            )
        if hashlib.sha256(content).hexdigest() != info.digest:
            raise Damaged(
                f"monitor {info.name} ({monitor_id}) is damaged (its digest does not match): train "
                "it again, or add its file again"
            )
        return content

    def evaluation(self, monitor_id: str) -> dict[str, Any] | None:
        """Evaluation of a monitor on fresh flights, if any."""
        query = self._query().where(monitors.c.id == monitor_id)
        with self._reading() as connection:
            return _evaluation(fetch(connection, query, "monitor", monitor_id).evaluation)

    def used(
        self, pairs: Iterable[tuple[str, float | None]]
    ) -> dict[tuple[str, float | None], MonitorInfo]:
        """Monitors by id and the epsilon they are used with, None for their own.

        Their warnings are for this epsilon. Without those that were deleted.
        """
        wanted = set(pairs)
        query = self._query().where(monitors.c.id.in_({identity for identity, _ in wanted}))
        with self._reading() as connection:
            rows = {row.id: row for row in connection.execute(query)}
        return {
            (identity, epsilon): self._entry(rows[identity], epsilon)
            for identity, epsilon in wanted
            if identity in rows
        }

    def delete(self, monitor_id: str) -> None:
        """Delete a monitor. InUse if flights, scorings or monitor sets refer to it."""
        with self._deleting() as connection:
            name = self._fetch(connection, monitor_id).name
            if users := _users(connection, monitor_id):
                raise InUse(f"monitor {name}", users)
            connection.execute(delete(monitors).where(monitors.c.id == monitor_id))
        with self._loaded_lock:
            self._loaded.pop(monitor_id, None)

    def _query(self) -> Select:
        return super()._query().add_columns(monitors.c.evaluation)

    def _entry(self, row: Row, epsilon: float | None = None) -> MonitorInfo:
        values = dict(row._mapping)
        stored = values.pop(EVALUATION)
        support = (stored or {}).get(SUPPORT)
        return MonitorInfo(
            **values,
            support=support and SupportInfo(**support),
            **_measured(_evaluation(stored), epsilon or values["epsilon"], support is not None),
        )


def _evaluation(stored: dict[str, Any] | None) -> dict[str, Any] | None:
    return {key: value for key, value in (stored or {}).items() if key != SUPPORT} or None


def _measured(
    evaluation: dict[str, Any] | None, epsilon: float, is_calibrated: bool
) -> dict[str, Any]:
    """Fields of a MonitorInfo that depend on epsilon: results on fresh flights, and warnings."""
    tested = certificate(evaluation, epsilon)
    return {
        "missed": tested and tested.missed,
        "quiet": tested and tested.quiet,
        "warnings": warnings_of(evaluation, epsilon, is_calibrated=is_calibrated),
    }


def _users(connection: Connection, monitor_id: str) -> list[tuple[str, str]]:
    """Flights, scorings and monitor sets that use a monitor: their kind and id."""
    displaying = select(display_monitors.c.flight_id).where(
        display_monitors.c.monitor_id == monitor_id
    )
    uses_it = (flights.c.monitor_id == monitor_id) | flights.c.id.in_(displaying)
    of_flights = select(flights.c.id, flights.c.status).where(uses_it)
    of_scorings = (
        select(scorings.c.id, recordings.c.name)
        .join(recordings, recordings.c.id == scorings.c.recording_id)
        .where(scorings.c.monitor_id == monitor_id)
    )
    parts = monitor_set_cases.c
    of_sets = select(monitor_sets.c.id, monitor_sets.c.name).join(monitor_set_cases).distinct()
    of_sets = of_sets.where(parts.monitor_id == monitor_id).order_by(monitor_sets.c.name)
    return [
        *((f"monitor set {row.name}", row.id) for row in connection.execute(of_sets)),
        *(
            (f"{row.status} flight", row.id)
            for row in connection.execute(of_flights.order_by(flights.c.created))
        ),
        *(
            (f"scoring of {row.name}", row.id)
            for row in connection.execute(of_scorings.order_by(scorings.c.created))
        ),
    ]


def _parts(monitor_id: str, content: bytes) -> Iterator[dict[str, Any]]:
    for part, first in enumerate(range(0, len(content), PART_BYTES)):
        yield {
            "monitor_id": monitor_id,
            "part": part,
            "content": content[first : first + PART_BYTES],
        }


@dataclass(frozen=True)
class AirframeInfo:
    """An aircraft that was uploaded for the scenes of a monitor."""

    created: Time
    by: str
    """person who uploaded it"""
    digest: str
    """SHA-256 of the file"""
    size: int
    """[bytes]"""


class AirframeRepository(Repository):
    """At most one for each monitor, deleted with it."""

    def put(self, monitor_id: str, content: bytes, by: str) -> AirframeInfo:
        """Store a file in place of any before. NotFound without such a monitor."""
        info = AirframeInfo(now(), by, hashlib.sha256(content).hexdigest(), len(content))
        row = {"created": info.created, "by": by, "digest": info.digest, "content": content}
        with self._writing() as connection:
            require(connection, monitors, monitor_id)
            connection.execute(delete(airframes).where(airframes.c.monitor_id == monitor_id))
            connection.execute(insert(airframes).values(monitor_id=monitor_id, **row))
        return info

    def info(self, monitor_id: str) -> AirframeInfo | None:
        """NotFound without such a monitor."""
        size = func.length(airframes.c.content).label("size")
        query = select(*columns(airframes, AirframeInfo), size)
        with self._reading() as connection:
            require(connection, monitors, monitor_id)
            row = connection.execute(query.where(airframes.c.monitor_id == monitor_id)).first()
        return None if row is None else AirframeInfo(**row._mapping)

    def file(self, monitor_id: str) -> bytes | None:
        query = select(airframes.c.content).where(airframes.c.monitor_id == monitor_id)
        with self._reading() as connection:
            return connection.execute(query).scalar()

    def remove(self, monitor_id: str) -> None:
        """No effect where there is none. NotFound without such a monitor."""
        with self._deleting() as connection:
            require(connection, monitors, monitor_id)
            connection.execute(delete(airframes).where(airframes.c.monitor_id == monitor_id))
