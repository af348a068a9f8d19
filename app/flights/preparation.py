"""What a flight is started with: its monitors, its limits, its source and its plan."""

from collections.abc import Sequence

from app.assessment.limits_in_force import RequestedLimits
from app.flights.display_monitors import DisplayMonitor, check_alike, check_limits
from app.flights.flight import FlightPlan
from app.flights.flight_limits import change_of_limits
from app.flights.flight_records import ACCEPT_USELESS, NAME, flight_name, source_of
from app.flights.request import FlightRequest
from app.flights.shown_flight import ShownFlight
from app.flights.sources.live import LiveSetup
from app.flights.sources.playback import Script
from app.flights.sources.simulated import SourceError
from app.flights.sources.source import FlownLive, Live, Opening, header_of, journal_setup
from app.flights.sources.udp import UdpAccess
from app.flights.transport import NotPossible
from app.recordings.scored import ScoredRecordings
from app.store.flights import FlightInfo
from app.store.store import Store
from app.telemetry.journal import Journals
from core.evaluation.certificate import check_use
from core.monitor import Monitor


class Preparation:
    """Prepares the flights of a server; slow, for a thread.

    scored, journals: None if the server keeps none.   udp: who may send datagrams.
    """

    def __init__(
        self,
        store: Store,
        scored: ScoredRecordings | None,
        journals: Journals | None,
        udp: UdpAccess,
    ) -> None:
        self._store, self._scored, self._journals, self._udp = store, scored, journals, udp

    def new(self, request: FlightRequest, by: str) -> tuple[FlightPlan, Script | LiveSetup]:
        """The plan and what is flown of a requested flight, which is stored. Errors: `start`."""
        monitor = self._monitor(request.monitor)
        epsilon = monitor.check_epsilon(request.epsilon)
        if not request.accept_useless:
            check_use(monitor.evaluation, epsilon)
        display = self._display(monitor, [(monitor_id, None) for monitor_id in request.monitors])
        limits = self._asked_limits(request, monitor)
        opening = self._opening(request.monitor, monitor, epsilon)
        opening = opening._replace(display=display, conditions=request.source_names)
        flown, name = request.source.open(opening)
        name, source = request.name or name, request.source.model_dump(exclude_none=True)
        stored = {**source, NAME: name, ACCEPT_USELESS: request.accept_useless}
        used = [(shown.id, shown.epsilon) for shown in display]
        monitor_name = self._store.monitors.info(request.monitor).name
        plan = FlightPlan(
            self._store.flights.add(stored, request.monitor, epsilon, used),
            name,
            source,
            monitor,
            request.monitor,
            monitor_name,
            epsilon,
            request.source.mode,
            display,
            limits,
            by,
            request.wait_for_viewer,
        )
        return plan, flown

    def resumed(self, info: FlightInfo, journals: Journals) -> tuple[FlightPlan, LiveSetup]:
        """The plan and setup of a live flight of a killed server. NotPossible without a journal."""
        monitor = self._monitor(info.monitor_id)
        shown = self._store.flights.display([info.id]).get(info.id, [])
        display = self._display(monitor, shown)
        opening = self._opening(info.monitor_id, monitor, info.epsilon)._replace(display=display)
        source, path = source_of(info), journals.path(info.id)
        live = Live.model_validate(source)
        if not path.exists():
            raise NotPossible(
                f"flight {info.id} accepts no samples: it was interrupted and its journal is "
                "missing"
            )
        setup = live.setup(opening, header_of(path))
        plan = FlightPlan(
            info.id,
            flight_name(info),
            source,
            monitor,
            info.monitor_id,
            self._store.monitors.info(info.monitor_id).name,
            info.epsilon,
            display=display,
        )
        return plan, setup

    def rescored(
        self, flight_id: str, monitor_id: str | None, epsilon: float | None
    ) -> tuple[ShownFlight, Opening]:
        """Rescore an ended live flight from its journal.

        monitor_id, epsilon: those of the flight if None; for another monitor its own epsilon.
        NotFound; SourceError if it has no journal; LimitsUnknown; ValueError for the epsilon.
        """
        info = self._store.flights.info(flight_id)
        is_same = monitor_id in (None, info.monitor_id)
        monitor = self._monitor(monitor_id or info.monitor_id)
        epsilon = info.epsilon if is_same and epsilon is None else monitor.check_epsilon(epsilon)
        opening = self._opening(monitor_id or info.monitor_id, monitor, epsilon)
        return ShownFlight(journal_setup(opening, flight_id), flight_id), opening

    def _opening(self, monitor_id: str, monitor: Monitor, epsilon: float) -> Opening:
        return Opening(
            self._store, self._scored, monitor_id, monitor, epsilon, self._journals, self._udp
        )

    def _monitor(self, monitor_id: str) -> Monitor:
        """The monitor of a flight. NotFound; LimitsUnknown."""
        monitor = self._store.monitors.get(monitor_id)
        check_limits(monitor_id, monitor)
        return monitor

    def _display(
        self, authority: Monitor, shown: Sequence[tuple[str, float | None]]
    ) -> tuple[DisplayMonitor, ...]:
        """The monitors of a flight for display. NotFound; SourceError; LimitsUnknown.

        shown: id and epsilon of each; None for the monitor's own epsilon.
        """
        monitors = self._store.monitors
        display = tuple(
            DisplayMonitor(shown_id, monitors.info(shown_id).name, monitor, checked)
            for shown_id, epsilon in shown
            for monitor in (monitors.get(shown_id),)
            for checked in (monitor.check_epsilon(epsilon),)
        )
        check_alike(authority, display)
        return display

    def _asked_limits(self, request: FlightRequest, monitor: Monitor) -> RequestedLimits | None:
        if request.limit_set is None:
            return None
        if isinstance(request.source, FlownLive):
            raise SourceError(
                "a replay of a live flight keeps the limits of that flight: leave out limit_set"
            )
        asked = request.limit_set, request.limit_set_version, request.declared
        return change_of_limits(self._store, monitor, *asked)
