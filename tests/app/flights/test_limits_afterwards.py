"""A flight under a limit set says the same afterwards as in flight: scored, reported, exported."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.assessment import ScoringRecipe
from app.assessment.outcome import RecordedExceedance
from app.recordings.scored_file import ScoreRequest, score_file
from app.telemetry.mapping.mapping import Mapping
from core.channels import KEYS
from tests.app.flights.test_flight_recordings import DT, FLIGHTS, RECORDINGS, N, Range
from tests.support.api import api

OWN, TIGHT = 0.5, 0.4


class Flown:
    """A live flight at 0.44 g whose limits by Mach are the monitor's, then 0.4 g, then unknown.

    Mach is measured up to 6 s and rises at 4 s: 0.44 g is exceeded from 4.5 s on.
    """

    def __init__(self, root: Path) -> None:
        with api(root) as client:
            place = Range(client, root)
            cases = [
                {"name": "slow", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": OWN}},
                {"name": "fast", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": TIGHT}},
            ]
            limits = client.post("/api/v1/limit-sets", json={"name": "envelope", "cases": cases})
            self.flight = place.start("flown")
            asked = {"limit_set": limits.json()["limit_set"], "by": "Ann"}
            assert client.put(f"{FLIGHTS}/{self.flight}/limits", json=asked).status_code == 200
            for k in range(N):
                y = {key: [0.001 * float(np.sin(0.7 * k + i))] for i, key in enumerate(KEYS)}
                y["Ny"] = [0.44 if 90 <= k < 100 else 0.43 if 20 <= k < 30 else 0.01]
                mach = {"mach": [0.7 if k < 80 else 0.9]} if k < 120 else {}
                place.push(self.flight, k, **y, **mach)
            place.end(self.flight)
            self.recording = place.recording_of(self.flight)
            path = f"{RECORDINGS}/{self.recording['id']}/scorings"
            request = {"monitor": place.monitor, "manoeuvres": "entire", "trim": None}
            answer = client.post(path, json=request)
            assert answer.status_code == 201, answer.text
            self.scoring = answer.json()
            path = f"{path}/{self.scoring['id']}"
            query = {"last": N}
            self.scored = client.get(f"{path}/assessments", params=query).json()["frames"]
            path_shown = f"{FLIGHTS}/{self.flight}/assessments"
            self.shown = client.get(path_shown, params=query).json()["frames"]
            self.alarms = client.get(f"{FLIGHTS}/{self.flight}/alarms").json()
            self.record = client.get(f"{FLIGHTS}/{self.flight}").json()
            self.report = client.get(f"{path}/report").text
            self.replayed = self._replayed(place)
            self.monitor, self.journal = root / "monitor.fwm", root / "flown.jsonl"
            place.store.monitors.get(place.monitor).save(self.monitor)
            self.journal.write_bytes((root / f"live/{self.flight}.jsonl").read_bytes())
            self.mapping = Mapping.from_plain(self.scoring["mapping"])

    def _replayed(self, place: Range) -> list[dict[str, Any]]:
        """Alarms of a replay of the scoring that is sought to its end."""
        scored = {"recording": self.recording["id"], "scoring": self.scoring["id"]}
        body = {"source": {"kind": "recording"} | scored, "monitor": place.monitor}
        answer = place.client.post(FLIGHTS, json=body | {"accept_useless": True})
        assert answer.status_code == 201, answer.text
        path = f"{FLIGHTS}/{answer.json()['id']}"
        sought = {"action": "seek", "value": (N - 2) * DT}
        assert place.client.post(f"{path}/transport", json=sought).is_success
        return place.client.get(f"{path}/alarms").json()


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    return Flown(tmp_path_factory.mktemp("flown"))


def test_its_scoring_judges_by_the_limits_that_were_in_force(flown: Flown) -> None:
    (manoeuvre,) = flown.scoring["manoeuvres"]
    (alarm,) = [one for one in flown.alarms if one["kind"] == "limit"]
    assert manoeuvre["exceedance"].pop("arrived") > 0.0
    assert manoeuvre["exceedance"] == {
        "t": 90 * DT,
        "channel": "Ny",
        "value": 0.44,
        "limit": TIGHT,
        "doubt": "",
    }
    assert (alarm["t"], alarm["exceedance"]["limit"]) == (90 * DT, TIGHT)
    assert manoeuvre["exceedance_verdict"] == flown.record["verdict"]["text"]
    assert manoeuvre["verdict"]["word"].endswith("; NO GUARANTEE")  # the recording is no doublet
    assert manoeuvre["own_exceedance"] is None
    assert not any("exceeded a limit" in remark for remark in manoeuvre["remarks"])
    assert manoeuvre["remarks"][:3] == [
        "from 4.00 to 6.95 s |N_y| 0.4 g (limit set envelope version 1, fast) in force, the "
        "monitor warns of |N_y| 0.5 g",
        "from 6.95 to 9.95 s the limits of limit set envelope version 1 in force are unknown, the "
        "monitor warns of |N_y| 0.5 g",
        "exceedances are judged by the limits in force; alerts and misses only where these are the "
        "monitor's own; the monitor's own |N_y| 0.5 g was not exceeded",
    ]


def test_where_the_monitor_was_not_applicable_its_scoring_says_so(flown: Flown) -> None:
    """With the words that were shown, sample by sample."""
    assert [one["t"] for one in flown.scored] == [one["t"] for one in flown.shown]
    names = "state", "reason", "p_value", "alert"
    said, shown = ([[one[n] for n in names] for one in f] for f in (flown.scored, flown.shown))
    assert {one[0] for one in shown[3:80]} == {"ok"}
    assert said[3:] == shown[3:]
    assert {one["reason"].partition(":")[0] for one in flown.scored[80:140]} == {"not applicable"}
    assert {one["reason"].partition(":")[0] for one in flown.scored[140:]} == {"limits unknown"}
    assert all(one["withdrawn"] is not None for one in flown.scored[80:])


def test_it_says_which_limits_held_when(flown: Flown) -> None:
    held = flown.scoring["limits_in_force"]
    assert [(one["case"], one["limits"], bool(one["reason"])) for one in held] == [
        ("slow", {"Ny": OWN}, False),
        ("fast", {"Ny": TIGHT}, True),
        ("", None, True),
    ]
    assert [one["start"] for one in held] == pytest.approx([0.0, 80 * DT, 119 * DT + 1.0])
    assert [one["end"] for one in held] == [*(one["start"] for one in held[1:]), (N - 1) * DT]


def test_its_report_names_both_limits_and_draws_those_in_force(flown: Flown) -> None:
    text = re.sub(r"<[^>]+>", "", flown.report.replace("\xa0", " "))
    assert "A limit was exceeded, warned in time before the monitor was withdrawn" in text
    assert "No limit was exceeded" not in text
    row = r"4.00 to 6.95\s*envelope version 1, fast\s*Ny 0.4 g\s*entire recording at 4.50 s"
    assert re.search(row, text)
    assert "unknown: judged by the loosest limits of the set" in text
    assert "The monitor's own limit" in text.replace("&#39;", "'")
    (overview, figure, _) = re.findall(r'class="limit" d="([^"]+)"', flown.report)
    for path in (overview, figure):  # either sign of 0.5 g, then of 0.4 g, then none
        begin, end = re.findall(r"M([\d.]+) [\d.]+H([\d.]+)", path)[::2]
        assert begin[1] == end[0]
        assert float(end[1]) < 500.0


def test_its_record_tells_the_limits_that_held_its_exceedances_and_its_lead(flown: Flown) -> None:
    held = [
        (one["t"], one["limits"] and one["limits"]["Ny"]) for one in flown.record["limits_held"]
    ]
    changes = [(80 * DT, TIGHT), (pytest.approx(140 * DT), None)]
    assert held == [(None, OWN), (None, None), (0.0, OWN), *changes]
    (told,) = flown.record["exceedances"]
    assert (told["channel"], told["n"], told["first_t"]) == ("Ny", 1, 90 * DT)
    assert flown.record["monitors"][0]["lead"] == pytest.approx(flown.scoring["lead"] - 1.5 * DT)


def test_a_replay_of_its_scoring_is_held_against_the_same(flown: Flown) -> None:
    alarms = [one for one in flown.replayed if one["kind"] == "limit"]
    assert [(one["t"], one["exceedance"]["limit"]) for one in alarms] == [(90 * DT, TIGHT)]


def test_the_command_line_tells_the_same_of_the_journal(flown: Flown) -> None:
    request = ScoreRequest(
        (flown.monitor,),
        flown.journal,
        mapping=flown.mapping,
        recipe=ScoringRecipe(None, trim=None, manoeuvres="entire"),
        accept_useless=True,
    )
    (scored,) = score_file(request).scored
    (manoeuvre,) = scored.recording.manoeuvres
    assert manoeuvre.exceedance is not None
    judged = replace(manoeuvre.exceedance, arrived=None)
    assert judged == RecordedExceedance(90 * DT, "Ny", 0.44, TIGHT)
    assert list(manoeuvre.remarks) == flown.scoring["manoeuvres"][0]["remarks"]
