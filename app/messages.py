"""Messages of a flight's WebSockets: JSON objects, distinguished by `type`.

The stream is in DOWN and UP, the uplink of a live source in UPLINK_DOWN and UPLINK_UP. Times `t`
are flight times [s]. `seq` numbers the samples flown, one up per sample whatever the transport
does. `sent` and the heartbeat's `server_time` are times of the server.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite, nan
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from app import json_codec
from core.channels import KEYS, MOST_CHANNELS, Dictionary, Reference, Role
from core.conditions import ConditionKey, Range
from core.flight_events import Alarm, FlightLimits, FlightMarker, FlightMarkerKind, TrimChange
from core.limits.exceedance import ChannelExceedances, LatchedExceedance
from core.limits.limits import Envelope, SafeInterval, Specification, envelope_of
from core.monitor import Assessment
from core.monitor.assessment import Cause, State
from core.monitor.calibration import Guarantee
from core.monitor.peak_forecast import Ahead, NothingAhead, PeakAhead
from core.monitor.status import Level, Status

Mode = Literal["live", "replay", "simulated"]
Outputs = Annotated[list[float | None], Field(min_length=1, max_length=MOST_CHANNELS)]

PlainLimits = dict[str, float | SafeInterval | None]
"""By channel: a magnitude, the ends of an interval, or null for no limit."""


class Message(BaseModel):
    """A message or part of one; unknown fields are errors."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)

    def encode(self) -> str:
        return self.model_dump_json()


class ChannelLimit(Message):
    """One channel: names, units and limit."""

    key: str
    symbol: str
    unit: str
    label: str
    display_unit: str = Field(description="unit that people read")
    display_factor: float = Field(description="factor from `unit` to `display_unit`")
    display_decimals: int = Field(description="meaningful decimals in `display_unit`")
    role: Role = Field(description="outputs respond to controls")
    reference: Reference = Field(description="whether values are deviations from trim")
    largest: float | None = Field(description="magnitude that no aircraft reaches, in `unit`")
    group: str = Field(description="strips of one group belong together")
    formula: str = Field(default="", description="of a computed channel; empty if it is measured")
    low: float | None = Field(description="unsafe from this value down, in `unit`; null: no limit")
    high: float | None = Field(description="unsafe from this value up; null: no limit")
    rest: float = Field(description="value in trimmed flight, from which margins count")
    limit: float | None = Field(description="`high` if it is -`low`; else null")


class Verdict(Message):
    """How a flight was warned of the limit that it exceeded; of a replay, as its recording."""

    exceeded_t: float | None
    """[s] of the exceedance; null where only data missing leave it unknown"""
    lead: float | None = Field(description="[s] from the first risk alarm to it; null without one")
    text: str = Field(description="for people")
    warning: str = ""
    """`Warned 0.45 s before the limit` or `Missed: ...`; else empty"""


class LimitsFrom(Message):
    """Limits in force during part of a flight."""

    t: float | None
    """time of the first sample under them [s]; null for all samples. Of limits put in force by
    hand, one sample interval after the newest until the next comes"""
    limits: PlainLimits | None = Field(description="by channel; null if unknown")
    seq: int | None = Field(default=None, description="first sample, in a record; else null")
    monitor: str = ""
    """id of the monitor in use, of a monitor set; else empty"""

    @model_validator(mode="before")
    @classmethod
    def read_earlier(cls, plain: Any) -> Any:
        """Earlier records have the sample before in `t`, and this time in `first` where known."""
        if isinstance(plain, dict) and "first" in plain:
            first, plain = plain["first"], {key: plain[key] for key in plain if key != "first"}
            plain |= {} if first is None else {"t": first}
        return plain


class TransportState(Message):
    """Position of a flight in its source; `sample` and `n_samples` count source samples."""

    playing: bool
    position: float = Field(description="[s]")
    sample: int
    speed: float = Field(default=1.0, description="factor of the source's rate")
    loop: bool = False
    start: float = Field(default=0.0, description="time of the source's first sample [s]")
    duration: float | None = Field(default=None, description="[s]; null for a live source")
    n_samples: int | None = None
    slipped: float = Field(default=0.0, description="total time that it fell behind its clock [s]")
    seekable: bool = Field(default=False, description="false for a live source")
    waiting: bool = Field(default=False, description="for a first viewer, at most 10 s")


class SampleState(Message):
    """Whether the newest sample was assessed."""

    state: State
    reason: str
    cause: Cause | None = None
    """why it is invalid: outside every manoeuvre, needed channels `missing`, the sample `lost` to
    its time or an implausible value, or the limits in force are not the monitor's
    (`not_applicable`) or unknown; null for its validity; of a live flight that warms up between
    manoeuvres: trim is measured (`rest`), something moves, or `ready` for an input"""


class SampleAssessment(SampleState):
    """Assessment of a sample by a monitor; one for display raises no alarm."""

    p_value: float | None = Field(description="null unless state is `ok`, like alert")
    alert: bool | None


class FlownMonitor(Message):
    """A monitor of a flight: its alarm authority, or one for display."""

    id: str
    name: str
    authority: bool = Field(description="whether its alerts are alarms: true of one monitor")
    lead: float = Field(description="lead time [s], less the longest wait of samples")
    epsilon: float = Field(description="accepted miss rate")
    alert_above: float = Field(description="risk above which it alerts")
    n_unsafe: int
    limits: PlainLimits | None = Field(description="of its training; null: unknown")
    validity: Literal["checked", "not calibrated"]
    warnings: list[str] = Field(description="reasons not to rely on it")


MOST_AHEAD = 40
"""Most forecast samples per frame, of all channels together."""


class ChannelAhead(Message):
    """Forecast of a limited channel in the rest of a test card."""

    low: list[float] = Field(description="90 % of the samples lie between `low` and `high`")
    high: list[float]
    predicted: float | None = Field(description="when the mean first exceeds the limit [s], if so")
    possible: float | None = Field(description="when `low` or `high` first does [s], if so")


class PeakToCome(Message):
    """Peak still to come, as a share of its limit, of the channel nearest to it."""

    mean: float
    low: float = Field(description="90 % of the peaks lie between `low` and `high`")
    high: float


class CardAhead(Message):
    """Forecast of the rest of the manoeuvre by the alarm authority."""

    t: list[float] = Field(description="times of the forecast to the end of the card [s]; thinned")
    channels: dict[str, ChannelAhead]
    peak: PeakToCome | None = Field(default=None, description="of a monitor that forecasts only it")
    why: str = Field(default="", description="why there is no forecast; absent if there is one")


class Frame(SampleAssessment):
    """One sample with its assessment; SI units, N_y in g, channels in order.

    Unknown values are null; p_value, alert and y_hat are null unless state is `ok`.
    `sent`: monotonic milliseconds of the server when the sample was due; null in a record.
    """

    seq: int
    t: float | None
    y: Outputs
    y_hat: Outputs | None
    sent: float | None
    """monotonic milliseconds of the server when it was due; null in a record"""
    sensor: dict[str, float] = Field(default_factory=dict)
    """as recorded, the limited channels that the subtracted trim changes by at least 20 % of the
    limit; absent if there is none"""
    taken: float | None = None
    """of a live source: as `sent`, but when the sample was taken; else absent"""
    attitude: tuple[float | None, float | None, float | None] = (None, None, None)
    """bank, pitch and heading [rad] for display; absent if all are unknown"""
    integrated: bool = False
    """whether an angle is integrated from rates, not measured"""
    ahead: CardAhead | None = None
    """with some samples of a test card that the monitor knows; else absent"""
    display: list[SampleAssessment] = Field(default_factory=list, description="if any")


class ManoeuvreBegun(Message):
    """The beginning of a manoeuvre of a live flight."""

    number: int = Field(description="1, 2, 3 ... in order")
    t: float = Field(description="time of its first sample [s]")


class LateInterval(Message):
    """Flight time whose samples came too late to be shown as current: the display was stale."""

    start: float = Field(description="last sample in time [s]")
    end: float | None = Field(description="next sample in time [s]; null before it")


class ConditionSignal(Message):
    """A channel of the flight condition that a live source must send."""

    key: ConditionKey
    name: str = Field(description="in a batch")
    label: str
    unit: str = Field(description="empty for none")


class LiveStatus(Message):
    """State of a live source."""

    delay: float = Field(description="longest wait of a sample [s], subtracted from the lead")
    interval: float | None = Field(description="of samples [s]; null before the first sample")
    lag: float = Field(description="age of the newest sample less the best of the flight [s]")
    manoeuvre: int = Field(description="number of the current one; 0 for none")
    trim: Literal["detected", "none"]
    begun: list[ManoeuvreBegun] = Field(default_factory=list, description="newest ones, in order")
    trims: list[TrimChange] | None = None
    """where the subtracted trim of a limited channel changed, newest ones, in order; before the
    first, values are as recorded; null where the source sends from trim"""
    late: list[LateInterval] = Field(default_factory=list, description="newest ones, in order")
    resumed: int = Field(default=0, description="times that it was resumed after a crash")
    time_zero: str = ""
    """UTC of the source's time zero, ISO 8601, by the arrival of the fastest batch; empty before
    the first sample, and where the server did not keep it"""
    needed: list[str] = Field(description="channels that the monitors need")
    names: list[str] = Field(description="names that a batch contains, time first")
    conditions: list[ConditionSignal] = Field(default_factory=list)
    """channels of the flight condition that the limits or the monitor depend on"""
    condition: dict[ConditionKey, float | str] = Field(default_factory=dict)
    """newest values as sent, in SI units; without one `missing`, `implausible` or `stale`"""
    batches: int = Field(description="batches received, without repetitions")
    last_sequence: int | None = Field(description="largest number received; null for none")
    malformed: int = Field(description="messages that were no valid batch or reused a number")
    refused: str = Field(default="", description="why the newest message was refused, if it was")
    foreign: int = Field(description="datagrams from other senders, or without the key")
    sender: str | None = Field(default=None, description="host:port; null before the first")
    other_sender: str | None = Field(default=None, description="newest other one, to accept")
    counts: dict[str, int] = Field(description="samples by kind: First live flight in the guide")
    unread: list[str] = Field(default_factory=list, description="names in batches not read")
    udp: str | None = Field(description="host:port for datagrams; null for none")
    problem: str = Field(description="why the journal is not being written; empty if it is")
    drift: int = 0
    """of the source's clock [1e-6], at most 100; 0 in the first minutes"""
    doubts: list[str] = Field(default_factory=list)
    """why the newest samples may not show the aircraft; also advisories"""


@dataclass(frozen=True)
class LimitsStatus(FlightLimits):
    """The limits in force for the newest sample, from a limit set."""

    case: str
    """name of the flight condition; empty if none matches"""
    limits: PlainLimits | None
    """by channel; null if unknown"""
    reason: str
    """why they are unknown; empty if known"""
    since: float | None
    """time of the first sample under them [s], as in LimitsFrom; null: all"""
    widest: dict[str, SafeInterval]
    """by channel, the limits that every case of the set is within, where those in force are
    unknown: only what is beyond them exceeds; else empty"""


class SetCondition(Message):
    """A flight condition of a monitor set, and its monitor."""

    name: str
    ranges: dict[ConditionKey, Range]
    """from the first number to below the second, in SI units; null for no bound"""
    monitor: str = Field(description="id")
    monitor_name: str
    alert_above: float = Field(description="risk above which it alerts")
    warnings: list[str] = Field(description="reasons not to rely on it")


class MonitorSetStatus(Message):
    """The monitor set of a flight, and which of its monitors is in use."""

    id: str
    name: str
    fixed: dict[ConditionKey, float] = Field(description="declared flight condition")
    conditions: list[SetCondition]
    case: str = Field(default="", description="the condition that holds now; empty for none")
    reason: str = Field(default="", description="why no monitor is in use; empty if one is")
    widest: dict[str, SafeInterval] = Field(default_factory=dict)
    """by channel, the limits that every monitor of the set is within, where those in force are
    unknown: only what is beyond them exceeds; else empty"""


class Decided(Message):
    """The headline of a flight: the worst that is true of it."""

    status: Status
    """headline, the worst of: exceeding now, alarm unacknowledged, risk above the alert level,
    stale, invalid, caution unacknowledged or data missing, paused or at the end of its source, no
    sample yet (`no_data`), warming up, ended without an assessed sample, validity not calibrated,
    limit exceeded earlier, exceedance predicted for the rest of the card (`no_alert`), ok"""
    level: Level = Field(description="level of the headline as in 14 CFR 25.1322")
    beside: list[Status]
    """`stale`, `invalid` and `paused` if true and not the headline"""
    exceeded_t: float | None = None
    """time of the first exceedance [s], also after seeking back before it"""
    exceeded_as_recorded: bool = False
    """whether the first exceedance in a flight under way is one of the value as recorded, not from
    trim"""
    verdict: Verdict | None = None
    """verdict on the warning of the exceedance, or that data were missing in an ended flight; else
    null"""
    call: FlightMarker | None = None
    """the call in force in a flight in progress, ABORT before KNOCK IT OFF; null for none: it was
    cleared, or a manoeuvre began"""


class CurrentStatus(Decided):
    """With what the strips show of exceedances."""

    latched: list[LatchedExceedance] = Field(description="exceedances that the strips show")


class CardPoint(Message):
    """The point of a campaign that a monitor was trained for."""

    campaign: str = Field(description="id")
    campaign_name: str
    number: int = Field(description="1, 2, 3 ... in order")
    points: int = Field(description="of the campaign")
    name: str


class CardInput(Message):
    """The planned command of a control, drawn by straight lines."""

    channel: str
    t: list[float] = Field(description="[s] from the first input")
    y: list[float] = Field(description="from trim, in the channel's unit")
    peak: float = Field(description="the largest command, with its sign")
    lasts: float = Field(description="time beyond half the peak [s]")


class PlannedCard(Message):
    """The planned test of a monitor; without inputs where `why` says so."""

    why: str = Field(default="", description="why there is no planned input; empty if there is")
    point: CardPoint | None = Field(default=None, description="null outside a campaign")
    inputs: list[CardInput] = Field(default_factory=list)
    steps: list[float] = Field(default_factory=list)
    """times of the planned steps [s] from the first input"""
    length: float | None = None
    """from the first input to the end [s]; null if unknown"""
    rest: float | None = None
    """rest before an input, in which trim is measured [s]"""
    airspeed: float | None = Field(default=None, description="true, of the model [m/s], if known")
    altitude: float | None = Field(default=None, description="of the model [m], if known")


class AuthorityFacts(Message):
    """The alarm authority: of a monitor set, the monitor in use, or the last one if none is."""

    channels: list[ChannelLimit]
    epsilon: float = Field(description="accepted miss rate")
    guarantee: Guarantee = Field(description="the miss rate holds on average, or for this monitor")
    n_unsafe: int
    validity: Literal["checked", "not calibrated"]
    """`checked`: the flight becomes `invalid` when it is unlike those of training"""
    monitor: dict[str, str] | None
    """id and name; null while no monitor of the set is in use"""
    monitors: list[FlownMonitor] = Field(description="the alarm authority, then those for display")
    warnings: list[str]
    """reasons not to rely on the monitor: problem, colon, figures and remedy"""
    card: PlannedCard | None = Field(default=None, description="null in older recorded messages")
    no_rest: str = Field(description="why it never forecasts the rest of a test card; else empty")
    monitor_set: MonitorSetStatus | None = None
    """null for a flight with one alarm authority throughout"""


class Hello(SampleState, CurrentStatus, AuthorityFacts):
    """First message: all that a display needs to draw the flight."""

    type: Literal["hello"] = "hello"
    flight: str
    name: str
    server_time: str
    lead: float = Field(description="lead time [s], less the longest wait of samples")
    dt: float
    stale_after: float
    """[s] without a sample at speed 1; slower, at least three intervals as played"""
    ahead: CardAhead | None = Field(description="forecast at sample `head`, as in a frame")
    no_plan: str = Field(default="", description="why the scene has no planned flight; else empty")
    source: dict[str, Any]
    mode: Mode = Field(description="live, replayed or simulated")
    theta: dict[str, float] | None
    fail_t: float | None = Field(description="when the source exceeds a limit [s], if known")
    duration: float | None = Field(description="of the source [s]; null for a live one")
    planned_s: float | None = None
    """length of the planned manoeuvre [s]; null if unknown"""
    begun: list[ManoeuvreBegun] = Field(default_factory=list)
    """the inputs of a source that is known from start to end; of a live one as in `live`"""
    trims: list[TrimChange] | None = None
    """as in `live`, of a source that is known from start to end"""
    transport: TransportState
    exceedances: list[ChannelExceedances] = Field(description="exceedances so far, per channel")
    held: list[LimitsFrom]
    """newest changes of the limits; empty if `channels` has those of all samples"""
    head: int = Field(description="newest seq; -1 before the first sample")
    alarms: list[Alarm] = Field(description="unacknowledged ones, and the last acknowledged")
    markers: list[FlightMarker] = Field(description="those not stored yet, and the last stored")
    marker_kinds: list[FlightMarkerKind] = Field(description="kinds of markers that can be set")
    credit: int = Field(description="frames messages sent before the client must grant more")
    live: LiveStatus | None = Field(default=None, description="of a live flight")
    limits: LimitsStatus | None = Field(default=None, description="null: the monitor's own")


class Frames(Message):
    """Newest samples, in order; costs one credit.

    `conflated` samples before them were skipped for this watcher since the last message.
    """

    type: Literal["frames"] = "frames"
    seq: int = Field(description="of the last frame")
    conflated: int
    frames: list[Frame]


class LiveChange(Message):
    """Changed state of the live source: each second, and when a manoeuvre begins."""

    type: Literal["live"] = "live"
    live: LiveStatus


class LimitsChange(Message):
    """The limits in force changed: by hand or with the flight condition."""

    type: Literal["limits"] = "limits"
    limits: LimitsStatus | None = Field(description="as in hello")
    channels: list[ChannelLimit] = Field(description="as in hello, with the limits in force")


class MonitorChange(AuthorityFacts):
    """Another monitor of the flight's set is in use from the next sample on, or none."""

    type: Literal["monitor"] = "monitor"
    held: LimitsFrom = Field(description="the limits that come with it")


class StateChange(SampleState):
    """The monitor's state changed, or the source is late (`stale`)."""

    type: Literal["state"] = "state"


class StatusChange(CurrentStatus):
    """The headline, the verdict or a latched exceedance changed."""

    type: Literal["status"] = "status"


class AlarmRaised(Message):
    """An alarm was raised or acknowledged; never skipped."""

    type: Literal["alarm"] = "alarm"
    alarm: Alarm


class MarkerSet(Message):
    """A marker was set or stored; never skipped."""

    type: Literal["marker"] = "marker"
    marker: FlightMarker


class TransportChange(Message):
    """An action, or the end of the source, changed the transport."""

    type: Literal["transport"] = "transport"
    transport: TransportState


class Screen(Message):
    """A screen that shows the flight."""

    id: str = Field(description="as it gave in the address of the stream")
    number: int = Field(description="1, 2, 3 ... in order of their coming")
    by: str = Field(description="name of its person")


class ScreensChange(Message):
    """A screen came or went, or another one leads the replay."""

    type: Literal["screens"] = "screens"
    screens: list[Screen] = Field(description="those connected now")
    leader: Screen | None
    """the one that leads; gone if it is not among them; null before one has steered"""


class Reset(Message):
    """The next frame, `seq`, does not follow the last one: clear the strips."""

    type: Literal["reset"] = "reset"
    seq: int
    t: float = Field(description="[s] where the flight began or was sought, with sample `since`")
    since: int = 0
    """first sample of the same strips; those up to `seq` are at /assessments"""
    held: list[LimitsFrom] = Field(default_factory=list, description="as in hello, by now")


class Heartbeat(Message):
    """Sent each second while the server runs.

    lost: samples of the flight that could not be recorded.
    unwritten: samples that wait for the store; a few are normal.
    problem: why the store refuses writes, also if none wait; empty if it accepts them.
    conflated: samples skipped for this watcher so far, including waiting ones.
    """

    type: Literal["heartbeat"] = "heartbeat"
    server_time: str
    sent: float = Field(description="monotonic milliseconds of the server")
    lost: int
    unwritten: int
    problem: str
    conflated: int


class Waiting(Message):
    """Samples wait and no credit is left: sent within a second, once until the client gives credit.

    Meanwhile only the newest samples are kept for it.
    """

    type: Literal["waiting"] = "waiting"
    behind: int = Field(description="samples since the last frames message")
    reason: str


class End(Message):
    """Last message; the connection closes."""

    type: Literal["end"] = "end"
    reason: str


class Credit(Message):
    """The client processed n frames messages and accepts as many more."""

    type: Literal["credit"]
    n: int = Field(ge=1, le=1_000)


class Resume(Message):
    """The client has all samples up to seq: send the following ones, or a reset and all kept ones.

    -1 requests all that are kept, about the last minute.
    """

    type: Literal["resume"]
    seq: int = Field(ge=-1)


class Welcome(Message):
    """First message on the uplink: what the server has, and what a batch contains."""

    type: Literal["welcome"] = "welcome"
    flight: str
    last_sequence: int | None
    """largest number of a received batch; null before the first. A source without a buffer
    continues with the next number; one with a buffer repeats all that was not `stored`"""
    names: list[str] = Field(description="names that a batch contains, time first")


class Stored(Message):
    """Batches that are durable: they survive a crash of the server."""

    type: Literal["stored"] = "stored"
    sequences: list[int]
    repeated: list[int] = Field(description="those of them that were repetitions")
    unread: list[str] = Field(default_factory=list, description="names in them that are not read")
    count: int = Field(description="batches in all, including those without a number")


class Refused(Message):
    """A message that was not accepted."""

    type: Literal["refused"] = "refused"
    sequence: int | None = Field(description="number of the batch; null if it has none")
    status: Literal[409, 422, 503]
    """as over REST. 409: the number belongs to another batch; 422: not a valid batch, ignored; 503:
    the disk refuses writes, repeat it later"""
    reason: str


Values = float | None | list[float | None]


class SentBatch(BaseModel):
    """A number, null or a list of them per name; nested objects get names like `a/b`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Values | dict[str, Values]]  # pyright: ignore[reportIncompatibleVariableOverride]

    sequence: int | None = Field(default=None, ge=0)
    """number of the batch; a repetition is used once"""


DOWN: tuple[type[Message], ...] = (
    Hello, Frames, StateChange, StatusChange, AlarmRaised, MarkerSet, TransportChange, LiveChange,
    LimitsChange, MonitorChange, ScreensChange, Reset, Heartbeat, Waiting, End,
)  # fmt: skip
"""Messages of the server on a flight's stream."""
UP: tuple[type[Message], ...] = (Credit, Resume)
"""Messages of a client."""
UPLINK_DOWN: tuple[type[Message], ...] = (Welcome, Stored, Refused, End)
"""Messages of the server on a flight's uplink."""
UPLINK_UP: tuple[type[BaseModel], ...] = (SentBatch,)
"""Messages of a source."""


class MessageError(ValueError):
    """An invalid message of a client."""


_CLIENT: TypeAdapter[Credit | Resume] = TypeAdapter(
    Annotated[Credit | Resume, Field(discriminator="type")]
)


@lru_cache(maxsize=64)
def decode(text: bytes | str) -> Credit | Resume:
    """Read a client's message. MessageError."""
    try:
        return _CLIENT.validate_json(text)
    except ValidationError as error:
        raise MessageError("send credit with n, or resume with seq, as JSON") from error


def validity_word(is_checked: bool) -> Literal["checked", "not calibrated"]:
    return "checked" if is_checked else "not calibrated"


def plain_frame(
    seq: int,
    y: Any,
    assessment: Assessment,
    sent: float | None,
    display: Sequence[Assessment] = (),
    taken: float | None = None,
    ahead: Ahead | None = None,
    attitude: tuple[float, float, float] = (nan, nan, nan),
    is_integrated: bool = False,
    sensor: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """A Frame as plain data; not validated, since every sample needs one. taken: [s]."""
    frame = {
        "seq": seq,
        "t": assessment.t,
        "y": y.tolist(),
        **_plain_assessment(assessment),
        "y_hat": assessment.y_hat if assessment.y_hat is None else assessment.y_hat.tolist(),
        "sent": sent,
    }
    if taken is not None:
        frame["taken"] = round(taken * 1e3, 3)
    if ahead is not None:
        frame["ahead"] = plain_ahead(ahead)
    if any(map(isfinite, attitude)):
        frame["attitude"] = [round(angle, 5) for angle in attitude]
    if is_integrated:
        frame["integrated"] = True
    if sensor:
        frame["sensor"] = sensor
    if display:
        frame["display"] = [_plain_assessment(shown) for shown in display]
    return frame


def _plain_assessment(assessment: Assessment) -> dict[str, Any]:
    return {
        "p_value": assessment.p_value,
        "alert": assessment.alert,
        "state": assessment.state,
        "reason": assessment.reason,
        "cause": assessment.cause,
    }


def plain_ahead(ahead: Ahead) -> dict[str, Any]:
    """A CardAhead as plain data: at most MOST_AHEAD samples, including the last one."""
    if isinstance(ahead, NothingAhead):
        return {"t": [], "channels": {}, "why": ahead.why}
    if isinstance(ahead, PeakAhead):
        peak = {"mean": ahead.mean, "low": ahead.low, "high": ahead.high}
        return {"t": [], "channels": {}, "peak": {key: round(v, 4) for key, v in peak.items()}}
    limited = np.flatnonzero(np.isfinite(ahead.limits)).tolist()
    n = min(len(ahead.t), max(2, MOST_AHEAD // max(len(limited), 1)))
    shown = np.unique(np.linspace(0, len(ahead.t) - 1, n).round().astype(np.int64))
    low, high = ahead.low[shown].round(5), ahead.high[shown].round(5)
    return {
        "t": ahead.t[shown].round(4).tolist(),
        "channels": {
            KEYS[c]: {
                "low": low[:, c].tolist(),
                "high": high[:, c].tolist(),
                "predicted": ahead.predicted(c),
                "possible": ahead.possible(c),
            }
            for c in limited
        },
    }


def encode_frame(frame: dict[str, Any]) -> str:
    """A frame as JSON text, encoded once for all watchers; non-finite values become null."""
    return json_codec.encode(frame).decode()


def encode_frames(seq: int, frames: list[str], conflated: int) -> str:
    return f'{{"type":"frames","seq":{seq},"conflated":{conflated},"frames":[{",".join(frames)}]}}'


def limited_channels(dictionary: Dictionary, specification: Specification) -> list[ChannelLimit]:
    """A telemetry dictionary with the limits of a specification."""
    envelope = envelope_of(specification) or Envelope.unlimited(len(dictionary))
    ends = zip(*(ends.tolist() for ends in envelope), strict=True)
    return [
        ChannelLimit(
            **asdict(channel),
            low=low if isfinite(low) else None,
            high=high if isfinite(high) else None,
            rest=rest,
            limit=high if isfinite(high) and low == -high else None,
        )
        for channel, (low, high, rest) in zip(dictionary.channels, ends, strict=True)
    ]
