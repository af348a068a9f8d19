"""Where a flight's samples come from: a simulated or stored rollout, a recording, a live source.

A source is a request over the wire; its class opens it and names its kind of flight.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from collections.abc import Mapping as PlainMapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Union

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.assessment.batches import ChannelReader, Names
from app.assessment.compiling import make_ready
from app.assessment.monitors_in_use import MonitorsInUse
from app.assessment.scorer import TrimRule
from app.flights.display_monitors import DisplayMonitor
from app.flights.flight import Flight
from app.flights.shown_flight import ShownFlight
from app.flights.sources.live import LiveFlight, LiveSetup
from app.flights.sources.playback import AssessedTrack, Script
from app.flights.sources.recorded_playback import RecordedScript
from app.flights.sources.replay import TrackFlight
from app.flights.sources.simulated import (
    SourceError,
    Track,
    planned_attitude,
    simulate,
    times,
    trim_angles,
    whole_rollout,
)
from app.flights.sources.udp import UdpAccess
from app.json_codec import Whole
from app.messages import Mode
from app.recipes.recipes import default_test, from_plain, simulated_test
from app.recordings.files import digest_of
from app.recordings.flown_journal import journal_damage
from app.recordings.scored import ScoredRecordings
from app.store.database import Damaged
from app.store.scorings import ScoringInfo
from app.store.store import Store
from app.telemetry.journal import Journals, lines_of
from app.telemetry.mapping.mapping import Mapping
from core.channels import Dictionary
from core.monitor import Monitor
from core.planned_test.planned_test import ManeuverTest
from core.simulation.attitude import attitude_of

FIRST_FREE_PORT = 1024
NO_HEADER: PlainMapping[str, Any] = MappingProxyType({})


class Opening(NamedTuple):
    """What a source needs to be opened.

    scored: recordings; journals: of live flights; None if the server keeps none.   udp: who may
    send datagrams.   display: monitors without alarms.   conditions: names under which a live
    source sends channels of the flight condition, if not their own.   monitors: a set, of which
    `monitor` is the one for the declared condition, or the first.
    """

    store: Store
    scored: ScoredRecordings | None
    monitor_id: str
    monitor: Monitor
    epsilon: float
    journals: Journals | None = None
    udp: UdpAccess = UdpAccess()
    display: tuple[DisplayMonitor, ...] = ()
    conditions: Names = MappingProxyType({})
    monitors: MonitorsInUse | None = None


class Source(BaseModel, ABC):
    """A requested source; its `kind` is its name in SOURCES."""

    model_config = ConfigDict(extra="forbid", strict=True)

    flight: ClassVar[Callable[..., Flight]] = TrackFlight
    """The class of its flights."""
    mode: ClassVar[Mode] = "live"
    """Always shown, so that no replay or simulation is mistaken for live data."""

    @abstractmethod
    def open(self, opening: Opening) -> tuple[Script | LiveSetup, str]:
        """Return what is flown, and its name for people; slow, for a thread.

        SourceError if there is no such flight or the monitor cannot assess it; RecipeError for a
        wrong recipe; the store's NotFound.
        """


class TrackSource(Source):
    """A source of a track, which is assessed when opened."""

    def open(self, opening: Opening) -> tuple[Script, str]:
        track = self.track(opening.store, opening.monitor)
        display = [(shown.monitor, shown.epsilon) for shown in opening.display]
        return AssessedTrack(track, opening.monitor, opening.epsilon, display), self.name()

    def track(self, store: Store, monitor: Monitor) -> Track:
        """Make the track. SourceError if the monitor has another interval."""
        track = self.make(store, monitor)
        if abs(track.dt - monitor.dt) > 1e-9 * monitor.dt:
            raise SourceError(
                f"the source has a sample every {track.dt:g} s, the monitor needs one every "
                f"{monitor.dt:g} s: choose a dataset with that dt, or train a monitor for this one"
            )
        return track

    @abstractmethod
    def make(self, store: Store, monitor: Monitor) -> Track: ...

    @abstractmethod
    def name(self) -> str: ...


class Simulated(TrackSource):
    """A new rollout of a dataset's test, of a recipe, or by default of the monitor's own test.

    Parameters in theta have the given values; the others are then nominal.
    """

    mode = "simulated"
    kind: Literal["simulated"]
    dataset: str | None = Field(default=None, description="id of the dataset whose test to fly")
    recipe: dict[str, Any] | None = Field(
        default=None, description="DatasetRecipe, as for /datasets"
    )
    seed: Whole = Field(default=0, ge=0, le=2**53, description="same seed, same flight")
    theta: dict[str, float] | None = Field(
        default=None, description="aircraft parameters by name; default: random"
    )
    outcome: Literal["any", "unsafe", "safe"] = Field(
        default="any", description="of the random aircraft"
    )

    def make(self, store: Store, monitor: Monitor) -> Track:
        recipe = _recipe(self, store, monitor)
        return simulate(recipe, self.seed, self.theta, self.outcome)

    def name(self) -> str:
        return f"simulated, seed {self.seed}"


class Replay(TrackSource):
    """A stored rollout; an unsafe one continues past its failure if it can be simulated again."""

    mode = "replay"
    kind: Literal["replay"]
    dataset: str = Field(description="id")
    outcome: Literal["unsafe", "safe"]
    rollout: Whole = Field(ge=0, description="number among the rollouts of this outcome")

    def make(self, store: Store, monitor: Monitor) -> Track:
        """The rollout, with the samples after its failure if they can be simulated again."""
        stored = store.datasets.rollout(self.dataset, self.outcome, self.rollout)
        info = store.datasets.info(self.dataset)
        dictionary, y = Dictionary.from_stored(info.dictionary), stored.y
        if dictionary != monitor.dictionary:
            raise SourceError(
                f"the dataset has the channels {', '.join(dictionary.keys)}, the monitor "
                f"{', '.join(monitor.dictionary.keys)}: choose a dataset of the monitor's channels"
            )
        if stored.fail_index is not None:
            y = whole_rollout(info.recipe, stored.theta, y)
        t = times(len(y), info.dt)
        angles = attitude_of(dictionary, t, y, trim_angles(info.recipe)[1])
        test = simulated_test(info.recipe)
        planned = None if test is None else planned_attitude(test, len(t))
        return Track(t, y, info.dt, angles, stored.theta, stored.fail_index, planned)

    def name(self) -> str:
        return f"{self.outcome} rollout {self.rollout}"


class Recorded(Source):
    """A scored recording, by the monitor and epsilon of the scoring."""

    mode = "replay"
    kind: Literal["recording"]
    recording: str = Field(description="id")
    scoring: str = Field(description="id of one of its scorings")

    def open(self, opening: Opening) -> tuple[Script, str]:
        store, monitor = opening.store, opening.monitor
        if opening.monitors is not None:
            raise SourceError(
                "a recording is scored and replayed by one monitor: give it as `monitor`, or "
                "replay the live flight as it was shown"
            )
        if opening.scored is None:
            raise SourceError("this server keeps no recordings: choose a simulated source")
        info = store.scorings.info(self.recording, self.scoring)
        if "monitor_set" in info.request:
            raise SourceError(
                "this recording was scored by a monitor set, which no replay of a scoring shows: "
                "replay the live flight as it was shown, or score it by one monitor"
            )
        if (info.monitor_id, info.epsilon) != (opening.monitor_id, opening.epsilon):
            raise SourceError(
                f"this recording was scored by monitor {info.monitor_name} ({info.monitor_id}) at "
                f"epsilon {info.epsilon:g}: use these, or score it again"
            )
        script = RecordedScript(
            opening.scored.samples(info),
            info.manoeuvres,
            info.dt,
            forecasts=monitor.recipe.predictor.forecasts,
            outside=info.outside_exceedances,
            biases=[
                info.mapping["channels"].get(key, {}).get("bias", 0.0)
                for key in monitor.dictionary.keys
            ],
            theta0=trim_angles(monitor.dataset_recipe)[1],
            display=[self._displayed(shown, info, opening) for shown in opening.display],
            held=opening.scored.limits_timeline(
                info, [monitor, *(shown.monitor for shown in opening.display)]
            ),
            monitor=monitor,
        )
        return script, store.recordings.info(self.recording).name

    def _displayed(
        self, shown: DisplayMonitor, info: ScoringInfo, opening: Opening
    ) -> RecordedScript:
        """The newest scoring of the same samples by a monitor for display. SourceError if none."""
        assert opening.scored is not None
        flown = opening.scored.samples(info)
        for other in opening.store.scorings.of(self.recording):
            by = other.monitor_id, other.epsilon, other.mapping
            is_by_set = "monitor_set" in other.request
            if other.damage or is_by_set or by != (shown.id, shown.epsilon, info.mapping):
                continue
            samples = opening.scored.samples(other)
            if all(np.array_equal(samples[name], flown[name], True) for name in ("t", "y")):
                return RecordedScript(samples, other.manoeuvres, other.dt, forecasts=False)
        raise SourceError(
            f"monitor {shown.name} ({shown.id}) has not scored this recording as it is flown, at "
            f"epsilon {shown.epsilon:g}: score it by that monitor first, over the same manoeuvres"
        )


class Live(Source):
    """Samples received by REST, WebSocket or UDP.

    Channels have their telemetry keys and SI units, unless the mapping of a recording is given.
    """

    flight = LiveFlight
    kind: Literal["live"]
    recording: str | None = Field(
        default=None, description="id of a recording whose mapping reads the channels"
    )
    delay: float | None = Field(
        default=None,
        ge=0.0,
        description="longest wait of a sample for others [s], subtracted from the lead; default: "
        "1.5 intervals of the monitor",
    )
    trim: TrimRule = Field(
        default="detected",
        description="`detected`: each manoeuvre is assessed from the trim before it; `none`: the "
        "samples are already from trim, and all are assessed",
    )
    udp: Whole | None = Field(
        default=None, ge=0, le=65535, description="port to listen on for datagrams; 0: any free one"
    )

    def open(self, opening: Opening) -> tuple[LiveSetup, str]:
        if self.udp is not None:
            self._check_udp(self.udp, opening)
        setup, name = self.setup(opening), "live"
        if self.recording is not None:
            info = opening.store.recordings.info(self.recording)
            if info.mapping_state == "proposed":
                raise SourceError(
                    f"the mapping of {info.name} is only proposed: check and confirm it on the "
                    "recording's page, then start the flight"
                )
            name = f"live, as {info.name}"
        return setup, name

    def _check_udp(self, port: int, opening: Opening) -> None:
        if 0 < port < FIRST_FREE_PORT:
            raise SourceError(
                f"UDP port {port} is reserved: give one from {FIRST_FREE_PORT} on, or 0"
            )
        access = opening.udp
        if not access.is_guarded and (access.is_shared or opening.store.tokens.all()):
            raise SourceError(
                "datagrams carry no token, and this server asks for tokens: set "
                "FOREWARN_UDP_SENDERS to the addresses that may send, or FOREWARN_UDP_KEY to a key "
                "that each batch holds as `key`"
            )

    def setup(self, opening: Opening, header: PlainMapping[str, Any] = NO_HEADER) -> LiveSetup:
        """How its samples are read and scored. header: of the journal of a flight that resumes."""
        monitor = opening.monitor
        if opening.journals is None:
            raise SourceError("this server keeps no live flights: choose a simulated source")
        mapping, aircraft = mapping_of(opening.store, self.recording, header)
        setup = LiveSetup(
            monitor,
            opening.epsilon,
            ChannelReader(
                mapping, header.get("conditions", opening.conditions), monitor.dictionary
            ),
            opening.journals,
            trim_angles(monitor.dataset_recipe)[1],
            self.delay,
            self.trim,
            self.udp,
            opening.udp,
            aircraft=aircraft,
            display=opening.display,
            monitors=opening.monitors,
        )
        members = opening.monitors.members if opening.monitors else [monitor]
        for flown in (*members, *(shown.monitor for shown in opening.display)):
            make_ready(flown)
        setup.scorer()  # refuses a delay that is not shorter than the lead
        return setup


def header_of(path: Path) -> dict[str, Any]:
    """First line of a journal, which describes its flight; empty for an empty one. OSError."""
    return next(lines_of(path), {})


def mapping_of(
    store: Store, recording: str | None, header: PlainMapping[str, Any]
) -> tuple[Mapping | None, str | None]:
    """How a live flight is mapped, and the aircraft of the mapping.

    In the header of its journal; old journals and new flights use the recording's current mapping.
    """
    if "mapping" in header:
        plain = header["mapping"]
        return None if plain is None else Mapping.from_plain(plain), header.get("aircraft")
    if recording is None:
        return None, None
    plain = store.recordings.mapped_columns(recording).mapping
    return Mapping.from_plain(plain), store.recordings.info(recording).aircraft


class FlownLive(Source):
    """An ended live flight from its journal, with its delays, gaps and stale times.

    Its own monitor and epsilon show what was shown; another monitor shows what it would have shown.
    """

    mode = "replay"
    kind: Literal["journal"]
    flight_id: str = Field(description="id of the live flight")

    def open(self, opening: Opening) -> tuple[Script, str]:
        setup = journal_setup(opening, self.flight_id)
        source = opening.store.flights.info(self.flight_id).source
        return ShownFlight(setup, self.flight_id), f"{source.get('name', 'live')}, as shown"


def journal_setup(opening: Opening, flight_id: str) -> LiveSetup:
    """How the journal of an ended flight is read and scored. NotFound; SourceError; Damaged."""
    info, journals = opening.store.flights.info(flight_id), opening.journals
    if info.source.get("kind") != "live" or journals is None:
        raise SourceError(f"flight {flight_id} has no journal: choose a live flight that has ended")
    if not journals.has(flight_id):
        raise SourceError(
            f"the journal of flight {flight_id} is missing: restore the data directory from a "
            "backup"
        )
    if info.status == "running":
        raise SourceError(f"flight {flight_id} is in progress: end it, then score or replay it")
    if damage := journal_damage(info, digest_of(journals.path(flight_id))):
        raise Damaged(f"flight {flight_id}: {damage}: restore the data directory from a backup")
    known = {key: info.source[key] for key in info.source if key in Live.model_fields}
    live = Live.model_validate(known)
    return live.setup(opening, header_of(journals.path(flight_id)))


def _recipe(request: Simulated, store: Store, monitor: Monitor) -> ManeuverTest:
    plain = request.recipe
    if request.dataset is not None:
        if plain is not None:
            raise SourceError("both dataset and recipe are given: give one, or neither")
        plain = store.datasets.info(request.dataset).recipe
    if plain is None:
        plain = monitor.dataset_recipe
    if not plain:
        raise SourceError(
            "this monitor has no test to simulate: give a recipe or a simulated dataset"
        )
    return from_plain(default_test(plain), plain, "dataset")


SOURCES: dict[str, type[Source]] = {
    "simulated": Simulated,
    "replay": Replay,
    "recording": Recorded,
    "live": Live,
    "journal": FlownLive,
}


def mode_of(source: dict[str, Any]) -> Mode:
    kind = SOURCES.get(source.get("kind", ""))
    return "live" if kind is None else kind.mode


if TYPE_CHECKING:
    SourceRequest = Source
else:
    SourceRequest = Annotated[Union[*SOURCES.values()], Field(discriminator="kind")]
