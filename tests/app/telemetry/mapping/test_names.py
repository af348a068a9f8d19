import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.telemetry.mapping.names import name_matches
from app.telemetry.mapping.vocabulary import MEANINGS
from app.telemetry.targets import TARGETS
from app.telemetry.units import spelled

# key -> (names without a unit, names that say one: what they say)
NAMES: dict[str, tuple[str, dict[str, str]]] = {
    "beta": (
        "beta BETA AOSS AoSS sideslip SideSlip ss_angle BETA_NB beta_nb SSA beta_vane vane_beta β "
        "sideslip_angle AngleOfSideslip Schiebewinkel dérapage adc.beta aero/beta beta_cal "
        "/fdm/jsbsim/aero/beta Air_Data:Beta beta_filt SSLIP BECG BETCG",
        {
            "SideSlip_deg": "deg", "beta_rad": "rad", "Beta [deg]": "deg", "beta,__deg": "deg",
            "BetaDeg": "deg", "/fdm/jsbsim/aero/beta-rad": "rad", "Schiebewinkel [°]": "deg",
            "beta / deg": "deg", "AOSS (deg)": "deg", "beta_from_trim_rad": "rad",
        },
    ),
    "p": (
        "p P roll_rate RollRate ROLLRATE rollrate wx gyro_x GyrX IMU.GyrX p_body Rollrate "
        "Ahrs1_bRollRate rollspeed omega_x vehicle_attitude/rollspeed imu/gyro/x xgyro "
        "PRGX p_roll_rate",
        {
            "P_degps": "deg/s", "p_radps": "rad/s", "roll_rate_deg_s": "deg/s",
            "p from trim [rad/s]": "rad/s",
            "P (deg/s)": "deg/s", "IMU_RollRate_dps": "deg/s", "P, rad/s": "rad/s",
            "P,_rad/s": "rad/s",
            "/fdm/jsbsim/velocities/p-rad_sec": "rad/s", "rollRate_dps": "deg/s",
            "p_rad/s": "rad/s",
        },
    ),
    "r": (
        "r R yaw_rate YawRate YAWRATE wz gyro_z GyrZ yawspeed Gierrate r_body omega_z yaw_gyro "
        "RRGZ RCG",
        {"r_degps": "deg/s", "YawRate [deg/s]": "deg/s", "r_radps": "rad/s"},
    ),
    "Ny": (
        "Ny NY ny n_y N_y Ny_cg NY_CG lat_acc LatAcc lat_accel accel_y AccY IMU.AccY ay AY a_y "
        "lateral_acceleration Ahrs1_bLatAcc Querbeschleunigung LatAc NYCG AYCG lateral_load_factor "
        "BLATA NY_LATERAL_ACCEL Gload,_side",
        {
            "ay_g": "g", "LATG": "g", "LAT_G": "g", "ay_m_s2": "m/s^2", "AY_MPS2": "m/s^2",
            "Lat. Acc. [g]": "g", "accelerometer_m_s2[1]": "m/s^2", "ay m/s²": "m/s^2",
            "Lateral Acceleration (ft/s^2)": "ft/s^2",
        },
    ),
    "delta_a": (
        "delta_a da DA ail AIL aileron Aileron AIL_POS aileron_position Querruder δ_a deltaA "
        "delta_aileron surf_ail AILERON_POSN",
        {"da_rad": "rad", "aileron_deg": "deg", "AilPos [deg]": "deg"},
    ),
    "delta_r": (
        "delta_r dr DR rud RUD rudder Rudder RUD_POS surf_rud rudder_position Seitenruder δr "
        "delta_rudder Rudder\\CAN1 rudder_deflection",
        {
            "dr_rad": "rad", "rudder_deg": "deg", "/fdm/jsbsim/fcs/rudder-pos-rad": "rad",
            "RUD_POS[deg]": "deg",
        },
    ),
    "delta_a_left": (
        "aileron_left LH_AIL_POS left-aileron ail_l DAL LAIL AILL AILLH LAILPOS DELAL",
        {"AIL_L_deg": "deg"},
    ),
    "delta_a_right": (
        "aileron_right RH_AIL_POS ail_r AilR DAR RAIL AILR AILRH RAILPOS DELAR",
        {"DAR [deg]": "deg"},
    ),
    "delta_r_left": ("rudder_left RUDL LRUD DRL", {}),
    "delta_r_right": ("rudder_right RRUD DRR", {}),
    "phi": (
        "phi PHI bank Bank bank_angle roll_angle RollAngle roll ATT.Roll Hängewinkel φ euler_phi "
        "PHICG",
        {"phi_deg": "deg", "Roll (deg)": "deg"},
    ),
    "theta": ("theta THE THET pitch PitchAngle pitch_attitude Nickwinkel θ", {"theta_rad": "rad"}),
    "psi": ("psi PSI heading HDG HDGT true_heading yaw yaw_angle Steuerkurs", {"psi_deg": "deg"}),
    "V": (
        "V TAS VTAS Vt true_airspeed airspeed Dadc1_tas adc.tas TrueAirspeed V_true VTASCG",
        {
            "V_mps": "m/s", "KTAS": "kt", "VKTAS": "kt", "true_airspeed_kts": "kt",
            "V_{Total} (ft/s)": "ft/s",
            "/fdm/jsbsim/velocities/vt-fps": "ft/s", "TAS [kt]": "kt",
        },
    ),
    "h": (
        "h alt ALT altitude press_alt pressure_altitude PressAlt Höhe baro_alt hp Dadc1_alt HBARO "
        "HPRES",
        {"alt_ft": "ft", "h-sl-ft": "ft", "__alt,ftmsl": "ft", "FL": "FL", "h_m": "m"},
    ),
    "v": ("lateral_velocity v_lat vy", {"v_body (m/s)": "m/s"}),
    "q0": ("q[0] qw q0", {}),
    "q3": ("q[3] qz q3", {}),
    "t": (
        "time TIME t T Time timestamp IRIG IRIG_Time Zeit _real,_time utc gps_time elapsed_time",
        {"Time_s": "s", "t_ms": "ms", "timestamp [us]": "us", "Time (sec)": "s"},
    ),
}  # fmt: skip
DECOYS = """
ALFA DE pressure p_static_pa oil_press_psi static_pressure rpm N1 N2 temperature t_oat_degc OAT
rudder_trim_cmd rudder_cmd rudder_pedal RUD_TRIM aileron_cmd ail_stick roll_cmd roll_stick
roll_setpoint vehicle_attitude_setpoint/roll_body beta_dot beta_dot_radps p_dot pitch_trim
yaw_accel roll_acceleration alt_sel heading_bug heading_error latitude longitude lat lon alpha AOA
alpha_rad q q_radps pitch_rate Nz nz_g nx ax accel_x accel_z gyro_y elevator flap speedbrake wind_v
frame counter dt delta_t rudder_rate aileron_hinge_moment psi_dot roll_error yaw_damper_status
beta_limit bank_limit rudder_force mach qbar rate_limit fuel_flow gear_pos engine_rpm v_gust
true_airspeed_innovation airspeed_innov beta_innov
yaw_residual rollrate_integ beta_derivative _Mach,ratio NZ_NORMAL_ACCEL
aileron_trim roll_rate_cmd yaw_rate_setpoint heading_ref airspeed_target altitude_error time_delay
""".split()  # noqa: SIM905
UNSURE = """
KIAS KCAS VCAS ground_speed gps_speed radio_altitude AGL v_bus r_range p_pitot GPS_yy roll_mix
_Vind,_kias Vtrue,_ktgs
"""


def _named(key: str) -> list[tuple[str, str, str]]:
    plain, said = NAMES[key]
    return [*((key, name, "") for name in plain.split()), *((key, *pair) for pair in said.items())]


@pytest.mark.parametrize(("key", "name", "unit"), [row for key in NAMES for row in _named(key)])
def test_a_name_gives_its_channel_and_unit(key, name, unit):
    first = name_matches(name)[0]
    assert (first.key, spelled(first.unit)) == (key, unit)
    assert first.certainty >= 0.5


@pytest.mark.parametrize("name", DECOYS)
def test_a_name_of_another_quantity_is_not_a_channel(name):
    assert [reading for reading in name_matches(name) if reading.certainty >= 0.3] == []


@pytest.mark.parametrize("name", UNSURE.split())
def test_an_uncertain_name_is_not_proposed(name):
    assert all(reading.certainty < 0.4 for reading in name_matches(name))


@pytest.mark.parametrize(
    ("group", "name", "key"),
    [
        ("vehicle_angular_velocity_0", "xyz[0]", "p"),
        ("vehicle_angular_velocity_0", "xyz[2]", "r"),
        ("vehicle_acceleration_0", "xyz[1]", "Ny"),
        ("vehicle_attitude_0", "q[2]", "q2"),
        ("airspeed_validated_0", "true_airspeed_m_s", "V"),
        ("sensor_combined_0", "gyro_rad[2]", "r"),
        ("adc", "beta", "beta"),
    ],
)
def test_the_group_completes_the_name(group, name, key):
    assert name_matches(name, group)[0].key == key


@pytest.mark.parametrize(
    "group", ["vehicle_attitude_setpoint", "actuator_limits", "estimator_innovation_variances_0"]
)
def test_a_group_of_commands_has_no_measurements(group):
    assert name_matches("roll", group) == ()


@pytest.mark.parametrize(
    ("surer", "less"),
    [
        ("roll_rate", "p"),
        ("yaw_rate", "r"),
        ("sideslip", "ss_angle"),
        ("beta", "beta_raw"),
        ("rudder", "rudder_2"),
        ("true_airspeed", "airspeed"),
        ("true_heading", "yaw"),
    ],
)
def test_an_unambiguous_name_is_more_certain(surer, less):
    assert name_matches(surer)[0].key == name_matches(less)[0].key
    assert name_matches(surer)[0].certainty > name_matches(less)[0].certainty


def test_v_can_be_the_speed_or_its_lateral_part():
    assert {reading.key for reading in name_matches("v")} == {"V", "v"}


@given(st.sampled_from([row[:2] for key in NAMES for row in _named(key)]), st.data())
def test_case_changes_nothing(row, data):
    key, name = row
    if name.islower() or name.isupper():
        assert name_matches(name.swapcase())[0].key == key


@given(st.text(max_size=30))
def test_any_name_gives_targets_or_time_with_a_certainty(name):
    for reading in name_matches(name, name):
        assert reading.key in TARGETS or reading.key == "t"
        assert 0.0 < reading.certainty <= 1.0


def test_every_word_of_the_vocabulary_means_itself():
    for stem, meant in MEANINGS.items():
        certainties = {reading.key: reading.certainty for reading in name_matches(stem)}
        for key, certainty in meant.items():
            assert certainties.get(key, 0.0) >= certainty - 1e-12, stem
