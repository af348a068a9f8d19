import json
import re
import subprocess
import sys
from dataclasses import replace
from typing import Any, Literal, get_args

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from core.channels import KEYS
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft, PublishedAircraft, Uncertainty
from core.simulation.published import DERIVATIVES, MODELS, SIGMA_FRACTION, ModelName
from tests.support.places import SHARED

REFERENCE = SHARED / "reference" / "aircraft.json"
NAMES = tuple(MODELS)
# The reference rounds every entry to six decimals, so each number is known to half of the last one.
PRINTED = 0.5e-6 * (1 + 1e-6)

A = ((-0.3, 0.04, -0.99), (-30.0, -3.7, 0.66), (8.5, -0.03, -0.48))
B = ((0.02, 0.05), (-42.0, 7.5), (-1.8, -3.6))
C = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-5.0, 0.0, 0.1))
D = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.27, 0.72))
DOCUMENT = {"A": A, "B": B, "C": C, "D": D, "uncertainty": {"spread": {"A[0,0]": 0.1}}}
KNOWN = Uncertainty({})


@pytest.fixture(scope="module")
def reference() -> dict[str, Any]:
    if not REFERENCE.exists():
        pytest.skip(f"the reference data are not beside the repository ({REFERENCE.name})")
    return json.loads(REFERENCE.read_text())


def modes(a: np.ndarray) -> tuple[list[tuple[float, float]], list[float]]:
    """(natural frequency [rad/s], damping) of each oscillation; real poles, slowest first."""
    poles = np.linalg.eigvals(a)
    dutch = [(abs(s), -s.real / abs(s)) for s in poles if s.imag > 1e-9]
    return dutch, sorted((s.real for s in poles if abs(s.imag) <= 1e-9), reverse=True)


def nominal_a(name: ModelName, n_states: Literal[3, 4]) -> np.ndarray:
    return PublishedAircraft(name, n_states).uncertain_plant().nominal_plant().a[0]


def matrices(**changes: Any) -> MatrixAircraft:
    return MatrixAircraft.from_json(DOCUMENT | changes)


@pytest.mark.parametrize("n_states", [3, 4])
@pytest.mark.parametrize("name", NAMES)
def test_nominal_matrices_equal_the_reference_to_its_printed_digits(reference, name, n_states):
    plant = PublishedAircraft(name, n_states).uncertain_plant().nominal_plant()
    printed = {key: np.array(reference["aircraft"][name][key]) for key in "ABCD"}
    x = slice(n_states)
    np.testing.assert_allclose(plant.a[0], printed["A"][x, x], rtol=0, atol=PRINTED)
    np.testing.assert_allclose(plant.b[0], printed["B"][x], rtol=0, atol=PRINTED)
    np.testing.assert_allclose(plant.c[0], printed["C"][:, x], rtol=0, atol=PRINTED)
    np.testing.assert_allclose(plant.d[0], printed["D"], rtol=0, atol=PRINTED)


@pytest.mark.parametrize("n_states", [3, 4])
@pytest.mark.parametrize("name", NAMES)
def test_modes_are_those_of_the_reference(reference, name, n_states):
    printed = reference["aircraft"][name][f"computed_modes_{n_states}state"]
    dutch, real = modes(nominal_a(name, n_states))
    # Four printed decimals, of modes computed before the matrices were rounded.
    np.testing.assert_allclose(dutch, printed["dutch"], rtol=0, atol=1e-4)
    np.testing.assert_allclose(real, printed["real"], rtol=0, atol=1e-4)


def test_the_catalogue_and_its_scatter_equal_the_reference(reference):
    assert set(reference["aircraft"]) == set(MODELS) == set(get_args(ModelName))
    assert reference["uncertainty_1sigma_fraction"]["values"] == SIGMA_FRACTION
    assert set(SIGMA_FRACTION) == set(DERIVATIVES)
    for name, model in MODELS.items():
        printed = reference["aircraft"][name]
        trim = model.speed, np.rad2deg(model.alpha0), np.rad2deg(model.theta0)
        assert trim == pytest.approx([printed[k] for k in ("V_mps", "alpha0_deg", "theta0_deg")])


@pytest.mark.parametrize(
    ("name", "dutch", "real", "rtol"),
    [
        # NASA CR-2144 (1972), Table II-8: Dutch roll 1.13 rad/s, 0.0609; spiral, roll; 3 digits.
        ("nt33a_fc1_pa", (1.13, 0.0609), (-0.0318, -2.20), 5e-3),
        # Cook, Flight Dynamics Principles, Ex. 7.1: (s+0.0065)(s+1.329)(s^2+0.254s+1.433).
        ("dc8_15k_m0p44", (1.433**0.5, 0.127 / 1.433**0.5), (-0.0065, -1.329), 5e-3),
        # MathWorks, Yaw Damper Design for a 747: -3.29e-2 +- 0.947j, -7.28e-3, -0.563.
        ("b747_40k_m0p8", (0.9476, 0.0329 / 0.9476), (-7.28e-3, -0.563), 2e-3),
    ],
)
def test_four_state_modes_are_the_published_ones(name, dutch, real, rtol):
    (found,), poles = modes(nominal_a(name, 4))
    assert found == pytest.approx(dutch, rel=rtol)
    assert poles == pytest.approx(real, rel=rtol)


def test_dropping_bank_angle_overstates_dutch_roll_damping():
    # NT-33A, g/V = 0.14: 0.061 with phi, 0.155 without; no spiral is left.
    (with_phi,), _ = modes(nominal_a("nt33a_fc1_pa", 4))
    (without,), real = modes(nominal_a("nt33a_fc1_pa", 3))
    assert (with_phi[1], without[1]) == pytest.approx((0.061, 0.155), abs=1e-3)
    assert len(real) == 1


@pytest.mark.parametrize("aircraft", AIRCRAFT.values(), ids=AIRCRAFT)
class TestEveryAircraft:
    def test_plants_have_the_documented_shapes(self, aircraft):
        plant = aircraft.uncertain_plant()
        theta = plant.sample(5, np.random.default_rng(1))
        nx = len(plant.states)
        plants = plant.plants(theta)
        assert theta.shape == (5, len(plant.names))
        assert [m.shape for m in plants] == [(5, nx, nx), (5, nx, 2), (5, 6, nx), (5, 6, 2)]
        for array in (theta, *plants):
            assert array.flags.c_contiguous
            assert array.dtype == np.float64
            assert np.isfinite(array).all()

    def test_the_last_outputs_are_the_surfaces(self, aircraft):
        plant = aircraft.uncertain_plant()
        plants = plant.plants(plant.sample(4, np.random.default_rng(2)))
        assert not plants.c[:, 4:].any()
        assert (plants.d[:, 4:] == np.eye(2)).all()

    def test_sampling_depends_only_on_the_generator(self, aircraft):
        first, second = (
            aircraft.uncertain_plant().sample(7, np.random.default_rng(3)) for _ in range(2)
        )
        assert (first == second).all()
        assert first.std(axis=0).any()

    def test_the_nominal_plant_is_the_plant_of_the_nominal_theta(self, aircraft):
        plant = aircraft.uncertain_plant()
        certain = replace(plant, spread=np.zeros_like(plant.spread))
        batch = certain.plants(certain.sample(3, np.random.default_rng(4)))
        for sampled, nominal in zip(batch, plant.nominal_plant(), strict=True):
            assert (sampled == nominal).all()

    def test_zero_rollouts_are_an_empty_batch(self, aircraft):
        plant = aircraft.uncertain_plant()
        plants = plant.plants(plant.sample(0, np.random.default_rng(5)))
        assert [len(m) for m in plants] == [0, 0, 0, 0]

    def test_it_survives_json(self, aircraft):
        adapter = TypeAdapter(type(aircraft))
        again = adapter.validate_json(adapter.dump_json(aircraft))
        assert again == aircraft
        assert hash(again) == hash(aircraft)
        assert "uncertainty" in adapter.json_schema()["properties"]

    def test_it_has_a_description(self, aircraft):
        assert aircraft.description
        assert "\n" not in aircraft.description


@pytest.mark.parametrize("n_states", [3, 4])
@pytest.mark.parametrize("derivative", DERIVATIVES)
def test_a_derivative_changes_only_its_own_entries(derivative, n_states):
    plant = PublishedAircraft("attas_id_16kft", n_states).uncertain_plant()
    theta = plant.nominal[np.newaxis].copy()
    theta[0, plant.names.index(derivative)] += 1.0
    moved = [m - m0 for m, m0 in zip(plant.plants(theta), plant.nominal_plant(), strict=True)]

    letter, cause = derivative.split("_")
    row = "YLN".index(letter)
    into_x, into_y, column = (
        (1, 3, ("da", "dr").index(cause))
        if cause in ("da", "dr")
        else (0, 2, ("beta", "p", "r").index(cause))
    )
    expected = [np.zeros_like(m) for m in moved]
    expected[into_x][0, row, column] = 1.0
    if letter == "Y":
        expected[into_y][0, 3, column] = 131.0 / 9.80665
    for got, wanted in zip(moved, expected, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12)


@given(st.sampled_from(NAMES), st.integers(0, 2**32 - 1))
def test_side_force_and_lateral_acceleration_agree_in_every_plant(name, seed):
    plant = PublishedAircraft(name, 4, Uncertainty(0.3)).uncertain_plant()
    plants = plant.plants(plant.sample(3, np.random.default_rng(seed)))
    model = MODELS[name]
    kinematic = plant.fixed.a[0, 0]
    side = (plants.a[:, 0] - kinematic) * model.speed / model.gravity
    np.testing.assert_allclose(plants.c[:, 3], side, rtol=1e-9, atol=1e-12)
    side = plants.b[:, 0] * model.speed / model.gravity
    np.testing.assert_allclose(plants.d[:, 3], side, rtol=1e-12)
    assert (plants.a[:, 0, 3] == plant.fixed.a[0, 0, 3]).all()
    assert (plants.a[:, 3] == plant.fixed.a[0, 3]).all()


@pytest.mark.parametrize("name", NAMES)
def test_altitude_is_that_of_the_stated_condition(name):
    condition = MODELS[name].condition
    feet = re.findall(r"([\d,]+) ft(?!/)", condition)
    expected = 0.0 if "sea level" in condition else float(feet[0].replace(",", "")) * 0.3048
    assert PublishedAircraft(name).condition.altitude == pytest.approx(expected)


def test_the_default_scatter_is_the_published_one_sigma():
    plant = PublishedAircraft("f16_sl_h0_v502").uncertain_plant()
    theta = plant.sample(40_000, np.random.default_rng(6))
    # Standard errors: 0.35 % of a standard deviation, 0.5 % of sigma for a mean; five of each.
    sigma = np.array([SIGMA_FRACTION[name] for name in DERIVATIVES]) * np.abs(plant.nominal)
    np.testing.assert_allclose(theta.std(axis=0), sigma, rtol=0.018)
    np.testing.assert_array_less(np.abs(theta.mean(axis=0) - plant.nominal), 0.025 * sigma)
    correlation = np.corrcoef(theta.T) - np.eye(len(DERIVATIVES))
    assert np.abs(correlation).max() < 0.025


def test_a_uniform_spread_is_a_half_width():
    plant = PublishedAircraft("f16_sl_h0_v502", 3, Uncertainty(0.2, "uniform")).uncertain_plant()
    theta = plant.sample(20_000, np.random.default_rng(7))
    relative = theta / plant.nominal - 1.0
    assert np.abs(relative).max() <= 0.2 * (1 + 1e-12)
    assert (np.abs(relative).max(axis=0) > 0.199).all()
    np.testing.assert_allclose(relative.std(axis=0), 0.2 / 3**0.5, rtol=0.02)


def test_an_unnamed_derivative_is_certain_and_draws_no_numbers():
    uncertainty = Uncertainty({"N_dr": 0.5}, unit="absolute")
    plant = PublishedAircraft("f16_sl_h0_v502", 3, uncertainty).uncertain_plant()
    theta = plant.sample(100, np.random.default_rng(8))
    k = DERIVATIVES.index("N_dr")
    drawn = plant.nominal[k] + 0.5 * np.random.default_rng(8).standard_normal(100)
    np.testing.assert_allclose(theta[:, k], drawn, rtol=1e-15)
    assert (np.delete(theta, k, axis=1) == np.delete(plant.nominal, k)).all()


def test_a_derivative_of_zero_has_no_fractional_scatter():
    plant = PublishedAircraft("f104a_sl_m0p8").uncertain_plant()
    assert plant.nominal[DERIVATIVES.index("Y_da")] == 0.0
    assert plant.spread[DERIVATIVES.index("Y_da")] == 0.0


def test_own_matrices_get_the_surfaces_appended():
    plant = matrices(states=["beta", "p", "r"]).uncertain_plant()
    a, b, c, d = (m[0] for m in plant.nominal_plant())
    assert (plant.states, plant.names) == (("beta", "p", "r"), ("A[0,0]",))
    np.testing.assert_array_equal(a, A)
    np.testing.assert_array_equal(b, B)
    np.testing.assert_array_equal(c, np.vstack((C, np.zeros((2, 3)))))
    np.testing.assert_array_equal(d, np.vstack((D, np.eye(2))))


def test_six_own_outputs_equal_four():
    whole = matrices(C=[*C, (0, 0, 0), (0, 0, 0)], D=[*D, (1, 0), (0, 1)])
    for six, four in zip(
        whole.uncertain_plant().nominal_plant(),
        matrices().uncertain_plant().nominal_plant(),
        strict=True,
    ):
        np.testing.assert_array_equal(six, four)


def test_own_entries_vary_independently():
    spread = {"A[0,0]": 0.1, "D[3,1]": 0.2}
    plant = matrices(uncertainty={"spread": spread, "distribution": "uniform"}).uncertain_plant()
    theta = plant.sample(500, np.random.default_rng(9))
    plants = plant.plants(theta)
    assert (plants.a[:, 0, 0] == theta[:, 0]).all()
    assert (plants.d[:, 3, 1] == theta[:, 1]).all()
    assert np.abs(theta - [-0.3, 0.72]).max(axis=0) == pytest.approx([0.03, 0.144], rel=0.02)
    assert [np.ptp(m, axis=0).astype(bool).sum() for m in plants] == [1, 0, 0, 1]


def test_one_spread_number_leaves_structural_entries_certain():
    plant = matrices(uncertainty={"spread": 0.1}).uncertain_plant()
    assert len(plant.names) == 9 + 6 + 2 + 2
    assert not {"C[0,0]", "C[3,1]", "D[0,0]", "D[4,0]"} & set(plant.names)


def test_a_certain_own_model_has_an_empty_theta():
    plant = MatrixAircraft(A, B, C, D, KNOWN).uncertain_plant()
    theta = plant.sample(3, np.random.default_rng(10))
    assert theta.shape == (3, 0)
    np.testing.assert_array_equal(plant.plants(theta).a, np.broadcast_to(A, (3, 3, 3)))


def test_an_own_zero_varies_by_an_absolute_spread():
    uncertainty = {"spread": {"C[3,1]": 0.2}, "unit": "absolute"}
    plant = matrices(uncertainty=uncertainty).uncertain_plant()
    assert plant.spread.tolist() == [0.2]


def test_labelled_signals_of_a_statespace_may_be_in_any_order():
    extra = np.vstack((np.ones((1, 3)), C))[::-1]
    system = control.ss(
        A, np.flip(B, axis=1), extra, np.flip(np.vstack((np.ones((1, 2)), D)), axis=(0, 1)),
        inputs=["delta_r", "delta_a"], outputs=["Ny", "r", "p", "beta", "alpha"],
        states=["beta", "p", "r"],
    )  # fmt: skip
    assert MatrixAircraft.from_statespace(system, KNOWN) == MatrixAircraft(
        A, B, C, D, KNOWN, ("beta", "p", "r")
    )


@pytest.mark.parametrize("n_outputs", [4, 6])
def test_unlabelled_signals_of_a_statespace_are_taken_in_order(n_outputs):
    c = np.vstack((C, np.zeros((2, 3))))[:n_outputs]
    d = np.vstack((D, np.eye(2)))[:n_outputs]
    made = MatrixAircraft.from_statespace(control.ss(A, B, c, d), KNOWN)
    for got, wanted in zip(
        made.uncertain_plant().nominal_plant(),
        matrices().uncertain_plant().nominal_plant(),
        strict=True,
    ):
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.ss(A, B, C, D, dt=0.05), "sampled every 0.05 s"),
        (control.tf([1], [1, 1]), "TransferFunction was given"),
        (
            # Actuators inside the model: its surfaces are states, not the commands.
            control.ss(A, B, [*C, *A[:2]], [*D, (0, 0), (0, 0)], outputs=list(KEYS)),
            "not delta_a and delta_r themselves",
        ),
        (control.ss(A, B, C, D, inputs=["aileron", "rudder"]), "label them delta_a, delta_r"),
        (control.ss(A, B, C[:3], D[:3]), "outputs are .* label them beta, p, r, Ny"),
    ],
)
def test_an_unfitting_statespace_is_refused(system, message):
    with pytest.raises(ValueError, match=message):
        MatrixAircraft.from_statespace(system, KNOWN)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": A[:2]}, "A is 2 by 3; with 2 states it needs 2 by 2"),
        ({"B": [[1.0], [2.0], [3.0]]}, "B is 3 by 1; with 3 states it needs 3 by 2"),
        ({"C": C[:3]}, r"C is 3 by 3; with 3 states it needs 4 by 3 \(rows beta, p, r, Ny\)"),
        ({"D": [*D, (1, 0), (0, 1)]}, "D is 6 by 2; with 3 states it needs 4 by 2"),
        ({"C": [*C, *A[:2]], "D": [*D, (1, 0), (0, 1)]}, "not delta_a and delta_r themselves"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A is .*; give a list of rows of equally many numbers"),
        ({"A": "hello"}, "A is 'hello'; give a list of rows"),
        ({"A": []}, "A is .*; give a list of rows"),
        ({"B": [[1, 2], [3, None], [5, 6]]}, r"B\[1,1\] is nan; give a finite number"),
        ({"D": [[0, 0], [0, 0], [0, 0], [0, float("inf")]]}, r"D\[3,1\] is inf"),
        ({"states": ["beta"]}, "1 states are named; A is 3 by 3"),
        ({"states": "abc"}, "states is 'abc'; give a list of names"),
        ({"E": 1}, "the model has no 'e'"),
        ({"altitude_m": -5}, "altitude_m=-5 was given: it must be at least 0"),
        ({"airspeed_mps": "fast"}, "must be real number"),
        ({"airspeed_mps": 0}, "airspeed_mps=0 was given: it must be positive"),
        ({"uncertainty": 0.1}, "uncertainty with its spread"),
        ({"uncertainty": {"spread": 0.1, "sigma": 1}}, "uncertainty has no 'sigma'"),
        ({"uncertainty": {"spread": {"A[0,0]": -0.1}}}, r"spread of A\[0,0\] is -0.1"),
        ({"uncertainty": {"spread": {"A[0,0]": "wide"}}}, "is 'wide'; give a finite number"),
        ({"uncertainty": {"spread": {"A[3,0]": 0.1}}}, r"'A\[3,0\]' is not an entry"),
        ({"uncertainty": {"spread": {"C[4,0]": 0.1}}}, r"within A 3 by 3, B 3 by 2, C 4 by 3"),
        ({"uncertainty": {"spread": {"A[0, 0]": 0.1}}}, "write it like"),
        ({"uncertainty": {"spread": {"A[00,0]": 0.1}}}, "write it like"),
        ({"uncertainty": {"spread": {"L_p": 0.1}}}, "'L_p' is not an entry"),
        ({"uncertainty": {"spread": {"C[3,1]": 0.1}}}, r"C\[3,1\] is 0 and a fraction of 0"),
        ({"uncertainty": {"spread": 0.1, "unit": "percent"}}, "unit='percent' was given: choose"),
    ],
)
def test_unfitting_own_matrices_are_refused_in_one_sentence(changes, message):
    with pytest.raises(ValueError, match=message) as error:
        matrices(**changes)
    assert "\n" not in str(error.value)


def test_own_matrices_may_have_a_flight_condition():
    assert matrices().condition[2:] == (None, None)
    flown = matrices(altitude_m=4800, airspeed_mps=131.0)
    assert flown.condition[2:] == (4800, 131.0)


def test_a_document_without_a_model_is_refused():
    with pytest.raises(ValueError, match="give a JSON object with A, B, C, D"):
        MatrixAircraft.from_json([1, 2])
    with pytest.raises(ValueError, match="give a JSON object with A, B, C, D"):
        MatrixAircraft.from_json({"A": A})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PublishedAircraft("concorde"), "no published model 'concorde'; there are f16"),  # pyright: ignore[reportArgumentType]
        (lambda: PublishedAircraft("dc8_15k_m0p44", 5), "n_states is 5; give 3"),  # pyright: ignore[reportArgumentType]
        (
            lambda: PublishedAircraft("dc8_15k_m0p44", 3, Uncertainty({"L_q": 0.1})),
            "names L_q; this aircraft's parameters are Y_beta",
        ),
        (lambda: Uncertainty(-0.1), "spread of every parameter is -0.1; give"),
        (lambda: Uncertainty(float("nan")), "spread of every parameter is nan"),
        (lambda: Uncertainty({"L_p": float("inf")}), "spread of L_p is inf"),
        (
            lambda: Uncertainty(0.1, "gaussian"),  # pyright: ignore[reportArgumentType]
            "distribution='gaussian' was given: choose normal or uniform",
        ),
    ],
)
def test_an_impossible_recipe_is_refused_in_one_sentence(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_theta_of_another_aircraft_is_refused():
    plant = PublishedAircraft("f16_sl_h0_v502").uncertain_plant()
    with pytest.raises(ValueError, match=r"shape \(2, 3\); this aircraft needs \(n, 15\)"):
        plant.plants(np.zeros((2, 3)))


def test_python_control_is_imported_only_for_its_own_models():
    code = "import sys, core.simulation.aircraft; sys.exit('control' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
