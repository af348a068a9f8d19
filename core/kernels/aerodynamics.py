"""Force and moment coefficients of nonlinear aircraft, in body axes about the reference point.

Arguments are alpha, beta [rad], the rates p b/(2V), q c/(2V), r b/(2V), and aileron, rudder and
elevator [rad]; results C_X, C_Y, C_Z, C_l, C_m0, C_n0. Beyond the ranges in which a model holds,
its coefficients are those at the edge.
"""

import math

from core.kernels.compiled import jit

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
