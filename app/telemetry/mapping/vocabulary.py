"""Names of the channels in flight test, in several languages and programs, with certainties."""

from collections.abc import Iterator

# target -> certainty of the name alone -> spellings without spaces, in lower case
STEMS: dict[str, dict[float, str]] = {
    "beta": {
        0.97: "sideslip sslip sideslipangle angleofsideslip aoss schiebewinkel derapage "
        "sideslipang",
        0.93: "beta betavane vanebeta betanb betcg becg ssa aos betav",
        0.8: "slipangle angleofslip ssangle slipang",
        0.6: "ss slip",
    },
    "p": {
        0.97: "rollrate rateroll rollgeschwindigkeit rollwinkelgeschwindigkeit rollangularrate "
        "rollangularvelocity bodyrollrate",
        0.88: "rollspeed gyrox xgyro gyrx angularvelocityx angularratex omegax rollgyro rolrate "
        "prate prgx angvelx vitesseroulis",
        0.75: "p wx pb ratex xrate omgx omegap",
    },
    "r": {
        0.97: "yawrate rateyaw gierrate gierwinkelgeschwindigkeit giergeschwindigkeit "
        "yawangularrate yawangularvelocity bodyyawrate",
        0.88: "yawspeed gyroz zgyro gyrz angularvelocityz angularratez omegaz yawgyro "
        "rrate rrgz angvelz vitesselacet",
        0.7: "r wz rb ratez zrate omgz omegar",
    },
    "Ny": {
        0.95: "lateralacceleration lateralaccel lateralacc latacc lataccel latacceleration latg "
        "lateralg lateralloadfactor querbeschleunigung sideacceleration lateralspecificforce "
        "acclat accellat latloadfactor blata lateralbodyacceleration "
        "sideforcecoefficientload alat nlat nylat ylat",
        0.9: "ny ay accely accy yaccel yacc accelerationy yacceleration accelerometery "
        "accelerometry ayb nyb yload",
        0.8: "sideaccel sideacc latac laccel aycg nycg gloadside sideload sidegload",
        0.5: "lateral",
        0.3: "gy",
    },
    "delta_a": {
        0.95: "aileron ailerons deltaaileron querruder ail deltaail dail daileron ailn",
        0.9: "deltaa da delail ailrn dela aileronangle aileronpos ailpos",
        0.5: "xi",
    },
    "delta_r": {
        0.95: "rudder deltarudder seitenruder rud deltarud drud drudder rudr",
        0.9: "deltar dr delrud ruddr rudd delr rudderpos rudpos gouvernededirection",
        0.5: "zeta",
    },
    "phi": {
        0.97: "bankangle rollangle rollwinkel haengewinkel hangewinkel querneigung",
        0.9: "phi bank rollattitude eulerphi eulerroll rollatt angleofbank aob rollang phib",
        0.82: "roll roulis gite",
    },
    "theta": {
        0.97: "pitchangle nickwinkel laengsneigung langsneigung",
        0.9: "theta the thet thetab pitchattitude eulertheta eulerpitch pitchatt pitchang",
        0.82: "pitch assiette tht",
    },
    "psi": {
        0.95: "headingangle yawangle steuerkurs gierwinkel trueheading headingtrue hdgtrue truehdg",
        0.88: "psi heading hdg eulerpsi euleryaw thdg yawang hding hdingtrue hdgt",
        0.75: "yaw hdingmag magheading maghdg headingmag magneticheading mhdg hdgm psim",
        0.4: "azimuth cap kurs",
    },
    "V": {
        0.97: "trueairspeed airspeedtrue vtas vtrue wahrefluggeschwindigkeit",
        0.93: "tas ktas vktas tasms tasmps tasknots vt vtkt",
        0.82: "airspeed vtotal eigengeschwindigkeit vtot fluggeschwindigkeit vtr",
        0.72: "v vel velocity speed vinf vinfty vair",
        0.3: "ias kias vias cas kcas vcas vc eas keas veas indicatedairspeed calibratedairspeed "
        "equivalentairspeed vind airspeedindicated airspeedcalibrated groundspeed gs vgs "
        "speedground vg gndspd",
    },
    "h": {
        0.95: "altitude pressurealtitude pressalt presalt baroalt baroaltitude altitudepressure "
        "flughoehe druckhoehe hbaro hpres hpress palt altbaro pressalti altitudemsl mslaltitude "
        "altftmsl",
        0.88: "alt hoehe hohe hp altmsl mslalt altp altb altind altasl altitudeasl hsl height",
        0.72: "h fl flightlevel zp altgps gpsalt",
        0.3: "agl radalt radioaltitude radaralt hagl altitudeagl altagl radaltitude ralt",
    },
    "v": {
        0.93: "lateralvelocity latvelocity sidevelocity vlat lateralspeed bodyv vbody sidespeed",
        0.7: "vaero vb vy vyb",
        0.55: "v",
    },
    "Ay": {
        0.9: "ayinertial aykinematic aykin aygravity aywithgravity ayinclgravity accelyinertial "
        "inertialaccely ayground",
    },
    "q0": {0.9: "q0 qw quat0 quatw quaternion0 quaternionw qs"},
    "q1": {0.9: "q1 qx quat1 quatx quaternion1 quaternionx"},
    "q2": {0.9: "q2 qy quat2 quaty quaternion2 quaterniony"},
    "q3": {0.9: "q3 qz quat3 quatz quaternion3 quaternionz"},
    "t": {
        0.95: "time zeit temps tijd tiempo timestamp elapsedtime timeelapsed irigtime gpstime utc "
        "utctime timeutc timegps simtime testtime flighttime reltime missiontime timeofday "
        "realtime timesec timesecs times unixtime epoch datetime zeitstempel abstime recordtime",
        0.88: "t irig elapsed seconds sec secs tsec gmt timeirig timetag tow tout",
        0.6: "clock date ticks",
    },
}
SIDED = {
    "delta_a": "?ail ail? ?aileron aileron? ?ailpos ail?pos ailpos? da? dail? dela? deltaa?",
    "delta_r": "?rud rud? ?rudder rudder? dr? drud? delr?",
}
"""Names of one of two surfaces; ? is its side: DAR, LAILPOS, AILRH."""
SIDE_LETTERS = {"left": ("l", "lh", "lt"), "right": ("r", "rh", "rt")}
OF_ONE_SIDE = 0.88
IMPLIED = {
    "ktas": "kt", "vktas": "kt", "vtkt": "kt", "kcas": "kt", "kias": "kt", "keas": "kt",
    "tasknots": "kt", "tasms": "m/s", "tasmps": "m/s", "altftmsl": "ft",
    "latg": "g", "lateralg": "g", "fl": "FL", "flightlevel": "FL",
    "timesec": "s", "timesecs": "s", "tsec": "s", "seconds": "s", "sec": "s", "secs": "s",
}  # fmt: skip
"""The unit that a name implies."""
SIDES = {
    **dict.fromkeys(("left", "lh", "l", "port", "links", "lt", "lft"), "left"),
    **dict.fromkeys(("right", "rh", "r", "stbd", "starboard", "rechts", "rt", "rgt"), "right"),
}
"""For aircraft with two ailerons or rudders recorded separately."""


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


NEUTRAL = _words(
    "cg nb boom nose noseboom vane probe meas measured sensor sens ahrs ahr ins imu irs irig adc "
    "adiru dadc adiu fcc fcs fti ftiu corr corrected cal body b bdy axis pos posn "
    "position defl deflection surf surface sfc angle ang signal sig val value avg mean ek ekf tm "
    "pcm eng si euler att attitude nav state aero air data true is ist flight aircraft ac vehicle "
    "chan channel ch sys system rec msl asl baro act total tot fdm std nz"
)
"""Words for the place or method of measurement; the quantity stays the same."""
OF_KIND: dict[str, dict[str, float]] = {
    "rate": dict.fromkeys(("p", "r"), 0.985),
    "gyro": dict.fromkeys(("p", "r"), 0.985),
    "acc": dict.fromkeys(("Ny", "Ay"), 0.985),
    "accel": dict.fromkeys(("Ny", "Ay"), 0.985),
    "acceleration": dict.fromkeys(("Ny", "Ay"), 0.985),
    "load": {"Ny": 0.985},
    "factor": {"Ny": 0.985},
    "gps": {"V": 0.4, "h": 0.85, "psi": 0.6, "t": 0.985},
    "speed": {"V": 0.985},
    **{word: {"V": 0.3, "": 0.985} for word in ("indicated", "calibrated", "equivalent")},
    **{word: {"V": 0.3, "h": 0.3} for word in ("ground", "radio", "radar", "ktgs")},
    **{word: {"V": 0.3, "v": 0.0, "": 0.985} for word in ("local", "global", "ned", "earth")},
}
"""Words that fit some targets, with a factor on their certainty; "": all other targets."""
DERIVED = _words("derived differentiated computed calc calculated numerical")
"""Words for rates that were computed, not measured."""
UNCERTAIN = {
    **dict.fromkeys(DERIVED, 0.7),
    "raw": 0.93, "est": 0.9, "estimated": 0.9, "filt": 0.97, "filtered": 0.97, "model": 0.6,
    "sim": 0.8, "servo": 0.6, "actuator": 0.8, "mag": 0.9, "backup": 0.8, "sec": 0.9, "stby": 0.7,
    "upper": 0.8, "lower": 0.8, "inboard": 0.8, "outboard": 0.7, "a": 0.95, "f": 0.9, "m": 0.9,
}  # fmt: skip
OTHER = _words(
    "cmd command commanded commands cmds ref reference setpoint setpoints sp demand demanded dem "
    "desired des target tgt error err trim tab limit limits lim max min status valid validity flag "
    "flags stdev sigma var variance cov covariance bias offset temp temperature force pedal pedals "
    "stick wheel yoke column hinge moment torque pressure press static dynamic rpm counter count "
    "cnt frame id mode quality qual health norm normalized normalised current voltage volt volts "
    "dot ddot deviation dev autopilot ap selected sel bug input inputs pwm "
    "strain stress fuel oil engine eng1 eng2 n1 n2 wind gust turbulence latitude longitude lat "
    "lon north east down delay latency zone step delta dt size index idx number num sample samples "
    "rates gain coefficient coef derivative integral int soll "
    "vertical vert nick pitchrate q energy power density mach innov innovs innovation innovations "
    "variances residual residuals resid ratio ratios integ"
)
"""Words that change the quantity: a rudder command is not a rudder position."""
NORMAL_ACCELERATION = _words(
    "nz nzcg az azcg accz acclz accelz zacc zaccel accelerationz zacceleration accelerometerz "
    "normalacceleration normalaccel normalacc normacc normaccel nzaccel nznormalaccel "
    "nznormalacceleration normalloadfactor verticalacceleration vertaccel vertacc "
    "verticalloadfactor nznormal loadfactor gnormal gload gloadnorml"
)
MACH = _words("mach machnumber machno truemach machtrue machratio mn")
"""Not targets, but they show the units of other signals of their group."""
UNKNOWN, UNKNOWN_BESIDE_LETTER = 0.45, 0.3
"""Factors on the certainty for an unknown word, and for one next to a one-letter stem."""
PER_NUMBER = 0.93
NEUTRAL_FACTOR = 0.985


def _entries() -> Iterator[tuple[str, str, float]]:
    for key, graded in STEMS.items():
        for certainty, stems in graded.items():
            for stem in stems.split():
                yield stem, key, certainty
    for key, patterns in SIDED.items():
        for side, letters in SIDE_LETTERS.items():
            for stem in (p.replace("?", letter) for p in patterns.split() for letter in letters):
                if stem != "rudr":  # one rudder
                    yield stem, f"{key}_{side}", OF_ONE_SIDE


MEANINGS: dict[str, dict[str, float]] = {}
"""Spelling without gaps -> target -> certainty."""
for _stem, _key, _certainty in _entries():
    _of_stem = MEANINGS.setdefault(_stem, {})
    _of_stem[_key] = max(_certainty, _of_stem.get(_key, 0.0))
