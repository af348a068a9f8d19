"""A mapping that a person has confirmed, laid over a new file of the same recorder."""

from app.telemetry.extent import extent
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.draft import Draft, Guess
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.targets import TARGETS
from app.telemetry.units import fits, spelled

SURE = 0.98


def recall(draft: Draft, remembered: Mapping, aircraft: str) -> None:
    """Take what was confirmed wherever the file has the signals for it; say where it has not."""
    whom = f"as confirmed for {aircraft}" if aircraft else "as confirmed before"
    _times(draft, remembered, whom)
    for key, source in remembered.channels.items():
        if not source.signal:
            continue
        if trouble := _trouble(draft, key, source.signal, source.unit):
            draft.guesses[key] = Guess(0.0, (f"not {whom}: {trouble}",))
            continue
        draft.take(key, source, SURE, whom)
        draft.confirmed.add(key)
        said = spelled(draft.columns.signal(source.signal).unit)
        if said and fits(said, TARGETS[key].unit) and said != spelled(source.unit):
            doubt = f"the file now says {said} where {source.unit} was confirmed: check the unit"
            draft.comment(key, doubt, 0.5)
    _derived(draft, remembered, whom)


def _times(draft: Draft, remembered: Mapping, whom: str) -> None:
    contents = draft.columns.contents
    rows = {signal.name: contents.groups[signal.group].n_rows for signal in contents.signals}
    for group in contents.groups:
        source = remembered.times.get(group.name)
        if source and rows.get(source.signal) == group.n_rows and fits(source.unit, "s"):
            draft.times[group.name] = source
            draft.guesses[f"t:{group.name}"] = Guess(SURE, (whom,))


def _trouble(draft: Draft, key: str, name: str, unit: str) -> str:
    """Why a confirmed signal cannot be taken from this file; "" if it can."""
    contents = draft.columns.contents
    try:
        signal = draft.columns.signal(name)
    except KeyError:
        return f"the file has no signal {name}"
    if not fits(unit, TARGETS[key].unit):
        return f"{unit!r} is no unit of {TARGETS[key].label}"
    if contents.groups[signal.group].name not in draft.times:
        return f"{name} has no time"
    reach = extent(draft.columns.values(name))
    return f"{name} holds no number in {reach.n} rows" if reach.empty else ""


def _derived(draft: Draft, remembered: Mapping, whom: str) -> None:
    """Confirmed derivations, each as soon as what it needs is there."""
    pending = {key: source for key, source in remembered.channels.items() if source.derivation}
    while True:
        ready = [key for key, source in pending.items() if not _lacking(draft, key, source)]
        if not ready:
            break
        for key in ready:
            draft.take(key, pending.pop(key), SURE, f"{whom}: derived")
            draft.confirmed.add(key)
    for key, source in pending.items():
        lacking = _lacking(draft, key, source)
        draft.guesses[key] = Guess(0.0, (f"not {whom}: it lacks {' and '.join(lacking)}",))


def _lacking(draft: Draft, key: str, source: ChannelSource) -> list[str]:
    way = DERIVATIONS.get(source.derivation)
    if way is None or way.target != key:
        return [f"a derivation {source.derivation!r}"]
    return [need for need in way.needs if need not in draft.channels]
