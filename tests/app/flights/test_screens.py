import pytest

from app.flights.transport import NotPossible
from app.flights.watcher import Screens


@pytest.fixture
def screens() -> Screens:
    """Of Ann, then of Ben."""
    made = Screens()
    made.join("a", "Ann")
    made.join("b", "Ben")
    return made


def leader_of(screens: Screens) -> str | None:
    leader = screens.message.leader
    return leader and leader.by


def test_the_first_screen_to_steer_leads_and_another_one_is_refused(screens: Screens) -> None:
    assert leader_of(screens) is None
    screens.check("b")
    assert screens.lead("b")
    assert not screens.lead("b")
    assert leader_of(screens) == "Ben"
    with pytest.raises(NotPossible, match="screen 2 leads"):
        screens.check("a")
    assert screens.lead("a")
    screens.check("a")


def test_a_leader_that_left_stays_named_until_another_screen_steers(screens: Screens) -> None:
    screens.lead("b")
    screens.leave("b")
    assert [screen.by for screen in screens.message.screens] == ["Ann"]
    assert leader_of(screens) == "Ben"
    screens.check("a")
    screens.lead("a")
    assert leader_of(screens) == "Ann"
    assert len(screens._known) == 1


def test_a_leader_that_reconnects_before_its_old_connection_ends_still_leads(
    screens: Screens,
) -> None:
    screens.lead("b")
    screens.join("b", "Ben")
    screens.leave("b")
    assert {screen.number for screen in screens.message.screens} == {1, 2}
    with pytest.raises(NotPossible):
        screens.check("a")


def test_a_screen_that_is_not_connected_neither_steers_nor_leads(screens: Screens) -> None:
    for act in (screens.check, screens.lead):
        with pytest.raises(NotPossible, match="connected"):
            act("c")
