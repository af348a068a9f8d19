"""Recordings of any channels over REST: proposed, corrected, confirmed and previewed."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.assessment.batches import Batch, ChannelReader
from app.cli import main
from app.recordings.flown_journal import FlownJournal
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from core.channels import LATERAL, LONGITUDINAL, Dictionary, channel
from tests.support import short_period
from tests.support.api import problem, store_of
from tests.support.own_channels import TEN, monitor, ten_mat
from tests.support.recorded import RECORDINGS, csv_of, uploaded
from tests.support.short_period import DT
from tests.support.tables import columns_of

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def monitors(client: TestClient) -> dict[int, str]:
    """Ids of stored monitors by the number of their channels."""
    store = store_of(client)
    return {n: store.monitors.add(monitor(n), f"{n} channels").id for n in (4, 5, 10)}


def pitch_csv(head: str = "t_s,alpha_deg,q (deg/s),N_z,delta_e_rad") -> bytes:
    y = short_period.fly(RNG(3), 1)[1][0] * [np.degrees(1), np.degrees(1), 1, 1]
    return csv_of(y, DT, head=head)


def test_a_longitudinal_csv_is_mapped_without_a_monitor_and_confirmed(client: TestClient) -> None:
    recording = uploaded(client, pitch_csv())
    mapped = recording["mapping"]["channels"]
    assert {key: source["unit"] for key, source in mapped.items()} == {
        "alpha": "deg", "q": "deg/s", "Nz": "g", "delta_e": "rad"
    }  # fmt: skip
    assert recording["channels"] == list(LONGITUDINAL.keys)
    assert recording["missing"] == ["theta", "V"]
    path = f"{RECORDINGS}/{recording['id']}"
    again = client.put(f"{path}/mapping", json={"mapping": recording["mapping"]}).json()
    assert again["mapping_state"] == "confirmed"
    assert again["problem"] is None
    assert again == client.get(path).json()
    shown = client.post(f"{path}/preview", json={"mapping": again["mapping"]}).json()
    assert {key: bands["unit"] for key, bands in shown["channels"].items()} == {
        "alpha": "rad", "q": "rad/s", "Nz": "g", "delta_e": "rad"
    }  # fmt: skip
    assert shown["warnings"] == {}


def test_a_monitors_channels_come_first_and_all_are_listed(
    client: TestClient, monitors: dict[int, str], tmp_path: Path
) -> None:
    sent = {"name": "ten.mat", "monitor": monitors[10]}
    answer = client.post(RECORDINGS, content=ten_mat(tmp_path), params=sent).json()
    assert answer["channels"] == list(TEN.keys)
    assert [target["key"] for target in answer["targets"]][:10] == list(TEN.keys)
    assert answer["missing"] == ["γ̇"]
    assert "flight-path rate" in answer["rationales"]["γ̇"]["reasons"][0]
    mapping = answer["mapping"]
    assert mapping["channels"]["wing load"]["signal"] == "wing_load"
    assert mapping["channels"]["theta"] == mapping["channels"]["pitch"]
    mapping["channels"]["γ̇"] = {"signal": "gamma", "unit": "deg/s"}
    path = f"{RECORDINGS}/{answer['id']}"
    query = {"monitor": monitors[10]}
    confirmed = client.put(f"{path}/mapping", json={"mapping": mapping}, params=query).json()
    assert confirmed["missing"] == []
    assert confirmed["confirmed_over"] == {}
    assert client.get(path).json()["channels"] == list(TEN.keys)


def test_units_are_offered_by_dimension_and_values_kept_in_si(
    client: TestClient, monitors: dict[int, str]
) -> None:
    recording = uploaded(client, pitch_csv())
    answer = client.get(f"{RECORDINGS}/{recording['id']}?monitor={monitors[10]}").json()
    targets = {target["key"]: target for target in answer["targets"]}
    load = targets["wing load"]
    assert (load["unit"], load["units"], load["display_unit"]) == ("N", ["N", "lbf"], "lbf")
    assert load["display_factor"] == pytest.approx(1 / 4.448222)
    assert "deg/s" in targets["γ̇"]["units"]
    assert "psf" in targets["q_bar"]["units"]


HAS = ("load", "alpha", "q", "Nz", "delta_e")


def test_one_recording_serves_two_dictionaries_with_one_key_in_two_units(
    client: TestClient, monitors: dict[int, str]
) -> None:
    head = "t_s,load_lbf,alpha_rad,q_radps,Nz_g,delta_e_rad"
    y = np.column_stack([np.linspace(0, 9, 81), short_period.fly(RNG(3), 1)[1][0]])
    recording = uploaded(client, csv_of(y, DT, head=head))
    path = f"{RECORDINGS}/{recording['id']}"
    for n in (5, 10):
        answer = client.get(f"{path}?monitor={monitors[n]}").json()
        assert answer["mapping"] == recording["mapping"]
        assert "load" in answer["channels"]
        assert answer["missing"] == [key for key in answer["channels"] if key not in HAS]
    shown = client.post(f"{path}/preview", json={"mapping": recording["mapping"]}).json()
    load = shown["channels"]["load"]
    assert (load["unit"], load["max"]) == ("N", pytest.approx(9 * 4.448222))


def test_a_proposal_for_a_monitor_keeps_what_was_confirmed_and_stores_nothing(
    client: TestClient, monitors: dict[int, str]
) -> None:
    recording = uploaded(client, pitch_csv("t_s,alpha_deg,q (deg/s),stick,load_N"))
    path = f"{RECORDINGS}/{recording['id']}"
    mapping = recording["mapping"]
    mapping["channels"] = {"delta_e": {"signal": "stick", "unit": "deg", "sign": -1}}
    confirmed = client.put(f"{path}/mapping", json={"mapping": mapping}).json()
    answer = client.get(f"{path}?monitor={monitors[5]}").json()
    assert answer["mapping"]["channels"].keys() == {"alpha", "q", "delta_e", "load"}
    kept = confirmed["mapping"]["channels"]["delta_e"]
    assert answer["mapping"]["channels"]["delta_e"] == kept
    assert (answer["mapping_state"], answer["missing"]) == ("proposed", ["Nz"])
    assert client.get(path).json() == confirmed


def test_a_flight_of_any_channels_is_mapped_by_the_keys_that_were_sent(tmp_path: Path) -> None:
    sent = ("t", "wing load", "alpha", "theta", "phi", "beta", "gone")
    columns = columns_of(tmp_path, dict.fromkeys(sent, DT * np.arange(9)), times={"": "t"})
    journal = FlownJournal("f", tmp_path / "journal", "flight", dictionary=TEN)
    units = {"wing load": "lbf", "alpha": "rad", "phi": "rad", "theta": "rad"}
    assert journal.mapping_for(columns).channels == {
        key: ChannelSource(key, unit) for key, unit in units.items()
    }


def test_a_live_flight_reads_the_channels_of_its_monitor_by_any_mapping() -> None:
    mapping = Mapping(
        {
            "wing load": ChannelSource("a", "lbf", -1, 4.448222),
            "alpha": ChannelSource("b", "deg"),
            "beta": ChannelSource("c", "deg"),
            "Mach": ChannelSource("d", "1"),
        },
        {"": TimeSource("t")},
    )
    batch = Batch(None, {"t": [0.0], "a": [3.0], "b": [45.0], "c": [18.0], "d": [0.5]})
    for dictionary, expected in (
        (TEN, {"wing load": -4.0, "alpha": np.pi / 4}),
        (LATERAL, {"beta": np.pi / 10}),
    ):
        (sample,) = ChannelReader(mapping, None, dictionary).samples(batch)
        read = dict(zip(dictionary.keys, sample.y, strict=True))
        assert {key: v for key, v in read.items() if np.isfinite(v)} == pytest.approx(expected)


def test_nothing_is_derived_live_from_a_channel_in_another_unit() -> None:
    speed = Dictionary("knots", (channel("V", "V", "kt", "airspeed"), *LATERAL.channels))
    mapping = Mapping(
        {
            "V": ChannelSource("a", "kt"),
            "v": ChannelSource("b", "m/s"),
            "beta": ChannelSource(derivation="beta_from_velocity"),
        },
        {"": TimeSource("t")},
    )
    ChannelReader(mapping)
    with pytest.raises(TelemetryError, match="has V in kt"):
        ChannelReader(mapping, None, speed)


@pytest.mark.parametrize("door", ["upload", "read", "confirm"])
def test_an_unknown_monitor_is_not_found(client: TestClient, door: str) -> None:
    recording: dict[str, Any] = uploaded(client, pitch_csv())
    path, query = f"{RECORDINGS}/{recording['id']}", {"monitor": "none", "name": "a.csv"}
    answer = {
        "upload": lambda: client.post(RECORDINGS, content=pitch_csv(), params=query),
        "read": lambda: client.get(path, params=query),
        "confirm": lambda: client.put(
            f"{path}/mapping", json={"mapping": recording["mapping"]}, params=query
        ),
    }[door]()
    assert "none" in problem(answer, 404)
    assert client.get(path).json() == recording


def test_a_training_proposal_without_lateral_channels_says_what_is_missing(
    client: TestClient,
) -> None:
    recording = uploaded(client, pitch_csv())
    answer = client.get(f"{RECORDINGS}/{recording['id']}/training-proposal").json()
    assert answer["can_train"] is False
    assert answer["missing_channels"] == list(LATERAL.keys)
    assert any("simulator" in reason for reason in answer["reasons"])


def test_the_command_line_asks_for_the_channels_of_the_monitor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "pitch.fwm", tmp_path / "out"
    monitor(4).save(file)
    flight = tmp_path / "flight.csv"
    flight.write_bytes(pitch_csv("t_s,alpha_deg,q (deg/s),N_z,stick"))
    command = ["score", str(file), str(flight), "--out", str(out), "--accept-useless"]
    assert main(command) == 1
    printed = capsys.readouterr().err
    assert "no signal has the name delta_e, δ_e, elevator" in printed
    (template,) = out.glob("*.json")
    mapping = json.loads(template.read_text())
    assert list(mapping["channels"]) == ["alpha", "q", "Nz", "delta_e"]
    assert mapping["channels"]["delta_e"] == ASKED
    mapping["channels"]["delta_e"]["signal"] = "stick"
    template.write_text(json.dumps(mapping))
    assert main([*command, "--mapping", str(template)]) == 0
    assert "alpha    alpha_deg [deg]" in capsys.readouterr().out


ASKED = {"signal": "", "unit": "rad", "sign": 1, "bias": 0.0, "derivation": ""}
ASKED |= {"scale": 1.0, "offset": 0.0, "bits": ""}
