"""What a flight is started with: its monitors, its limits, its source and its plan."""

from collections.abc import Sequence

from app.assessment.monitors_in_use import MonitorsInUse, MonitorsRule
from app.assessment.rulings import RequestedLimits
from app.flights.display_monitors import DisplayMonitor, check_alike, check_has_limits
from app.flights.flight import FlightPlan
from app.flights.flight_limits import change_of_limits
from app.flights.flight_monitors import member, members, monitors_in_use
from app.flights.flight_records import ACCEPT_USELESS, NAME, flight_name, source_of
from app.flights.planned_card import points_of
from app.flights.request import FlightRequest
from app.flights.sources.live import LiveSetup
from app.flights.sources.playback import Script
from app.flights.sources.simulated import SourceError
from app.flights.sources.source import FlownLive, Live, Opening, header_of
from app.flights.sources.udp import UdpAccess
from app.flights.transport import NotPossible
from app.messages import CardPoint
from app.recordings.files import digest_of
from app.recordings.flown_journal import journal_damage
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
        self._store, self._scored, self._journals, self.udp = store, scored, journals, udp

    def new(self, request: FlightRequest, by: str) -> tuple[FlightPlan, Script | LiveSetup]:
        """The plan and what is flown of a requested flight, which is stored. Errors: `start`."""
        monitors = self._asked_monitors(request)
        authority = self._authority(request, monitors)
        monitor_id, monitor_name, monitor, epsilon = authority
        if not request.accept_useless:
            for used in [authority] if monitors is None else members(monitors):
                check_use(used.monitor.evaluation, used.epsilon)
        display = self._display(monitor, [(shown, None) for shown in request.monitors])
        limits = self._asked_limits(request, monitor)
        opening = self._opening(monitor_id, monitor, epsilon, monitors)
        opening = opening._replace(display=display, conditions=request.source_names)
        flown, name = request.source.open(opening)
        name, source = request.name or name, request.source.model_dump(exclude_none=True)
        stored = {**source, NAME: name, ACCEPT_USELESS: request.accept_useless}
        used = [(shown.id, shown.epsilon) for shown in display]
        flown_set = None if monitors is None else (monitors.id, monitors.fixed)
        plan = FlightPlan(
            self._store.flights.add(stored, monitor_id, epsilon, used, flown_set),
            name,
            source,
            monitor,
            monitor_id,
            monitor_name,
            epsilon,
            request.source.mode,
            display,
            limits,
            by,
            request.wait_for_viewer,
            monitors,
            self._points(monitor_id, monitors),
        )
        return plan, flown

    def check_journal(self, info: FlightInfo, journals: Journals) -> None:
        """NotPossible where the journal of a live flight is missing or altered."""
        path, found = journals.path(info.id), None
        if path.exists():
            found = digest_of(path) if info.journal_digest else ""
        if damage := journal_damage(info, found):
            raise NotPossible(
                f"flight {info.id} accepts no samples: it was interrupted and {damage}"
            )

    def resumed(self, info: FlightInfo, journals: Journals) -> tuple[FlightPlan, LiveSetup]:
        """The plan and setup of a live flight of another server, which may still write its journal.

        OSError without one.
        """
        monitor = self._monitor(info.monitor_id)
        shown = self._store.flights.display([info.id]).get(info.id, [])
        display = self._display(monitor, shown)
        monitors = self._monitors_of(info.id)
        opening = self._opening(info.monitor_id, monitor, info.epsilon, monitors)
        opening = opening._replace(display=display)
        source = source_of(info)
        setup = Live.model_validate(source).setup(opening, header_of(journals.path(info.id)))
        plan = FlightPlan(
            info.id,
            flight_name(info),
            source,
            monitor,
            info.monitor_id,
            self._store.monitors.info(info.monitor_id).name,
            info.epsilon,
            display=display,
            monitors=monitors,
            points=self._points(info.monitor_id, monitors),
        )
        return plan, setup

    def _opening(
        self, monitor_id: str, monitor: Monitor, epsilon: float, monitors: MonitorsInUse | None
    ) -> Opening:
        about = self._store, self._scored, monitor_id, monitor, epsilon, self._journals, self.udp
        return Opening(*about, monitors=monitors)

    def _points(self, monitor_id: str, monitors: MonitorsInUse | None) -> dict[str, CardPoint]:
        ids = [monitor_id] if monitors is None else monitors.ids
        return points_of(self._store.campaigns.all(), ids)

    def _asked_monitors(self, request: FlightRequest) -> MonitorsInUse | None:
        """The requested monitor set; the replay of its own flight keeps what that declared."""
        if request.monitor_set is None:
            return None
        fixed = request.declared
        if isinstance(request.source, FlownLive) and not fixed:
            flown = self._store.monitor_sets.of_flights([request.source.flight_id])
            fixed = next((each.fixed for each in flown.values()), fixed)
        info = self._store.monitor_sets.info(request.monitor_set)
        return monitors_in_use(self._store, info, fixed)

    def _monitors_of(self, flight_id: str) -> MonitorsInUse | None:
        """The monitor set of a stored flight; None without one."""
        flown = self._store.monitor_sets.of_flights([flight_id]).get(flight_id)
        return None if flown is None else monitors_in_use(self._store, flown.info, flown.fixed)

    def _authority(self, request: FlightRequest, monitors: MonitorsInUse | None) -> DisplayMonitor:
        """The monitor to begin with; of a set for the declared condition, if none is sent."""
        if monitors is None:
            asked = str(request.monitor)
            monitor, name = self._monitor(asked), self._store.monitors.info(asked).name
            return DisplayMonitor(asked, name, monitor, monitor.check_epsilon(request.epsilon))
        if isinstance(request.source, Live | FlownLive):
            return member(monitors, 0)
        ruling = MonitorsRule(monitors).at()
        if ruling.used is None:
            raise SourceError(
                f"{ruling.reason}, and only a live source sends the flight condition: declare one "
                "of the monitor set in `condition`"
            )
        return member(monitors, ruling.used)

    def _monitor(self, monitor_id: str) -> Monitor:
        """The monitor of a flight. NotFound; LimitsUnknown."""
        monitor = self._store.monitors.get(monitor_id)
        check_has_limits(monitor_id, monitor)
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
