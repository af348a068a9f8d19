"""Groups that are separate flights: one is mapped, and never a mixture."""

from dataclasses import replace

import pytest

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.checks import find_warnings
from app.telemetry.mapping.names import name_matches
from app.telemetry.mapping.proposal import propose
from app.telemetry.recording import TelemetryError
from tests.support.tables import columns_of, flight

NAMES = {"t": "t", "p": "p", "r": "r", "beta": "beta", "Ny": "ny", "delta_a": "delta_a"}
ALL = NAMES | {"delta_r": "delta_r", "phi": "phi"}


def structures(**names):
    """One structure for each manoeuvre, each with its own time."""
    return {
        f"{group}//{group}.{name}": flight()[key][: 900 + 20 * n]
        for n, (group, of_group) in enumerate(names.items())
        for key, name in of_group.items()
    }


@pytest.fixture
def columns(tmp_path):
    return columns_of(tmp_path, structures(ail_1=NAMES, rud_1=ALL, rud_2=ALL))


def groups_of(proposal):
    return {source.signal.split(".")[0] for source in proposal.mapping.channels.values()}


def test_all_channels_come_from_the_most_complete_flight(columns):
    proposal = propose(columns)
    assert groups_of(proposal) == {"rud_1"}
    assert proposal.missing == ()
    note = proposal.notes[0]
    assert "ail_1" in note
    assert "rud_2" in note
    assert not any("would also fit" in " ".join(r.reasons) for r in proposal.rationales.values())


def test_a_person_chooses_the_flight(columns):
    assert groups_of(propose(columns, group="rud_2")) == {"rud_2"}
    proposal = propose(columns, group="ail_1")
    assert groups_of(proposal) == {"ail_1"}
    assert proposal.missing == ("delta_r",)
    with pytest.raises(TelemetryError, match="rud_1"):
        propose(columns, group="rud_9")


def test_a_channel_of_another_flight_gives_a_warning(columns):
    mapping = propose(columns).mapping
    mixed = replace(mapping.channels["r"], signal="ail_1.r")
    mapping = replace(mapping, channels=mapping.channels | {"r": mixed})
    warnings = find_warnings(columns, mapping, apply_mapping(columns, mapping))
    assert any("ail_1" in text for text in warnings["r"])
    assert not any("ail_1" in text for text in warnings.get("beta", ()))


def test_a_container_does_not_turn_a_yaw_rate_into_a_rudder():
    assert {match.key for match in name_matches("rud_1.r", "rud_1")} == {"r"}


def test_messages_of_one_recorder_complete_each_other(tmp_path):
    inertial = {"t": "t", "p": "gyro_x", "r": "gyro_z", "Ny": "acc_y"}
    table = structures(imu_0=inertial, imu_1=inertial, air={"t": "t", "beta": "beta"})
    table |= structures(surf={"t": "t", "delta_a": "delta_a", "delta_r": "delta_r"})
    assert propose(columns_of(tmp_path, table)).missing == ()
