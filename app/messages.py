"""What goes over a flight's WebSocket: JSON objects told apart by `type`.

Down: hello, frames, state, status, alarm, marker, transport, live, limits, reset, heartbeat,
waiting, end.
Up: credit, resume.
Times `t` are the flight's own [s]; `seq` numbers the samples flown, one up a sample, whatever the
transport does; `sent` and the heartbeat's `server_time` are the server's.
"""

from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from app import json_codec
from core.channels import CHANNELS, KEYS
from core.flight_markers import FlightMarkerKey, FlightMarkerKind
from core.monitor import Assessment
from core.monitor.assessment import Cause, State
from core.monitor.calibration import Guarantee
from core.monitor.peak_forecast import Ahead, NothingAhead, PeakAhead
from core.monitor.status import AlarmKind, Level, Status
from core.specification import Limits, Specification

Mode = Literal["live", "replay", "simulated"]
Judged = Literal["from_trim", "recorded", "both"]
Outputs = Annotated[list[float | None], Field(min_length=6, max_length=6)]


class Message(BaseModel):
    """A message or part of one; what it does not know is an error."""

    model_config = ConfigDict(extra="forbid")

    def encode(self) -> str:
        """Return it as JSON text."""
        return self.model_dump_json()


class ChannelLimit(Message):
    """One channel as it is named, drawn and limited."""

    key: str
    symbol: str
    unit: str
    label: str
    display_unit: str = Field(description="unit that people read")
    display_factor: float = Field(description="times a value in `unit` is one in `display_unit`")
    display_decimals: int = Field(description="digits behind the point that mean something there")
    limit: float | None = Field(description="unsafe from this magnitude on, in `unit`")


class MeasuredExceedance(Message):
    """A measured sample that exceeds a limit; SI units, N_y in g."""

    channel: str = Field(description="key of the one furthest beyond its limit")
    value: float
    limit: float
    judged: Judged = Field(
        description="which value exceeds it: `from_trim`, as the monitor and every verdict take "
        "it, as `recorded`, or both, as where nothing is subtracted"
    )


class ChannelExceedances(Message):
    """What a flight came to in one channel, of its measured exceedances; SI units, N_y in g."""

    channel: str = Field(description="key")
    n: int = Field(description="exceedances, each from its first sample on")
    first_t: float = Field(description="[s] at which the first began")
    last_t: float = Field(description="[s] at which the newest began")
    worst: float = Field(description="value that is furthest beyond the limit in force with it")
    worst_t: float = Field(description="[s]")
    limit: float = Field(description="that the worst one exceeds")


class Verdict(Message):
    """How a flight was warned of the limit that it exceeded; of a replay, as its recording."""

    exceeded_t: float = Field(description="[s] of the exceedance")
    lead: float | None = Field(
        description="[s] from the first alarm of a risk to it; null where there was none before"
    )
    text: str = Field(description="for people")
    warning: str = Field(
        default="",
        description="`Warned 0.45 s before the limit` or `Missed: no alert before the limit`, "
        "shown beside the headline; empty where the monitor could not warn",
    )


class LatchedExceedance(Message):
    """An exceedance from trim that a strip shows until it was acknowledged and is over."""

    channel: str = Field(description="key")
    t: float = Field(description="[s] at which it began")
    value: float = Field(description="largest since, in the channel's `unit`")
    over: bool = Field(description="whether the newest sample exceeds the limit")
    acknowledged: bool


class LimitsFrom(Message):
    """Limits that hold, or held, during a flight."""

    t: float | None = Field(description="[s] of the sample before the first one; null for all")
    limits: dict[str, float | None] | None = Field(
        description="by channel; null where it could not be told which hold"
    )
    seq: int | None = Field(
        default=None,
        description="the first sample itself, in a record: times return where a flight is sought; "
        "null elsewhere and in records of before",
    )


class Alarm(Message):
    """A latched warning or caution: it stays until someone acknowledges it."""

    id: str = Field(description="of this flight's alarms; path of its acknowledgement")
    number: int = Field(description="1, 2, 3 ... in the order raised")
    seq: int = Field(
        description="sample that raised it; of a late source the last one that came, -1 for none"
    )
    t: float = Field(description="[s]")
    p_value: float | None
    kind: AlarmKind = Field(
        default="risk",
        description="a predicted exceedance, or a measured one: warnings; a monitor that is not "
        "applicable (`invalid`) or a late source (`stale`): cautions",
    )
    level: Level = Field(
        default=Level.WARNING,
        description="14 CFR 25.1322: `warning` asks for action now, `caution` for attention now",
    )
    exceedance: MeasuredExceedance | None = Field(default=None, description="of kind `limit`")
    reason: str | None = Field(default=None, description="of a caution: why")
    cause: Cause | None = Field(
        default=None, description="of a monitor that is not applicable, as of a frame"
    )
    raised: str = Field(description="UTC, ISO 8601")
    acknowledged: str | None = Field(default=None, description="UTC, ISO 8601")
    by: str | None = None
    stored: bool = Field(
        default=False, description="false while the store has not taken it: it would not survive"
    )


class FlightMarker(Message):
    """A marker that someone set in the flight; it neither ends nor pauses it."""

    number: int = Field(description="1, 2, 3 ... in the order set")
    kind: FlightMarkerKey = Field(title="Call")
    word: str = Field(description="how people call its kind")
    meaning: str = Field(description="of its kind")
    level: Level
    seq: int = Field(description="newest sample then; -1 before the first")
    t: float = Field(description="[s] of that sample")
    created: str = Field(description="UTC, ISO 8601")
    by: str
    text: str | None = None
    stored: bool = Field(
        default=False, description="false while the store has not taken it: it would not survive"
    )


class TransportState(Message):
    """Where a flight is in its source; `sample` and `n_samples` count the source's samples."""

    playing: bool
    speed: float = Field(description="times the source's own rate")
    loop: bool
    start: float = Field(description="[s] of the source's first sample; 0 for a live source")
    position: float = Field(description="[s]")
    duration: float | None = Field(description="[s]; null for a live source")
    sample: int
    n_samples: int | None
    slipped: float = Field(description="[s] by which the flight could not keep its clock, in all")
    seekable: bool = Field(description="false for a live source: it only plays")
    waiting: bool = Field(
        default=False,
        description="whether it waits at its start for a first viewer: it plays from the first "
        "connection to the stream on, or after 10 s",
    )


class DisplayAssessment(Message):
    """What a monitor that is flown for display says of a sample; it raises no alarm."""

    p_value: float | None = Field(description="null unless state is `ok`, as alert is")
    alert: bool | None
    state: State
    reason: str
    cause: Cause | None = Field(default=None, description="as of a frame")


class FlownMonitor(Message):
    """A monitor of a flight: its one alarm authority, or one that is flown for display."""

    id: str
    name: str
    authority: bool = Field(description="whether its alerts are alarms; one monitor of a flight is")
    lead: float = Field(
        description="[s] ahead that its alerts warn, less what live samples may wait"
    )
    epsilon: float = Field(description="accepted miss rate")
    alert_above: float = Field(description="risk above which it alerts")
    n_unsafe: int
    limits: dict[str, float | None] | None = Field(
        description="that it warns of by channel, whatever is in force; null where it says none"
    )
    validity: Literal["checked", "not calibrated"]
    warnings: list[str] = Field(description="what speaks against relying on it")


MOST_AHEAD = 40
"""Samples to come in a frame, of all channels together."""


class ChannelAhead(Message):
    """What is to be measured of a limited channel in the rest of a test card."""

    low: list[float] = Field(description="that 90 % of the samples lie above `low`, below `high`")
    high: list[float]
    predicted: float | None = Field(description="[s] when the mean first exceeds the limit, if so")
    possible: float | None = Field(description="[s] when `low` or `high` first does, if so")


class PeakToCome(Message):
    """The peak of what is left, as a share of its limit, of the channel that comes nearest."""

    mean: float
    low: float = Field(description="that 90 % of the peaks lie above `low`, below `high`")
    high: float


class CardAhead(Message):
    """What is left of the manoeuvre, as the alarm authority forecasts it by this sample."""

    t: list[float] = Field(description="[s] of samples to come, to the end of the card; thinned")
    channels: dict[str, ChannelAhead]
    peak: PeakToCome | None = Field(
        default=None, description="of a monitor that forecasts the peak alone; left out elsewhere"
    )
    why: str = Field(
        default="", description="why nothing is forecast of it; left out where something is"
    )


class Frame(Message):
    """One sample and what the monitor says of it; SI units, N_y in g, channels in order.

    Null where a value is unknown; p_value, alert and y_hat are null unless state is `ok`.
    `sent`: monotonic milliseconds of the server when the sample was due, null in a record.
    `taken`: the same of when it was taken, where that is known to be earlier: of a live source.
    """

    seq: int
    t: float | None
    y: Outputs
    p_value: float | None
    alert: bool | None
    state: State
    reason: str
    cause: Cause | None = Field(
        default=None,
        description="of an invalid sample, where it has a word of its own: nothing was to be "
        "assessed there (`between_manoeuvres`), other limits are in force than the monitor's "
        "(`not_applicable`), or nobody can tell which are (`limits_unknown`)",
    )
    y_hat: Outputs | None
    sent: float | None
    taken: float | None = Field(
        default=None,
        description="monotonic milliseconds of the server when a live source took it: it was due "
        "by as much later as its source lags; left out elsewhere",
    )
    ahead: CardAhead | None = Field(
        default=None,
        description="with some samples of a test card under way, of a monitor that knows the card, "
        "while someone watches; left out elsewhere",
    )
    display: list[DisplayAssessment] = Field(
        default_factory=list,
        description="of the monitors flown for display, in the order of `monitors`; left out "
        "where there are none",
    )


class ManoeuvreBegun(Message):
    """Where a manoeuvre of a live flight began."""

    number: int = Field(description="1, 2, 3 ... in the order begun")
    t: float = Field(description="[s] of its first sample")


class LiveStatus(Message):
    """How a live source does."""

    delay: float = Field(
        description="[s] that a sample waits for others at most; subtracted from the lead shown"
    )
    interval: float | None = Field(
        description="[s] at which the source samples; null before the first sample"
    )
    lag: float = Field(
        description="[s] by which the newest sample came later than the quickest of the last minute"
    )
    manoeuvre: int = Field(description="1, 2, 3 ... of the one under way; 0 for none")
    trim: Literal["detected", "none"]
    begun: list[ManoeuvreBegun] = Field(
        default_factory=list, description="the newest manoeuvres, that under way included"
    )
    resumed: int = Field(
        default=0, description="times that the flight went on after its server was killed"
    )
    needed: list[str] = Field(description="channels that the monitor cannot do without")
    names: list[str] = Field(description="of what a batch holds, time first")
    batches: int = Field(description="that came, without repeated ones")
    last_sequence: int | None = Field(description="largest number of a batch; null for none")
    malformed: int = Field(
        description="messages that were no batch, or had the number of another one"
    )
    refused: str = Field(
        default="", description="why the newest message was one of them; empty where it was a batch"
    )
    foreign: int = Field(description="datagrams of somebody else than the source")
    counts: dict[str, int] = Field(
        description="samples by kind: see First live flight in the guide"
    )
    unread: list[str] = Field(
        default_factory=list, description="names that batches held and nothing reads, the first 20"
    )
    udp: str | None = Field(description="host:port that listens for datagrams; null for none")
    problem: str = Field(
        description="why the journal takes nothing at present; empty while it does"
    )


class LimitsStatus(Message):
    """Which limits hold for the newest sample, where a limit set is in force."""

    number: int = Field(description="1, 2, 3 ... in the order put in force during the flight")
    limit_set: str = Field(description="id")
    name: str = Field(description="of the limit set")
    version: int
    case: str = Field(description="name of the flight condition; empty where it is none of them")
    limits: dict[str, float | None] | None = Field(
        description="by channel; null where it cannot be told which hold"
    )
    reason: str = Field(description="why it cannot be told; empty where it can")
    since: float | None = Field(
        description="[s] of the sample before the first one that these hold for; null for all"
    )
    fixed: dict[str, float] = Field(description="flight conditions that are declared")
    seq: int = Field(description="first sample that this version holds for")
    t: float = Field(description="[s] of the sample before; 0 before the first")
    created: str = Field(description="UTC, ISO 8601")
    by: str = Field(description="who put it in force")


class Hello(Message):
    """First message: everything a display needs to draw this flight."""

    type: Literal["hello"] = "hello"
    flight: str
    name: str
    server_time: str
    channels: list[ChannelLimit]
    epsilon: float = Field(description="accepted miss rate")
    guarantee: Guarantee = Field(
        description="whether the miss rate is promised on average or of the monitor itself"
    )
    n_unsafe: int
    lead: float = Field(
        description="[s] ahead that alerts warn: the monitor's, less what live samples may wait"
    )
    dt: float
    stale_after: float = Field(
        description="[s] without a sample before what is shown is stale, at speed 1; below, three "
        "intervals as played if that is longer"
    )
    validity: Literal["checked", "not calibrated"] = Field(
        description="whether the flight becomes `invalid` once it is unlike those of training"
    )
    monitor: dict[str, str]
    monitors: list[FlownMonitor] = Field(
        description="the alarm authority, then those flown for display"
    )
    warnings: list[str] = Field(
        description="what the monitor's test flights say against relying on it at this epsilon, "
        "or that it was not tested; what is wrong, a colon, figures and remedy"
    )
    no_rest: str = Field(
        description="why the alarm authority forecasts nothing of the rest of the test card, of no "
        "flight; empty where it does"
    )
    ahead: CardAhead | None = Field(
        description="what it forecasts of the rest by the newest sample, `head`, as of a frame"
    )
    source: dict[str, Any]
    mode: Mode = Field(description="whether its samples are measured now, replayed or simulated")
    theta: dict[str, float] | None
    fail_t: float | None = Field(description="[s] where the source is known to exceed a limit")
    duration: float | None
    transport: TransportState
    state: State
    reason: str
    cause: Cause | None = Field(default=None, description="as of a frame")
    status: Status
    level: Level
    beside: list[Status]
    exceeded_t: float | None = Field(
        default=None,
        description="[s] of the first exceedance that the flight has come to, sought back or not",
    )
    verdict: Verdict | None = Field(
        default=None, description="on that exceedance; null before one and where none is known"
    )
    exceedances: list[ChannelExceedances] = Field(
        description="that the flight has come to, of each channel that had one"
    )
    latched: list[LatchedExceedance] = Field(description="as strips that saw all of it show them")
    held: list[LimitsFrom] = Field(
        description="limits since the flight began or was sought, the newest changes; empty where "
        "they are those of `channels` all along"
    )
    head: int = Field(description="newest seq; -1 before the first sample")
    alarms: list[Alarm] = Field(description="all that are open, and the last acknowledged ones")
    markers: list[FlightMarker] = Field(description="all that wait for the store, the last others")
    marker_kinds: list[FlightMarkerKind] = Field(description="that may be set, with their words")
    credit: int = Field(
        description="messages of frames that may come before the client grants more"
    )
    live: LiveStatus | None = Field(default=None, description="of a live flight")
    limits: LimitsStatus | None = Field(
        default=None, description="null where the monitor's own limits are those in force"
    )


class Frames(Message):
    """Newest samples, in order; costs one credit.

    `conflated` samples before them were left out for this watcher since the last message.
    """

    type: Literal["frames"] = "frames"
    seq: int = Field(description="of the last frame")
    conflated: int
    frames: list[Frame]


class LiveChange(Message):
    """How the live source does, where that changed: each second, and as a manoeuvre begins."""

    type: Literal["live"] = "live"
    live: LiveStatus


class LimitsChange(Message):
    """Another version of a limit set was put in force, or another flight condition holds."""

    type: Literal["limits"] = "limits"
    limits: LimitsStatus | None = Field(description="as in hello")
    channels: list[ChannelLimit] = Field(description="as in hello, with the limits that hold")


class StateChange(Message):
    """The monitor's state changed, or the source is late (`stale`)."""

    type: Literal["state"] = "state"
    state: State
    reason: str
    cause: Cause | None = Field(default=None, description="as of a frame")


class StatusChange(Message):
    """The headline or the verdict changed: the worst that is true of the flight now.

    beside: `stale` and `invalid` where they are true and not the headline.
    """

    type: Literal["status"] = "status"
    status: Status
    level: Level
    beside: list[Status]
    exceeded_t: float | None = Field(
        default=None,
        description="[s] of the first exceedance that the flight has come to, sought back or not",
    )
    verdict: Verdict | None = Field(default=None, description="as in hello")


class AlarmRaised(Message):
    """An alarm was raised or acknowledged; never left out."""

    type: Literal["alarm"] = "alarm"
    alarm: Alarm


class MarkerSet(Message):
    """A marker was set, or the store has taken it; never left out."""

    type: Literal["marker"] = "marker"
    marker: FlightMarker


class TransportChange(Message):
    """An action, or the end of the source, changed the transport."""

    type: Literal["transport"] = "transport"
    transport: TransportState


class Reset(Message):
    """The next frame, `seq`, does not follow the one before it: clear the strips."""

    type: Literal["reset"] = "reset"
    seq: int
    t: float = Field(description="[s] where the flight began or was sought, with sample `since`")
    since: int = Field(
        default=0,
        description="samples from `since` up to `seq` belong to the same strips; they are not "
        "streamed any more, and are at /assessments",
    )
    held: list[LimitsFrom] = Field(default_factory=list, description="as in hello, by now")


class Heartbeat(Message):
    """Each second: the server lives.

    lost: samples of the flight that could not be recorded.
    unwritten: samples that wait for the store; a few always do.
    problem: why the store takes nothing at present, also while nothing waits; empty while it does.
    conflated: samples left out for this watcher so far, waiting ones included.
    """

    type: Literal["heartbeat"] = "heartbeat"
    server_time: str
    sent: float = Field(description="monotonic milliseconds of the server")
    lost: int
    unwritten: int
    problem: str
    conflated: int


class Waiting(Message):
    """Samples wait and no credit is left: said within a second, once until the client gives some.

    Until then only the newest of the samples that come are kept for it.
    """

    type: Literal["waiting"] = "waiting"
    behind: int = Field(description="samples that came since the last message of frames")
    reason: str


class End(Message):
    """Last message; the connection closes."""

    type: Literal["end"] = "end"
    reason: str


class Credit(Message):
    """The client took n messages of frames and may be sent as many more."""

    type: Literal["credit"]
    n: int = Field(ge=1, le=1_000)


class Resume(Message):
    """The client has seen everything up to seq: send what followed, or reset and what there is.

    -1 asks for all that is kept, about the last minute.
    """

    type: Literal["resume"]
    seq: int = Field(ge=-1)


DOWN: tuple[type[Message], ...] = (
    Hello, Frames, StateChange, StatusChange, AlarmRaised, MarkerSet, TransportChange, LiveChange,
    LimitsChange, Reset, Heartbeat, Waiting, End,
)  # fmt: skip
"""What the server sends on a flight's stream."""
UP: tuple[type[Message], ...] = (Credit, Resume)
"""What a client sends."""


class MessageError(ValueError):
    """What a client sent is no message."""


_CLIENT: TypeAdapter[Credit | Resume] = TypeAdapter(
    Annotated[Credit | Resume, Field(discriminator="type")]
)


@lru_cache(maxsize=64)
def decode(text: bytes | str) -> Credit | Resume:
    """Read a client's message; MessageError where it is none."""
    try:
        return _CLIENT.validate_json(text)
    except ValidationError as error:
        raise MessageError("send credit with n, or resume with seq, as JSON") from error


def validity_word(is_checked: bool) -> Literal["checked", "not calibrated"]:
    """Whether a monitor's validity is calibrated, in words."""
    return "checked" if is_checked else "not calibrated"


def plain_frame(
    seq: int,
    y: Any,
    assessment: Assessment,
    sent: float | None,
    display: Sequence[Assessment] = (),
    taken: float | None = None,
    ahead: Ahead | None = None,
) -> dict[str, Any]:
    """Return a Frame as plain data; unchecked, since this is done for every sample. taken: [s]."""
    frame = {
        "seq": seq,
        "t": assessment.t,
        "y": y.tolist(),
        "p_value": assessment.p_value,
        "alert": assessment.alert,
        "state": assessment.state.value,
        "reason": assessment.reason,
        "cause": assessment.cause,
        "y_hat": assessment.y_hat if assessment.y_hat is None else assessment.y_hat.tolist(),
        "sent": sent,
    }
    if taken is not None:
        frame["taken"] = round(taken * 1e3, 3)
    if ahead is not None:
        frame["ahead"] = plain_ahead(ahead)
    if display:
        frame["display"] = [
            {
                "p_value": one.p_value,
                "alert": one.alert,
                "state": one.state.value,
                "reason": one.reason,
                "cause": one.cause,
            }
            for one in display
        ]
    return frame


def plain_ahead(ahead: Ahead) -> dict[str, Any]:
    """Return a CardAhead: MOST_AHEAD samples of all channels together, the last one included."""
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
    """Return a frame as JSON text, once for all who see it; what is not finite becomes null."""
    return json_codec.encode(frame).decode()


def encode_frames(seq: int, frames: list[str], conflated: int) -> str:
    """Return Frames of frames that are encoded already."""
    return f'{{"type":"frames","seq":{seq},"conflated":{conflated},"frames":[{",".join(frames)}]}}'


def limited_channels(specification: Specification) -> list[ChannelLimit]:
    """The telemetry dictionary with the specification's limits, as far as it has any."""
    limits = asdict(specification) if isinstance(specification, Limits) else {}
    return [ChannelLimit(**asdict(channel), limit=limits.get(channel.key)) for channel in CHANNELS]
