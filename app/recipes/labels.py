"""Words of recipes in forms, lists, reports and help: labels, and the parameters' docstrings."""

import ast
import re
from collections.abc import Hashable
from dataclasses import is_dataclass
from functools import cache
from importlib import import_module
from inspect import getsource
from itertools import pairwise
from typing import Any

from core.channels import CHANNELS
from core.evaluation import IN_WORDS, THRESHOLD
from core.simulation.published import MODELS

FAMILIES = {
    "aircraft": "Aircraft",
    "nonlinear_aircraft": "Aircraft",
    "jsbsim_aircraft": "Aircraft",
    "control_law": "Control law",
    "maneuver": "Manoeuvre",
    "pilot": "Pilot",
    "limits": "Limits",
    "predictor": "Predictor",
    "score": "Score",
    "grouping": "Groups of failing flights",
}
KINDS: dict[str, str] = {
    **{name: model.title for name, model in MODELS.items()},
    "matrices": "Your own model (matrices)",
    "f16_polynomial": "F-16, polynomials",
    "ggam_f16c": "F-16C, generic model",
    "ggam_a7": "A-7, generic model",
    "jsbsim": "JSBSim",
    "none": "none, the bare airframe",
    "f16_sl_ofb": "F-16 output feedback (Stevens and Lewis)",
    "f16_damper": "F-16 yaw and roll damper",
    "f104a_damper": "F-104A yaw and roll damper",
    "f4c_damper": "F-4C yaw and roll damper",
    "attas_damper": "ATTAS yaw and roll damper",
    "nt33a_damper": "NT-33A yaw and roll damper",
    "b747_yaw_damper_mathworks": "Boeing 747 yaw damper (MathWorks)",
    "b747_yaw_damper_bryson": "Boeing 747 yaw damper (Bryson)",
    "state_space": "Your own control law (matrices)",
    "multistep_3211": "3-2-1-1 multistep",
    "wind_up_turn": "wind-up turn",
    "push_over_pull_up": "push-over pull-up",
    "rolling_pull_out": "rolling pull-out",
    "steady_heading_sideslip": "steady-heading sideslip",
    "table": "your own table of commands",
    "open_loop": "none: the planned commands are flown",
    "crossover": "in the loop, McRuer's crossover model",
    "linear": "linear, by least squares",
    "identity": "none, the observation itself",
    "pca": "principal components (PCA)",
    "last_output": "newest output",
    "nearest_neighbor": "nearest unsafe against nearest safe",
    "unsafe_distance": "distance to the nearest unsafe",
    "safe_distance": "distance from the nearest safe",
    "negative_magnitude": "magnitude of one channel",
    "response_filter": "test card, by a filter of the response",
    "input_filter": "test card and inputs, by a filter of the response",
    "peak_ridge": "peak to come, learned from safe flights",
    "ensemble": "outputs ahead and peak to come, as one",
    "pooled": "none, all failures together",
    "first_limit": "limit exceeded first",
    "largest_deflection": "largest deflection before the failure",
    "rest_of_card": "margin in what is left of the manoeuvre",
    "card_window": "margin within the lead and a little more",
    "highest_risk": "highest risk of the parts",
}
"""Labels of members whose key, with spaces for underscores, is not the field's word."""
METHODS = {
    "ensemble": "past failures and the peak still to come as one, in any manoeuvre",
    "peak_ahead": "forecast of the peak still to come, in any manoeuvre",
    "peak_soon": "forecast of the peak of the next samples: for inputs that switch several times",
    "test_card": "forecast of the test card: for doublets, pulses and other steps",
    "outputs_ahead": "forecast of the outputs against past failures: for any manoeuvre",
}
"""Labels of core.monitor.recipe.METHODS."""
TRIED = METHODS | {THRESHOLD: IN_WORDS}
"""Labels of methods tried on own rollouts."""
CHOICES: dict[str, dict[Hashable, str]] = {
    "calibration": {"trajectory": "as flown", "pointwise": "one sample (paper)"},
    "guarantee": {"average": "on average over monitors", "95%": "of this monitor, 95 % confident"},
    "imperfections": {"usual": "as usual in flight"},
    "scope": {"planned": "as planned", "near": "also near the planned ones"},
    "phase": {"input": "when its input moves a surface", "start": "first sample"},
    "scaling": {"safe_std": "standard deviation", "raw": "none (paper)"},
    "n_states": {3: "3: β, p, r", 4: "4: β, p, r, φ"},
    "unit": {"fraction": "fraction of the value", "absolute": "the parameter's own"},
    "axis": {"bank": "bank angle", "pitch": "pitch angle", "alpha": "angle of attack"},
    "spacing": {"log": "logarithmic in time", "linear": "linear in time"},
    "interpolation": {"hold": "held", "linear": "joined by straight lines"},
    "turbulence": {"smooth": "smooth air", "given": "as given"},
    "key": {channel.key: f"{channel.label} {channel.symbol}" for channel in CHANNELS},
    "name": {name: model.title for name, model in MODELS.items()},
}
"""Labels of the values of parameters, by parameter, where the value is not the field's word."""
UNIT = re.compile(r"\[([^\[\]]*[A-Za-z/%][^\[\]]*)\]")
SUFFIXES = {
    "_deg_s": "deg/s",
    "_rad_s": "rad/s",
    "_mps": "m/s",
    "_deg": "deg",
    "_hz": "Hz",
    "_s": "s",
    "_m": "m",
}


def kind_label(kind: str) -> str:
    return KINDS.get(kind) or kind.replace("_", " ")


def aircraft_label(plain: dict[str, Any]) -> str:
    """The label of an aircraft, with its name among those of JSBSim."""
    return " ".join(filter(None, [kind_label(plain["kind"]), plain.get("model")]))


def choice_label(parameter: str, value: Hashable) -> str:
    return CHOICES.get(parameter, {}).get(value) or str(value).replace("_", " ")


def descriptions(kind: type) -> dict[str, str]:
    """Attribute docstring of each parameter, inherited ones too; of a channel its label."""
    described = {channel.key: f"{channel.label} {channel.symbol}" for channel in CHANNELS}
    for base in reversed(kind.__mro__):
        if is_dataclass(base):
            described |= _docstrings(base.__module__).get(base.__name__, {})
    return described


@cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """Attribute docstrings of a module's classes. Pydantic would read the source per class."""
    tree = ast.parse(getsource(import_module(module)))
    return {
        each.name: {
            before.target.id: " ".join(str(ast.literal_eval(after.value)).split())
            for before, after in pairwise(each.body)
            if isinstance(before, ast.AnnAssign)
            and isinstance(before.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        }
        for each in tree.body
        if isinstance(each, ast.ClassDef)
    }


def title_of(name: str, description: str) -> str:
    """The label of a parameter: its description up to the first colon, semicolon or point.

    A family's parameter has the family's label.
    """
    head = re.split(r"[:;.](?:\s|$)", description, maxsplit=1)[0]
    return FAMILIES.get(name) or UNIT.sub("", head).strip() or name


def unit_of(name: str, description: str) -> str:
    """Unit of a parameter by its name's ending, the brackets in its description, or its channel.

    Empty without a unit.
    """
    for suffix, unit in SUFFIXES.items():
        if name.endswith(suffix):
            return unit
    if match := UNIT.search(description):
        return match[1]
    return next((channel.unit for channel in CHANNELS if channel.key == name), "")
