"""How outcomes, typed numbers and changed mappings are put in words."""

import pytest

from tests.browser.strips import Open, run


def test_a_manoeuvre_with_missing_data_is_never_green(strips: Open) -> None:
    right = "return h.validityWords({ validity: { valid: true }, outcome: 'unseen' }).level"
    assert run(strips(), right) == "caution"


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("0,05", ["0.05"]),
        ("0.05 0,1; .2", ["0.05", "0.1", ".2"]),
        ("0.1,0.2, 0.3", ["0.1", "0.2", "0.3"]),
        ("", []),
    ],
)
def test_a_comma_is_a_decimal_mark(strips: Open, text: str, numbers: list[str]) -> None:
    page = strips()
    assert page.evaluate("(text) => harness.decimals(text)", text) == numbers
    assert page.evaluate("() => [harness.decimal('-1,5'), harness.decimal('−2')]") == [-1.5, -2]
    assert page.evaluate("() => String(harness.decimal('1,5 s'))") == "NaN"


def test_a_test_of_own_rollouts_has_one_name(strips: Open) -> None:
    words = """async (monitor) => {
        const { testWords } = await import("/static/js/lib/catalog.js");
        const none = { entries: {} };
        const six = { nonlinear_aircraft: none, jsbsim_aircraft: none };
        const families = { aircraft: none, ...six, maneuver: none };
        return testWords({ families }, monitor);
    }"""
    page = strips()
    simulated = {"aircraft": {"kind": "f16"}, "maneuver": {"kind": "doublet"}}
    assert (
        page.evaluate(words, {"recipe": {"epsilon": 0.1}, "dataset_recipe": {}}) == "own rollouts"
    )
    assert page.evaluate(words, {"recipe": simulated}) == "f16, doublet"


def test_a_channel_is_named_once_and_its_unit_too(strips: Open) -> None:
    words = """async () => {
        const { channelName } = await import("/static/js/lib/catalog.js");
        const { isWithUnit } = await import("/static/js/recordings/mapping/signal_select.js");
        return [
            channelName({ symbol: "load", label: "load" }),
            channelName({ symbol: "N_y", label: "lateral acceleration" }),
            ["load [kN]", "p (deg/s)", "load", "load [kN]"].map(
                (name, k) => isWithUnit(name, ["kN", "deg/s", "kN", "lbf"][k])),
        ];
    }"""
    assert strips().evaluate(words) == [
        "load",
        "N_y lateral acceleration",
        [True, True, False, False],
    ]


def test_a_mapping_that_was_changed_names_what_differs(strips: Open) -> None:
    changed = run(
        strips(),
        """
        const source = { signal: 'a', unit: 'rad', sign: 1, bias: 0, derivation: '' };
        const mapping = (channels, t = 's') => ({ channels, times: { all: { signal: t } } });
        const now = mapping({ p: source, r: source });
        return [
          h.changedChannels(mapping({ r: { unit: 'rad', signal: 'a' }, p: source }), now),
          h.changedChannels(mapping({ p: { ...source, sign: -1 } }), now),
          h.changedChannels(mapping({ p: source, r: source }, 'clock'), now),
          h.changedChannels({ ...now, times: { all: { signal: 's', rate: 0, start: 0 } } }, now),
          h.changedChannels({ ...now, times: { all: { signal: '', rate: 50 } } }, now),
        ];
        """,
    )
    assert changed == [[], ["p", "r"], ["time"], [], ["time"]]
