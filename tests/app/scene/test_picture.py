import threading
from math import isfinite, nan, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.scene.airframes import airframe
from app.scene.ground_track import TRAIL_POINTS, GroundTrack
from app.scene.picture import (
    CAMERAS,
    COLUMN_AT,
    COLUMN_HEIGHT,
    ELEVATORS,
    FIELD_OF_VIEW,
    GROUND_BELOW,
    HEADLINE_AT,
    HORIZON,
    UNKNOWN_AT,
    WIDEST,
)
from app.scene.scene import Scene
from app.scene.shown import (
    ADVISORY,
    ALERT,
    CALM,
    CAUTION,
    EXAGGERATION,
    GREY,
    Shown,
    as_text,
    label,
    tone,
)
from core.monitor.assessment import Cause, State
from core.monitor.status import BETWEEN, Facts
from core.simulation.attitude import Attitude, SurfaceSigns
from tests.support.scene_site import show


def on_screen(points, camera):
    """Places (n, 3) as a camera sees them, across and up; 1 is half the picture's height."""
    ahead = np.array(camera.look_at) - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross((0.0, 0.0, 1.0), ahead)
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    seen = points - np.array(camera.position)
    depth = seen @ ahead * np.tan(FIELD_OF_VIEW / 2)
    return seen @ right / depth, seen @ up / depth


OK = Shown(1.0, Attitude(0.2, 0.1, 0.3), 0.02, 0.03, -0.05, 0.12, 0.2, False, State.OK, "", Facts())
NOT_ASSESSED: dict[str, Any] = {
    "state": State.INVALID,
    "p_value": None,
    "alert": False,
    "reason": BETWEEN,
    "cause": Cause.BETWEEN,
}
"""A sample between two manoeuvres."""
SILENT = (State.STALE, State.INVALID, State.WARMING_UP)


def nodes(scene: Scene):
    return scene._picture


def filled(scene: Scene) -> float:
    """Height to which the column is filled [m]."""
    scale = nodes(scene)._fill.scale
    assert isinstance(scale, tuple)
    return scale[2]


class TestShow:
    def test_the_last_one_before_a_drawing_wins(self, scene):
        for p_value in (0.01, 0.02, 0.03):
            show(scene, p_value=p_value)
        assert scene.draw()
        assert "RISK 0.03" in nodes(scene)._headline.text
        assert not scene.draw()

    def test_it_draws_nothing_itself(self, scene):
        scene.draw()
        before = nodes(scene)._headline.text
        show(scene, p_value=0.5, alert=True)
        assert nodes(scene)._headline.text == before

    def test_one_drawing_is_one_atomic_update(self, scene):
        class Frames(list):
            def note(self, step):
                original = getattr(scene._server, step)
                setattr(scene._server, step, lambda: (self.append(step), original())[1])

        frames = Frames()
        for step in ("atomic", "flush"):
            frames.note(step)
        show(scene)
        scene.draw()
        assert frames == ["atomic", "flush"]

    def test_drawing_for_long_keeps_nothing_behind(self, scene):
        kept = scene._server._websock_server._broadcast_buffer.message_from_id
        sizes = []
        for k in range(300):
            show(scene, 0.05 * k, attitude=Attitude(0.01 * k, 0.0, 0.02 * k), p_value=0.003 * k,
                 alert=k % 9 == 0)  # fmt: skip
            scene.draw()
            sizes.append(len(kept))
        assert max(sizes[100:]) <= max(sizes[:100])

    @pytest.mark.parametrize("field", ["t", "beta", "delta_a", "delta_r"])
    def test_what_is_not_a_number_keeps_the_last_pose(self, scene, field):
        show(scene)
        show(scene, **{field: nan, "state": State.INVALID, "p_value": None, "alert": False})
        shown = scene._shown
        assert all(isfinite(number) for number in (shown.t, *shown[2:5]))
        assert shown.attitude == pytest.approx((radians(12), radians(3), radians(8)))
        assert scene.draw()
        assert "INVALID" in nodes(scene)._headline.text

    def test_ok_without_a_number_is_not_calm(self, scene):
        show(scene, p_value=None)
        scene.draw()
        assert nodes(scene)._fill.color == GREY
        assert "no risk known" in nodes(scene)._headline.text

    def test_writing_after_close_does_no_harm(self, scene):
        show(scene)
        scene.draw()
        scene.close()
        scene.close()
        show(scene, p_value=0.9, alert=True)
        assert not scene.draw()

    def test_closing_while_others_write_does_no_harm(self, clock):
        scene, failures, begun = Scene(clock, SurfaceSigns(1, -1), 0.0, 2.0), [], threading.Event()

        def write() -> None:
            try:
                for k in range(3000):
                    show(scene, 0.05 * k)
                    if not scene.draw() and k:
                        break
                    begun.set()
            except BaseException as failure:
                failures.append(failure)

        writer = threading.Thread(target=write)
        writer.start()
        assert begun.wait(20.0)
        scene.close()
        writer.join(20.0)
        assert failures == []
        assert not writer.is_alive()


class TestWhatIsSaid:
    def test_an_alert_is_a_word_and_a_colour(self):
        alert = OK._replace(p_value=0.5, alert=True, facts=Facts(alert=True))
        assert label(alert) == "ALERT RISK 0.50"
        assert (tone(alert), tone(OK)) == (ALERT, CALM)

    @pytest.mark.parametrize("state", [State.OK, *SILENT])
    def test_nothing_is_calm_or_grey_while_a_limit_is_exceeded(self, state):
        facts = Facts(
            exceeds=True, exceeded_t=1.0, **{state.value: True} if state in SILENT else {}
        )
        shown = OK._replace(state=state, p_value=0.01, facts=facts)
        if state is not State.STALE:  # which shows the past
            assert tone(shown) == ALERT
        assert tone(OK._replace(p_value=0.01, facts=Facts(exceeded_t=1.0))) == CAUTION
        assert tone(OK._replace(p_value=0.01, facts=Facts(alarm=True, exceeded_t=1.0))) == ALERT

    @pytest.mark.parametrize("state", SILENT)
    def test_a_state_without_a_risk_is_a_word_in_grey_and_never_a_number(self, state):
        facts = Facts(**{state.value: True})
        shown = OK._replace(state=state, reason="a gap", facts=facts)
        assert label(shown) == state.replace("_", " ").upper()
        assert tone(shown) == GREY

    @given(st.integers(1, 999), st.sampled_from([0.02, 0.05, 0.1, 0.2]), st.data())
    def test_the_text_stands_on_the_numbers_side_of_the_threshold(self, n, epsilon, data):
        p_value = data.draw(st.integers(1, n + 1)) / (n + 1)
        shown = float(as_text(p_value, epsilon))
        assert (shown > epsilon) == (p_value > epsilon)
        assert shown > 0.0

    def test_a_scene_to_which_nothing_comes_says_stale(self, scene, clock):
        scene.draw()
        assert "STALE" in nodes(scene)._headline.text
        show(scene)
        clock.now += 1.9
        scene.draw()
        assert "RISK 0.04" in nodes(scene)._headline.text
        clock.now += 0.2
        assert scene.draw()
        assert "STALE" in nodes(scene)._headline.text
        assert nodes(scene)._headline.text == "STALE"
        assert nodes(scene)._fill.color == GREY

    def test_its_patience_follows_its_flight(self, scene, clock):
        show(scene)
        clock.now += 1.0
        scene.wait(0.25)
        scene.draw()
        assert "RISK 0.04" in nodes(scene)._headline.text
        clock.now += 0.3
        assert scene.draw()
        assert nodes(scene)._headline.text == "STALE"
        show(scene, t=1.05)
        scene.wait(1.5)
        clock.now += 1.4
        scene.draw()
        assert "RISK 0.04" in nodes(scene)._headline.text

    def test_a_paused_flight_says_paused_and_keeps_its_risk(self, scene, clock):
        show(scene, p_value=0.3, alert=True)
        scene.restate(Facts(alert=True, paused=True))
        clock.now += 1000.0
        scene.draw()
        assert nodes(scene)._headline.text == "ALERT · PAUSED RISK 0.30"
        show(scene, t=1.05)
        scene.draw()
        assert nodes(scene)._headline.text == "RISK 0.04"

    def test_who_comes_late_sees_the_present(self, scene, clock):
        show(scene)
        scene.draw()
        clock.now += 60.0
        with scene.watching(lambda: None):
            assert nodes(scene)._headline.text == "STALE"
        assert not scene.is_watched


UNKNOWN = (None, None, None)
NOTHING: dict[str, Any] = {"attitude": UNKNOWN} | dict.fromkeys(("beta", "delta_a", "delta_r"))
BANK_ONLY: dict[str, Any] = NOTHING | {"attitude": (0.4, None, None)}
PITCH_ONLY: dict[str, Any] = NOTHING | {"attitude": (None, 0.3, None)}


class TestWhatIsNotKnown:
    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({}, ""),
            ({"attitude": (0.1, 0.2, None)}, "heading not known"),
            ({"attitude": (None, None, None)}, "attitude not known"),
            ({"delta_a": None}, "aileron not known"),
            ({"delta_a": None, "delta_r": None}, "surfaces not known"),
            (PITCH_ONLY, "bank, heading, sideslip and surfaces not known"),
        ],
    )
    def test_it_is_named_in_the_picture(self, scene, changes, words):
        show(scene, **changes)
        scene.draw()
        assert nodes(scene)._unknown.text == words
        assert nodes(scene)._unknown.visible == (words != "")

    def visible(self, scene: Scene) -> set[str]:
        picture = nodes(scene)
        others = ["_body", "_wings", "_compass", "_velocity", "_scale", "_trail"]
        all_nodes = {name: node for name, (_, node) in picture._parts.items()}
        all_nodes |= {name: getattr(picture, name) for name in others}
        return {name for name, node in all_nodes.items() if node.visible}

    def test_without_a_bank_a_line_along_the_body_shows_the_pitch(self, scene):
        show(scene, **PITCH_ONLY)
        scene.draw()
        assert self.visible(scene) == {"_body"}
        nose = Rotation.from_quat(np.roll(nodes(scene)._aircraft.wxyz, -1)).apply((1, 0, 0))
        assert -nose[2] == pytest.approx(np.sin(0.3))

    def test_without_a_pitch_a_line_between_the_tips_shows_the_bank(self, scene):
        show(scene, **BANK_ONLY)
        scene.draw()
        assert self.visible(scene) == {"_wings"}
        tip = Rotation.from_quat(np.roll(nodes(scene)._aircraft.wxyz, -1)).apply((0, 1, 0))
        assert tip[2] == pytest.approx(np.sin(0.4))

    def test_nothing_is_drawn_of_an_unknown_attitude(self, scene):
        show(scene, **NOTHING)
        scene.draw()
        assert self.visible(scene) == set()

    def test_a_surface_that_is_not_known_is_left_out(self, scene):
        show(scene, delta_r=None)
        scene.draw()
        parts = {name for name, _ in nodes(scene)._parts.items()}
        assert parts - self.visible(scene) == {"rudder"}

    def test_all_of_it_returns_once_it_is_known(self, scene):
        show(scene, **PITCH_ONLY)
        scene.draw()
        show(scene)
        scene.draw()
        seen = self.visible(scene)
        assert {"rudder", "_compass", "_velocity", "_scale", "_trail"} <= seen
        assert seen.isdisjoint({"_body", "_wings"})


class TestThePicture:
    def angle(self, scene: Scene, name: str) -> float:
        part, node = nodes(scene)._parts[name]
        turned = Rotation.from_quat(np.roll(node.wxyz, -1)).as_rotvec()
        return float(turned @ part.axis)

    @pytest.mark.parametrize("signs", [SurfaceSigns(a, r) for a in (1, -1) for r in (1, -1)])
    def test_surfaces_turn_the_way_that_moves_the_aircraft(self, clock, signs):
        scene = Scene(clock, signs, 0.0, 2.0)
        show(scene, delta_a=0.05, delta_r=0.06)
        scene.draw()
        # Trailing edge up on the right rolls right; trailing edge right yaws right.
        assert self.angle(scene, "right_aileron") == pytest.approx(-0.05 * EXAGGERATION * signs[0])
        assert self.angle(scene, "left_aileron") == pytest.approx(0.05 * EXAGGERATION * signs[0])
        assert self.angle(scene, "rudder") == pytest.approx(0.06 * EXAGGERATION * signs[1])
        scene.close()

    def test_no_surface_turns_further_than_it_can(self, scene):
        show(scene, delta_r=-3.0)
        scene.draw()
        assert abs(self.angle(scene, "rudder")) == pytest.approx(WIDEST)

    def test_the_attitude_is_drawn_true(self, scene):
        show(scene, attitude=Attitude(0.4, 0.1, 0.2))
        scene.draw()
        truth = Rotation.from_euler("ZYX", (0.2, 0.1, 0.4)).as_matrix()
        drawn = Rotation.from_quat(np.roll(nodes(scene)._aircraft.wxyz, -1)).as_matrix()
        assert drawn == pytest.approx(truth, abs=1e-9)

    def test_an_elevator_down_turns_trailing_edge_down_and_an_unknown_one_is_a_fixed_part(
        self, scene
    ):
        show(scene, delta_e=0.05)
        scene.draw()
        for name in ELEVATORS:
            part, node = nodes(scene)._parts[name]
            trailing = part.vertices[part.vertices[:, 0].argmin()]
            moved = Rotation.from_quat(np.roll(node.wxyz, -1)).apply(trailing) - trailing
            assert moved[2] > 0.05
            assert self.angle(scene, name) == pytest.approx(0.05 * EXAGGERATION)
            assert node.color == part.colour
        show(scene)
        scene.draw()
        fixed = nodes(scene)._parts["wings"][1].color
        for name in ELEVATORS:
            assert self.angle(scene, name) == 0.0
            assert nodes(scene)._parts[name][1].color == fixed

    def test_a_translucent_aircraft_has_the_planned_attitude_while_there_is_one(self, scene, clock):
        show(scene)
        scene.draw()
        ghost = nodes(scene)._ghost
        assert not ghost.visible
        show(scene, planned=(0.5, 0.1, -0.2))
        scene.draw()
        assert ghost.visible
        assert (ghost.opacity or 1.0) < 0.5
        truth = Rotation.from_euler("ZYX", (-0.2, 0.1, 0.5)).as_matrix()
        drawn = Rotation.from_quat(np.roll(ghost.wxyz, -1)).as_matrix()
        assert drawn == pytest.approx(truth, abs=1e-9)
        clock.now += 60.0
        scene.draw()
        assert not ghost.visible

    def test_a_known_angle_of_attack_turns_the_velocity(self, scene):
        show(scene, alpha=0.2)
        scene.draw()
        x, _, z = Rotation.from_quat(np.roll(nodes(scene)._velocity.wxyz, -1)).apply((1, 0, 0))
        assert z / x == pytest.approx(np.tan(0.2))

    def test_the_velocity_points_to_the_wind(self, clock):
        scene = Scene(clock, SurfaceSigns(1, -1), 0.1, 2.0)
        show(scene, beta=0.05)
        scene.draw()
        x, y, z = Rotation.from_quat(np.roll(nodes(scene)._velocity.wxyz, -1)).apply((1, 0, 0))
        assert y == pytest.approx(np.sin(0.05 * EXAGGERATION))  # wind from the right
        assert z / x == pytest.approx(np.tan(0.1))  # and from below
        scene.close()

    def test_the_column_fills_to_its_ring_where_the_risk_is_the_threshold(self, scene):
        show(scene, p_value=0.1, alert_above=0.1)
        scene.draw()
        ring, label = nodes(scene)._threshold, nodes(scene)._threshold_label
        assert filled(scene) == pytest.approx(-ring.position[2])
        assert (len(ring.points) > 0, label.text) == (True, "> 0.1")
        show(scene, p_value=0.2, alert_above=0.1, alert=True)
        scene.draw()
        assert filled(scene) > -nodes(scene)._threshold.position[2]

    def test_an_alert_turns_column_and_ring_red(self, scene):
        show(scene, p_value=0.5, alert=True)
        scene.draw()
        assert nodes(scene)._fill.color == ALERT
        assert tuple(nodes(scene)._ring.colors) == ALERT

    @pytest.mark.parametrize(
        ("facts", "text", "colour"),
        [
            (Facts(exceeds=True), "EXCEEDING RISK 0.04", ALERT),
            (Facts(alarm=True), "ALARM RISK 0.04", ALERT),
            (Facts(exceeded_t=8.76), "EXCEEDED first at 8.76 s RISK 0.04", CAUTION),
            (Facts(calibrated=False), "NOT CALIBRATED RISK 0.04", ADVISORY),
            (Facts(), "RISK 0.04", CALM),
        ],
    )
    def test_ring_and_words_are_the_flight_s_headline(self, scene, facts, text, colour):
        show(scene, facts=facts)
        scene.draw()
        assert nodes(scene)._headline.text == text
        assert tuple(nodes(scene)._ring.colors) == colour

    def test_words_grow_with_the_picture(self, scene):
        shown = nodes(scene)
        words = shown._threshold_label, shown._headline, shown._unknown
        assert {label.font_size_mode for label in words} == {"scene"}

    def test_no_label_is_wider_than_a_narrow_scene(self, scene, clock):
        facts = Facts(alarm=True, exceeded_t=8.76)
        show(scene, facts=facts)
        scene.draw()
        assert nodes(scene)._headline.text == "ALARM · EXCEEDED first at 8.76 s"
        show(
            scene,
            **NOT_ASSESSED,
            facts=facts._replace(stale=True, invalid=True),
        )
        scene.draw()
        assert nodes(scene)._headline.text == "ALARM · STALE · NOT ASSESSED"

    def test_nothing_is_invalid_between_manoeuvres(self, scene):
        show(scene, **NOT_ASSESSED)
        scene.draw()
        assert nodes(scene)._headline.text == "NOT ASSESSED"

    def test_an_alarm_does_not_hide_that_nothing_comes(self, scene, clock):
        show(scene, facts=Facts(exceeds=True, alarm=True))
        clock.now += 1000.0
        scene.draw()
        assert nodes(scene)._headline.text == "ALARM · STALE"
        scene.restate(Facts(exceeded_t=8.76))
        scene.draw()
        assert nodes(scene)._headline.text == "STALE · EXCEEDED first at 8.76 s"
        assert tuple(nodes(scene)._ring.colors) == CAUTION

    @pytest.mark.parametrize("state", [State.STALE, State.INVALID])
    def test_lost_telemetry_turns_the_aircraft_grey(self, scene, state):
        show(scene, state=state, p_value=None, alert=False)
        scene.draw()
        for _, node in nodes(scene)._parts.values():
            assert np.ptp(node.color) < 12
        show(scene, t=1.05, delta_e=0.0)
        scene.draw()
        assert [node.color for _, node in nodes(scene)._parts.values()] == [
            part.colour for part in airframe("fighter")
        ]

    @pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
    def test_every_camera_sees_the_horizon_and_the_column_clear_of_the_aircraft(
        self, scene, camera
    ):
        narrowest = 1.05  # width over height
        parts = [part.vertices + part.hinge for part in airframe("fighter")]
        across, up = on_screen(np.concatenate(parts), camera)
        assert np.abs([*across, *up]).max() < 0.97
        edges = [(dx, dy, -h) for dx in (-0.5, 0.5) for dy in (-0.5, 0.5) for h in (0, 6.6)]
        x, _ = on_screen(np.array(COLUMN_AT) + edges, camera)
        assert np.abs(x).max() < narrowest
        assert x.max() < across.min() or x.min() > across.max()
        axis = np.linspace((0.0, 0.0, 0.0), (0.0, 0.0, -COLUMN_HEIGHT), 2)
        foot, top = on_screen(axis + COLUMN_AT, camera)[1]
        assert (top - foot) / 2 > 1 / 3
        ahead = np.array(camera.look_at) - camera.position
        rim = HORIZON * ahead / np.hypot(*ahead[:2])
        assert 0.1 < on_screen(np.array([(*rim[:2], GROUND_BELOW)]), camera)[1][0] < 0.8
        for at in (HEADLINE_AT, UNKNOWN_AT):  # above the figures of the page
            assert -0.66 < on_screen(np.array([at]), camera)[1][0] < -0.4


class TestTheTrack:
    def fly(self, n: int, psi_rate: float = 0.0, beta: float = 0.0) -> GroundTrack:
        track = GroundTrack()
        for k in range(n):
            track.advance(0.05 * k, Attitude(0.0, 0.0, psi_rate * 0.05 * k), beta, CALM)
        return track

    def test_the_camera_follows_the_heading_softly(self):
        assert self.fly(401).heading == 0.0
        late = self.fly(401, psi_rate=0.1).heading
        assert 1.5 < late < 2.0  # 0.1 rad/s for 20 s, less the lag of 2.5 s

    def test_the_ground_passes_along_heading_and_sideslip(self):
        north, east = self.fly(101, beta=0.1).place
        assert east / north == pytest.approx(np.tan(0.1))

    def test_the_trail_ends_at_the_wing_tips_and_lies_behind(self):
        points, _ = self.fly(401).trail((0, 0, 0))
        left, right = points.reshape(2, TRAIL_POINTS, 2, 3)
        assert left[-1, 1] == pytest.approx((-3.2, -5.2, 0.0), abs=1e-4)
        assert right[-1, 1] == pytest.approx((-3.2, 5.2, 0.0), abs=1e-4)
        assert (left[:, 0, 0] < left[:, 1, 0] + 1e-6).all()
        assert np.array_equal(left[1:, 0], left[:-1, 1])

    def test_the_trail_keeps_the_colour_of_its_time(self):
        track = self.fly(40)
        for k in range(40, 60):
            track.advance(0.05 * k, Attitude(0.0, 0.0, 0.0), 0.0, ALERT)
        _, colours = track.trail((0, 0, 0))
        red = (colours[..., 0] > 2 * colours[..., 1].astype(int)).any(1)
        assert red.any()
        assert not red.all()

    @pytest.mark.parametrize("t", [0.0, 60.0])
    def test_a_jump_in_time_starts_the_trail_anew(self, t):
        track = self.fly(100)
        track.advance(t, Attitude(0.0, 0.0, 1.0), 0.0, CALM)
        points, _ = track.trail((0, 0, 0))
        assert np.linalg.norm(points[:, 1] - points[:, 0], axis=1).max() == 0.0
        assert track.heading == 1.0
