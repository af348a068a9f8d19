"""Six-degree-of-freedom flight of nonlinear aircraft: trim, and rollouts in closed loop.

Flat earth, rigid symmetric aircraft, constant mass, thrust along the body x axis held at trim, air
density exponential about the trim altitude. States x of a rollout: u, v, w [m/s] and p, q, r
[rad/s] in body axes, quaternion from earth to body axes (4), altitude [m], aileron, rudder,
elevator [rad], then those of the law. Fourth-order Runge-Kutta. Equations: Stevens, Lewis and
Johnson, Aircraft Control and Simulation, 3rd ed., section 1.7.

The coefficients of force and moment are in body axes about the reference point. Their arguments are
alpha, beta [rad], the rates p b/(2V), q c/(2V), r b/(2V), and aileron, rudder and elevator [rad];
results C_X, C_Y, C_Z, C_l, C_m0, C_n0. Beyond the ranges in which a model holds, its coefficients
are those at the edge.
"""

import math
from typing import NamedTuple

import numpy as np

from core.kernels.compiled import jit
from core.kernels.lanes import address
from core.kernels.pilot import NOW, OUTPUT, place_of, seats, steer
from core.types import Array

ALTITUDE, SURFACES, LAW = 10, 11, 14
"""First positions of the altitude, the surfaces and the law's states in x."""
N_OUTPUTS = 14
"""Outputs: alpha, q, theta, Nz, beta, p, r, phi, Ny, V, elevator, aileron, rudder, and dynamic
pressure [Pa]."""
N_TRIM = 6
"""Unknowns of trim without sideslip: alpha, bank [rad], thrust per mass [m/s2],
aileron, rudder, elevator [rad]."""
ITERATIONS, STEP, RESIDUAL = 15, 1e-6, 1e-9


class Body(NamedTuple):
    """[kg], [m], [m2], [kg m2].   model: number of its aerodynamics.

    offset: of the centre of gravity ahead of the reference point [chords].
    """

    model: int
    mass: float
    span: float
    chord: float
    area: float
    ixx: float
    iyy: float
    izz: float
    ixz: float
    offset: float


class FlightPoint(NamedTuple):
    """[m/s], [rad], [rad/s], [kg/m3], [1/m], [m/s2].   turn: rate of heading.

    thinning: relative decrease of density with height.
    """

    airspeed: float
    climb: float
    bank: float
    turn: float
    altitude: float
    density: float
    thinning: float
    gravity: float


class Loop(NamedTuple):
    """The law K(s), see `Controller`, with its inputs from trim, and actuators.

    alpha_gain, pitch_gain: elevator per alpha, and per pitch rate [s].   rate, position: [rad/s],
    [rad], infinite without limits.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    alpha_gain: float
    pitch_gain: float
    bandwidth: float
    rate: float
    position: float


class Times(NamedTuple):
    """step: between outputs [s], `parts` Runge-Kutta steps.   substeps: outputs of a command.

    half_fade: share of a command's step that the pedal lag leaves after half a part.
    """

    step: float
    substeps: int
    parts: int
    half_fade: float


@jit
def accelerations(body, k, density, thrust, speed, p, q, r, alpha, beta, da, dr, de):
    """Specific forces without gravity [m/s2] and angular accelerations [rad/s2].

    k: (n_parameters,).   alpha, beta: in the air, with gusts.   thrust: per mass [m/s2].
    """
    half = 0.5 / max(speed, 1e-9)
    x, y, z, roll, pitch, yaw = coefficients(
        body.model,
        k,
        alpha,
        beta,
        p * body.span * half,
        q * body.chord * half,
        r * body.span * half,
        da,
        dr,
        de,
    )
    pitch += z * body.offset
    yaw -= y * body.offset * body.chord / body.span
    force = 0.5 * density * speed * speed * body.area
    roll *= force * body.span
    pitch *= force * body.chord
    yaw *= force * body.span
    ixx, iyy, izz, ixz = body.ixx, body.iyy, body.izz, body.ixz
    # I omega_dot = M - omega x (I omega)
    roll += (iyy - izz) * q * r + ixz * p * q
    pitch += (izz - ixx) * p * r + ixz * (r * r - p * p)
    yaw += (ixx - iyy) * p * q - ixz * q * r
    share = 1.0 / (ixx * izz - ixz * ixz)
    force /= body.mass
    return (
        force * x + thrust,
        force * y,
        force * z,
        (izz * roll + ixz * yaw) * share,
        pitch / iyy,
        (ixz * roll + ixx * yaw) * share,
    )


@jit
def _begun(point, alpha, bank):
    """Velocities u, w, rates p, q, r and pitch angle of a steady turn without sideslip.

    Pitch from the climb angle: Stevens, Lewis and Johnson, equation 3.6-3.
    """
    a, b = math.cos(alpha), math.cos(bank) * math.sin(alpha)
    climb = math.sin(point.climb)
    root = math.sqrt(max(a * a - climb * climb + b * b, 0.0))
    pitch = math.atan2(a * b + climb * root, a * a - climb * climb)
    p = -point.turn * math.sin(pitch)
    q = point.turn * math.sin(bank) * math.cos(pitch)
    r = point.turn * math.cos(bank) * math.cos(pitch)
    return point.airspeed * a, point.airspeed * math.sin(alpha), p, q, r, pitch


@jit
def _residual(body, k, point, z, out):
    """The six accelerations of a trim z (N_TRIM,), in m/s2 and rad/s2, into `out`."""
    u, w, p, q, r, pitch = _begun(point, z[0], z[1])
    ax, ay, az, out[3], out[4], out[5] = accelerations(
        body, k, point.density, z[2], point.airspeed, p, q, r, z[0], 0.0, z[3], z[4], z[5]
    )
    down = point.gravity * math.cos(pitch)
    out[0] = -q * w - point.gravity * math.sin(pitch) + ax
    out[1] = p * w - r * u + down * math.sin(z[1]) + ay
    out[2] = q * u + down * math.cos(z[1]) + az


@jit
def _solve(a, b):
    """Solve a x = b in place, (m, m) and (m,), with partial pivoting. False if singular."""
    m = len(b)
    for k in range(m):
        best = k
        for row in range(k + 1, m):
            if abs(a[row, k]) > abs(a[best, k]):
                best = row
        if not abs(a[best, k]) > 1e-12:
            return False
        for column in range(m):
            a[k, column], a[best, column] = a[best, column], a[k, column]
        b[k], b[best] = b[best], b[k]
        for row in range(k + 1, m):
            factor = a[row, k] / a[k, k]
            for column in range(k, m):
                a[row, column] -= factor * a[k, column]
            b[row] -= factor * b[k]
    for k in range(m - 1, -1, -1):
        for column in range(k + 1, m):
            b[k] -= a[k, column] * b[column]
        b[k] /= a[k, k]
    return True


@jit
def trim(body, theta, point, out, first, last):
    """Trim aircraft first..last-1 into out (n, N_TRIM), each from the values given there.

    Newton's method.   Returns the first aircraft without trim, or -1.
    """
    jacobian, now, moved = np.empty((N_TRIM, N_TRIM)), np.empty(N_TRIM), np.empty(N_TRIM)
    for i in range(first, last):
        z = out[i]
        found = False
        for _ in range(ITERATIONS):
            _residual(body, theta[i], point, z, now)
            worst = 0.0
            for k in range(N_TRIM):
                worst = max(worst, abs(now[k]))
            if worst < RESIDUAL:
                found = True
                break
            for column in range(N_TRIM):
                before = z[column]
                z[column] = before + STEP
                _residual(body, theta[i], point, z, moved)
                z[column] = before
                for row in range(N_TRIM):
                    jacobian[row, column] = (moved[row] - now[row]) / STEP
            if not _solve(jacobian, now):
                break
            for k in range(N_TRIM):
                z[k] -= now[k]
        if not found:
            return i
    return -1


@jit
def motion(body, k, point, thrust, x, alpha_gust, beta_gust, change):
    """Rates of change of the states up to the altitude, into `change`; surfaces are as in x.

    Returns alpha and beta in the air, the specific forces in y and z [m/s2], and the density.
    """
    u, v, w, p, q, r = x[0], x[1], x[2], x[3], x[4], x[5]
    q0, q1, q2, q3 = x[6], x[7], x[8], x[9]
    speed = math.sqrt(u * u + v * v + w * w)
    alpha = math.atan2(w, u) + alpha_gust
    beta = math.asin(v / max(speed, 1e-9)) + beta_gust
    density = point.density * (1.0 - point.thinning * (x[ALTITUDE] - point.altitude))
    ax, ay, az, change[3], change[4], change[5] = accelerations(
        body, k, density, thrust, speed, p, q, r, alpha, beta, x[11], x[12], x[13]
    )
    # the earth's vertical in body axes
    ahead = 2.0 * (q1 * q3 - q0 * q2)
    right = 2.0 * (q0 * q1 + q2 * q3)
    down = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    change[0] = r * v - q * w + point.gravity * ahead + ax
    change[1] = p * w - r * u + point.gravity * right + ay
    change[2] = q * u - p * v + point.gravity * down + az
    change[6] = -0.5 * (q1 * p + q2 * q + q3 * r)
    change[7] = 0.5 * (q0 * p + q2 * r - q3 * q)
    change[8] = 0.5 * (q0 * q + q3 * p - q1 * r)
    change[9] = 0.5 * (q0 * r + q1 * q - q2 * p)
    change[ALTITUDE] = -(ahead * u + right * v + down * w)
    return alpha, beta, ay, az, density


@jit
def bank_of(x):
    return math.atan2(2.0 * (x[6] * x[7] + x[8] * x[9]), 1.0 - 2.0 * (x[7] ** 2 + x[8] ** 2))


@jit
def _set_out(point, x, alpha, beta, ay, az, density, out):
    """Write the outputs of a state: `N_OUTPUTS`, or without the last."""
    speed2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    pitch = 2.0 * (x[6] * x[8] - x[7] * x[9])
    out[0], out[1], out[2] = alpha, x[4], math.asin(min(max(pitch, -1.0), 1.0))
    out[3], out[4], out[5], out[6] = -az / point.gravity, beta, x[3], x[5]
    out[7], out[8], out[9] = bank_of(x), ay / point.gravity, math.sqrt(speed2)
    out[10], out[11], out[12] = x[13], x[11], x[12]
    if len(out) == N_OUTPUTS:
        out[13] = 0.5 * density * speed2


@jit
def begin(point, z, x):
    """Set x to the trim z."""
    x[:] = 0.0
    x[0], x[2], x[3], x[4], x[5], pitch = _begun(point, z[0], z[1])
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cb, sb = math.cos(0.5 * z[1]), math.sin(0.5 * z[1])
    x[6], x[7], x[8], x[9] = cb * cp, sb * cp, cb * sp, -sb * sp
    x[ALTITUDE] = point.altitude
    x[11], x[12], x[13] = z[3], z[4], z[5]


@jit
def follow(loop, x, read, z, pitching, alpha, commands, left, change):
    """Rates of change of surfaces and law.

    read: (7,) inputs of the law, from trim.   pitching: pitch rate from trim.   commands, left:
    (3,) the pilot's, and what the pedal lag still leaves of the last change.
    """
    m = len(loop.a)
    for s in range(3):
        wanted = z[3 + s] + commands[s] + left[s]
        if s == 2:
            wanted += loop.alpha_gain * (alpha - z[0]) + loop.pitch_gain * pitching
        else:
            for c in range(len(read)):
                wanted -= loop.d[s, c] * read[c]
            for c in range(m):
                wanted -= loop.c[s, c] * x[LAW + c]
        wanted = min(max(wanted, -loop.position), loop.position)
        rate = loop.bandwidth * (wanted - x[SURFACES + s])
        change[SURFACES + s] = min(max(rate, -loop.rate), loop.rate)
    for j in range(m):
        change[LAW + j] = 0.0
        for c in range(len(read)):
            change[LAW + j] += loop.b[j, c] * read[c]
        for c in range(m):
            change[LAW + j] += loop.a[j, c] * x[LAW + c]


@jit
def outputs_of(body, k, point, thrust, x, gusts, change, out):
    """Outputs of a state, into `out`: `N_OUTPUTS`, or without the last.   gusts: [rad]."""
    alpha, beta, ay, az, density = motion(body, k, point, thrust, x, gusts[0], gusts[1], change)
    _set_out(point, x, alpha, beta, ay, az, density, out)


@jit
def roll_out(
    body, theta, point, trims, loop, pilot, times, gust, in_loop, memory, commands, out, first, last
):
    """Fly aircraft first..last-1 from trim into `out` (n, n_out, N_OUTPUTS or one less).

    theta: (n, n_parameters).   trims: (n, N_TRIM) of `trim`.   pilot: (1 or n, n_commands, 3)
    [rad] aileron, rudder and elevator from trim.   gust: (n or 0, n_out, 2) alpha and beta [rad],
    linear between outputs; only changes from the first count.   in_loop, memory: Pilots, and
    memory for one of them.   commands: workspace (3,).
    """
    n, h, in_parts = LAW + len(loop.a), times.step / times.parts, 1.0 / times.parts
    x, stage, change, total = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    left, held, read, air = np.empty(3), np.empty(3), np.zeros(7), np.empty(4)
    feeds_back_bank = loop.b[:, 6].any() or loop.d[:, 6].any()
    seat, steered = seats(in_loop, address(memory)), address(commands)
    for i in range(first, last):
        z, k, row = trims[i], theta[i], i if len(pilot) > 1 else 0
        begin(point, z, x)
        held[:], air[:] = 0.0, 0.0
        p0, q0, r0 = x[3], x[4], x[5]
        alpha, beta, side, az, density = motion(body, k, point, z[2], x, 0.0, 0.0, change)
        _set_out(point, x, alpha, beta, side, az, density, out[i, 0])
        for sample in range(1, out.shape[1]):
            number = (sample - 1) // times.substeps
            if number * times.substeps == sample - 1:
                for s in range(3):
                    commands[s] = pilot[row, number, s]
                for a in range(seat.n_axes):
                    o = int(in_loop.axes[a, OUTPUT])
                    memory[place_of(seat, 0, a) + NOW] = out[i, sample - 1, o] - out[i, 0, o]
                if seat.n_axes > 0:
                    steer(seat, 0, i, number, steered, 0, 1)
            for s in range(3):
                left[s] = held[s] - commands[s]
            if len(gust):
                for g in range(2):
                    air[g], air[2 + g] = air[2 + g], gust[i, sample, g] - gust[i, 0, g]
            for part in range(times.parts):
                for j in range(n):
                    stage[j] = x[j]
                    total[j] = 0.0
                for step in range(4):
                    if step == 1 or step == 3:
                        for s in range(3):
                            left[s] *= times.half_fade
                    share = (part + 0.5 * ((step + 1) // 2)) * in_parts
                    alpha_gust = air[0] + share * (air[2] - air[0])
                    beta_gust = air[1] + share * (air[3] - air[1])
                    alpha, beta, ay, _, _ = motion(
                        body, k, point, z[2], stage, alpha_gust, beta_gust, change
                    )
                    read[0], read[1], read[2] = beta, stage[3] - p0, stage[5] - r0
                    read[3] = (ay - side) / point.gravity
                    read[4], read[5] = stage[11] - z[3], stage[12] - z[4]
                    if feeds_back_bank:
                        read[6] = bank_of(stage) - z[1]
                    follow(loop, stage, read, z, stage[4] - q0, alpha, commands, left, change)
                    weight = 2.0 if step == 1 or step == 2 else 1.0
                    ahead = 0.5 * h if step < 2 else h
                    for j in range(n):
                        total[j] += weight * change[j]
                        stage[j] = x[j] + ahead * change[j]
                for j in range(n):
                    x[j] += h / 6.0 * total[j]
            length = 1.0 / math.sqrt(x[6] ** 2 + x[7] ** 2 + x[8] ** 2 + x[9] ** 2)
            for j in range(6, 10):
                x[j] *= length
            for s in range(3):
                held[s] = commands[s] + left[s]
            alpha, beta, ay, az, density = motion(body, k, point, z[2], x, air[2], air[3], change)
            _set_out(point, x, alpha, beta, ay, az, density, out[i, sample])


GENERIC, F16_POLYNOMIAL = 0, 1
"""The models, by number."""
RANGES = (
    (math.radians(-4.0), math.radians(30.0), math.radians(20.0)),
    (math.radians(-10.0), math.radians(45.0), math.radians(30.0)),
)
"""Of each model: lowest and highest alpha, and largest beta [rad]."""


@jit
def _within(x, low, high):
    return min(max(x, low), high)


@jit
def coefficients(model, k, alpha, beta, p, q, r, aileron, rudder, elevator):
    """The six coefficients of an aircraft.   k: its parameters (n_parameters,)."""
    if model == GENERIC:
        low, high, side = RANGES[GENERIC]
        a, b = _within(alpha, low, high), _within(beta, -side, side)
        return generic(k, a, b, p, q, r, aileron, rudder, elevator)
    low, high, side = RANGES[F16_POLYNOMIAL]
    a, b = _within(alpha, low, high), _within(beta, -side, side)
    return f16_polynomial(k, a, b, p, q, r, aileron, rudder, elevator)


@jit
def generic_stability_axes(k, a, b, p, q, r, aileron, rudder, elevator):
    """C_D, C_Y, C_L, C_l, C_m, C_n of the generic global aerodynamic model.

    Grauer and Morelli, Journal of Aircraft 52(1), 2015.   k: (45,) the model's parameters, in the
    order of that paper.   C_D and C_L are in stability axes.
    """
    drag = (
        k[0]
        + a * (k[1] + k[2] * q + k[3] * elevator)
        + a * a * (k[4] + k[5] * q + k[6] * elevator + a * (k[7] + k[8] * q + k[9] * a))
    )
    side = k[10] * b + k[11] * p + k[12] * r + k[13] * aileron + k[14] * rudder
    lift = k[15] + a * (k[16] + k[19] * q + a * (k[20] + a * (k[21] + a * k[22])))
    lift += k[17] * q + k[18] * elevator
    roll = k[23] * b + k[24] * p + k[25] * r + k[26] * aileron + k[27] * rudder
    pitch = k[28] + k[29] * a + k[37] * a * a * a * a
    pitch += q * (k[30] + a * (k[32] + a * (k[33] + a * k[35])))
    pitch += elevator * (k[31] + a * a * (k[34] + a * k[36]))
    yaw = b * (k[38] + b * (k[43] + b * k[44]))
    yaw += k[39] * p + k[40] * r + k[41] * aileron + k[42] * rudder
    return drag, side, lift, roll, pitch, yaw


@jit
def generic(k, a, b, p, q, r, aileron, rudder, elevator):
    drag, side, lift, roll, pitch, yaw = generic_stability_axes(
        k, a, b, p, q, r, aileron, rudder, elevator
    )
    ca, sa = math.cos(a), math.sin(a)
    return lift * sa - drag * ca, side, -lift * ca - drag * sa, roll, pitch, yaw


@jit
def f16_polynomial(k, a, b, p, q, r, aileron, rudder, elevator):
    """The F-16 polynomials of Morelli, American Control Conference 1998.

    k: (23,) factors on its functions, 1 as published, in the order of
    `core.simulation.nonlinear_aircraft.FACTORS`.
    Transcriptions differ in the first number of C_l0: -0.1058583 here, -0.105853 in another.
    """
    x0 = -0.01943367 + elevator * (-0.003348641 - 0.2903457 * elevator - 0.2060504 * a)
    x0 += a * (0.2136104 + a * (0.6988016 - 0.9035381 * a))
    xq = 0.4833383 + a * (8.644627 + a * (11.31098 + a * (-74.22961 + 60.75776 * a)))
    yp = -0.1006733 + a * (0.8679799 + a * (4.260586 - 6.923267 * a))
    yr = 0.8071648 + a * (0.1189633 + a * (4.177702 - 9.162236 * a))
    za = -0.1378278 + a * (-4.211369 + a * (4.775187 + a * (-10.26225 + 8.399763 * a)))
    zq = -30.54956 + a * (-41.32305 + a * (329.2788 + a * (-684.8038 + 408.0244 * a)))
    lb = -0.1058583 + a * (-0.5776677 + a * (-0.01672435 + a * (3.464156 - 2.835451 * a)))
    lb += b * (0.1357256 + a * (0.2172952 - 1.098104 * a))
    lp = -0.4126806 + a * (-0.1189974 + a * (1.247721 - 0.7391132 * a))
    lr = 0.06250437 + a * (0.6067723 + a * (-1.101964 + a * (9.100087 - 11.92672 * a)))
    la = -0.1463144 + a * (-0.0407391 + a * (0.4851209 - 0.3213068 * a))
    la += b * (0.03253159 + a * (0.297885 - 0.3746393 * a))
    ld = 0.02635729 - 0.0219291 * a - 0.01579864 * b * b
    ld += b * (-0.003152901 + a * (-0.05817803 + a * (0.4516159 - 0.4928702 * a)))
    m0 = -0.0202937 + 0.04660702 * a
    me = -0.6012308 + a * (-0.08062977 + 0.5018538 * a)
    me += elevator * (0.08320429 + 0.4226356 * a + 0.6378864 * elevator)
    mq = a * (-35.98636 + a * (224.7355 + a * (-412.0991 + 241.175 * a)))
    mq = -5.19153 + a * (-3.554716 + mq)
    nb = 0.2993363 + a * (0.06594004 + a * (-2.107885 + 0.8476901 * a))
    nb += b * (-0.2003125 + a * (-0.06233977 + 2.14142 * a))
    np_ = 0.02677652 + a * (-0.3298246 + a * (0.1926178 + a * (4.013325 - 4.404302 * a)))
    nr = -0.3698756 + a * (-0.1167551 - 0.7641297 * a)
    na = -0.03348717 + a * (0.04276655 + a * (0.2302543 - 0.2512876 * a))
    na += b * (0.006573646 + a * (0.3535831 + a * (-1.373308 + 1.237582 * a)))
    na += b * b * b * (0.1588105 - 0.5199526 * a)
    nd = -0.08115894 + a * (-0.0115658 + 0.1004297 * a)
    nd += b * (0.02514167 + a * (0.2038748 - 0.3337476 * a))
    x = k[0] * x0 + k[1] * xq * q
    y = -1.145916 * k[2] * b + 0.06016057 * k[3] * aileron + 0.1642479 * k[4] * rudder
    y += k[5] * yp * p + k[6] * yr * r
    z = k[7] * za * (1.0 - b * b) - 0.4354 * k[8] * elevator + k[9] * zq * q
    roll = k[10] * lb * b + k[11] * lp * p + k[12] * lr * r
    roll += k[13] * la * aileron + k[14] * ld * rudder
    pitch = k[15] * m0 + k[16] * me * elevator + k[17] * mq * q
    yaw = k[18] * nb * b + k[19] * np_ * p + k[20] * nr * r
    yaw += k[21] * na * aileron + k[22] * nd * rudder
    return x, y, z, roll, pitch, yaw
