"""The attitude indicator and its figures, fed by hand."""

import json
from math import pi
from typing import Any

import pytest

from tests.browser.strips import Open, run

CHANNELS = [{"key": "beta", "unit": "rad"}, {"key": "Ny", "unit": "g"}]


def shown(strips: Open, frame: dict[str, Any] | None, channels: list[Any] = CHANNELS) -> Any:
    hello = {"channels": channels, "no_plan": ""}
    return run(
        strips(),
        f"""
        const indicator = h.createAttitudeIndicator();
        indicator.show({to_js(frame)}, {to_js(hello)});
        const {{ element, figures }} = indicator;
        const text = (key) => figures.querySelector(`[data-angle="${{key}}"] b`).textContent;
        const hidden = (name) => element.querySelector(name).closest("[hidden]") !== null;
        return {{
          label: element.getAttribute("aria-label"),
          angles: ["phi", "theta", "psi", "beta"].map(text),
          turn: element.querySelector(".attitude-sky").parentNode.getAttribute("transform"),
          ball: Number(element.querySelector(".attitude-ball").getAttribute("cx")),
          unknown: !hidden(".attitude-unknown"),
          noBall: hidden(".attitude-ball"),
        }};
        """,
    )


def to_js(value: Any) -> str:
    return json.dumps(value)


def test_a_right_bank_turns_the_horizon_left_and_nose_up_lowers_it(strips: Open) -> None:
    seen = shown(strips, {"attitude": [pi / 6, pi / 18, -pi / 2], "y": [0.1, 0.0]})
    assert seen["label"].endswith("bank 30°, pitch 10°")
    assert seen["angles"] == ["+30.0°", "+10.0°", "270.0°", "+5.7°"]
    assert float(seen["turn"].split("(")[1].split(")")[0]) == pytest.approx(-30)
    assert float(seen["turn"].split()[-1].strip(")")) > 0
    assert not seen["unknown"]


def test_what_is_not_known_says_so_and_is_never_a_zero(strips: Open) -> None:
    for frame in (None, {"y": [None, None]}, {"attitude": [None, 0.1, None], "y": [None, None]}):
        seen = shown(strips, frame)
        assert seen["unknown"]
        assert seen["noBall"]
        assert seen["label"] == "Attitude unknown"
        assert seen["angles"][0] == seen["angles"][2] == seen["angles"][3] == "unknown"


def test_an_integrated_angle_is_marked(strips: Open) -> None:
    seen = shown(strips, {"attitude": [0.1, 0.0, 0.0], "integrated": True, "y": [0.0, 0.0]})
    assert [angle.startswith("≈") for angle in seen["angles"]] == [True, True, True, False]


def test_the_ball_moves_against_the_lateral_acceleration_else_with_the_sideslip(
    strips: Open,
) -> None:
    frame = {"attitude": [0.0, 0.0, 0.0], "y": [0.05, -0.1]}
    assert shown(strips, frame)["ball"] == 10
    right = shown(strips, frame, [CHANNELS[0]])["ball"]
    assert 0 < right < 10


@pytest.mark.parametrize("height", [150, 320])
def test_on_the_wall_it_covers_little_of_the_scene(strips: Open, height: int) -> None:
    page = strips()
    for sheet in ("fly", "wall"):
        page.add_style_tag(url=f"/static/{sheet}.css")
    box = run(
        page,
        f"""
        const scene = document.createElement("div");
        scene.style = "position: relative; width: 440px; height: {height}px";
        const indicator = h.createAttitudeIndicator();
        indicator.show({{ attitude: [0, 0, 0], y: [0, 0] }}, {{ channels: [], no_plan: "" }});
        scene.append(indicator.element);
        const flight = document.createElement("div");
        flight.className = "flight";
        flight.toggleAttribute("data-wall", true);
        flight.append(scene);
        document.body.append(flight);
        const {{ width, height }} = scene.firstChild.getBoundingClientRect();
        flight.remove();
        return [width, height];
        """,
    )
    assert 50 < box[0] <= 0.36 * 440 + 1
    assert box[1] < height
