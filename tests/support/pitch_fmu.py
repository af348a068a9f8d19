"""The pitch doublets of `own_pitch` as functional mock-up units, made with the C compiler."""

import shutil
import subprocess
import zipfile
from pathlib import Path

from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave, platform_tuple

COMPILER = shutil.which("cc")
MISSING = "" if COMPILER else "no C compiler (cc) to make an FMU with"
STIFFNESS, GAIN, COMMAND, ALPHA, Q, NZ, SURFACE, ALPHA_DEG, ACCELERATION = range(9)
CRASHES, HANGS, FAILS, ENDS, GROWS = -1.0, -2.0, -3.0, -4.0, -5.0
"""Values of the stiffness that break the model, from the first step on."""

MODEL = r"""
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef struct { double v[9]; } Pitch;
static int known;
static void start(Pitch *m) {
    if (!KEEPS || !known) { memset(m, 0, sizeof *m); m->v[3] = 0.05; }
    m->v[0] = 6.0; m->v[1] = 1.0;
    known = 1;
    printf("not for the terminal\n");
}
static Pitch *new(void) { Pitch *m = malloc(sizeof *m); known = 0; start(m); return m; }
static int get(Pitch *m, const unsigned *r, size_t n, double *out) {
    for (size_t k = 0; k < n; k++) {
        double nz = 1.0 + 20.0 * (m->v[3] - 0.05);
        out[k] = r[k] == 5 ? nz : r[k] == 6 ? m->v[6] - 0.02 : m->v[r[k]];
        if (r[k] == 7) out[k] = m->v[3] * 57.29577951308232;
        if (r[k] == 8) out[k] = nz * 9.80665;
    }
    return 0;
}
static int set(Pitch *m, const unsigned *r, size_t n, const double *in) {
    for (size_t k = 0; k < n; k++) m->v[r[k]] = in[k];
    return 0;
}
static int step(Pitch *m, double dt) {
    int broken = m->v[0] < 0.0 ? -m->v[0] : 0;
    if (broken == 1) abort();
    while (broken == 2) ;
    if (broken == 3) return 3;
    if (broken == 4) return 2;
    if (broken == 5) { while (malloc(1 << 20)) ; abort(); }
    for (int k = 0; k < (int)(dt / 0.01 + 0.5); k++) {
        m->v[6] += 0.2 * (m->v[1] * m->v[2] - m->v[6]);
        m->v[3] += 0.01 * (m->v[4] - 0.9 * (m->v[3] - 0.05));
        m->v[4] += 0.01 * (-m->v[0] * (m->v[3] - 0.05) - 1.2 * m->v[4] - 9.0 * m->v[6]);
    }
    return 0;
}
"""
CALLS = {
    2: r"""
typedef struct { void (*log)(void *, const char *, int, const char *, const char *, ...); } Calls;
static const Calls *calls;
void *fmi2Instantiate(const char *a, int b, const char *c, const char *d, const Calls *e,
                      int f, int g) { calls = e; return new(); }
int fmi2Reset(Pitch *m) { start(m); return 0; }
int fmi2GetReal(Pitch *m, const unsigned *r, size_t n, double *out) { return get(m, r, n, out); }
int fmi2SetReal(Pitch *m, const unsigned *r, size_t n, const double *in) {
    return set(m, r, n, in);
}
int fmi2DoStep(Pitch *m, double t, double dt, int whole) {
    int status = step(m, dt);
    if (status == 3) calls->log(0, "pitch", 3, "", "no %s", "solution");
    return status;
}
""",
    3: r"""
static void (*log_message)(void *, int, const char *, const char *);
void *fmi3InstantiateCoSimulation(const char *a, const char *b, const char *c, bool d, bool e,
                                  bool f, bool g, const unsigned *h, size_t i, void *j,
                                  void (*log)(void *, int, const char *, const char *),
                                  void *l) { log_message = log; return new(); }
int fmi3Reset(Pitch *m) { start(m); return 0; }
int fmi3GetFloat64(Pitch *m, const unsigned *r, size_t n, double *out, size_t o) {
    return get(m, r, n, out);
}
int fmi3SetFloat64(Pitch *m, const unsigned *r, size_t n, const double *in, size_t o) {
    return set(m, r, n, in);
}
int fmi3DoStep(Pitch *m, double t, double dt, bool whole, bool *event, bool *ends, bool *early,
               double *reached) {
    int status = step(m, dt);
    if (status == 3) log_message(0, 3, "", "no solution");
    *ends = status == 2;
    return status == 3 ? 3 : 0;
}
""",
}
UNUSED = {
    2: "EnterInitializationMode ExitInitializationMode SetupExperiment Terminate",
    3: "EnterInitializationMode ExitInitializationMode Terminate",
}
"""Calls that do nothing; all others that FMPy wants are errors."""
VARIABLES = (
    ("stiffness", STIFFNESS, "parameter", "fixed", "6.0", ""),
    ("control.gain", GAIN, "parameter", "tunable", "1.0", ""),
    ("command", COMMAND, "input", "continuous", "0.0", "rad"),
    ("alpha", ALPHA, "output", "continuous", "", "rad"),
    ("q", Q, "output", "continuous", "", "rad/s"),
    ("Nz", NZ, "output", "continuous", "", "g"),
    ("surface", SURFACE, "output", "continuous", "", "rad"),
    ("alpha_deg", ALPHA_DEG, "output", "continuous", "", "deg"),
    ("az", ACCELERATION, "output", "continuous", "", "model units"),
)


def make_fmu(path: Path, version: int = 2, *, keeps: bool = False) -> Path:
    """Compile the model.   keeps: its reset keeps the state, which is a fault."""
    slave = FMU3Slave if version == 3 else FMU2Slave
    code = MODEL + CALLS[version]
    names = [name for name in dir(slave) if name.startswith(f"fmi{version}")]
    for name in names:
        if f"{name}(" not in code:
            status = 0 if name[4:] in UNUSED[version].split() else 3
            code += f"int {name}(void) {{ return {status}; }}\n"
    folder = path.with_suffix(".made")
    binaries = f"binaries/{platform_tuple if version == 3 else 'linux64'}"
    (folder / binaries).mkdir(parents=True)
    (folder / "resources").mkdir()
    source, library = folder / "pitch.c", folder / binaries / "pitch.so"
    source.write_text(code)
    options = ["-O1", "-shared", "-fPIC", "-ffp-contract=off", f"-DKEEPS={int(keeps)}"]
    subprocess.run([str(COMPILER), *options, str(source), "-o", str(library)], check=True)
    (folder / "modelDescription.xml").write_text(_description(version))
    with zipfile.ZipFile(path, "w") as archive:
        for file in folder.rglob("*"):
            archive.write(file, file.relative_to(folder))
    shutil.rmtree(folder)
    return path


def _description(version: int) -> str:
    """The description of the model, with a unit that only its definition explains."""
    rows = []
    for name, number, causality, variability, start, unit in VARIABLES:
        about = f'name="{name}" valueReference="{number}" causality="{causality}"'
        about += f' variability="{variability}" description="{name} of the pitch model"'
        value = (f' start="{start}"' if start else "") + (f' unit="{unit}"' if unit else "")
        if version == 3:
            rows.append(f"<Float64 {about}{value}/>")
        else:
            rows.append(f"<ScalarVariable {about}><Real{value}/></ScalarVariable>")
    token = "instantiationToken" if version == 3 else "guid"
    outputs = [k + 1 for k, row in enumerate(VARIABLES) if row[2] == "output"]
    unknowns = "".join(f'<Output valueReference="{VARIABLES[k - 1][1]}"/>' for k in outputs)
    if version == 2:
        unknowns = "".join(f'<Unknown index="{k}"/>' for k in outputs)
        unknowns = f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
    return (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="{version}.0" modelName="pitch" '
        f'{token}="x"><CoSimulation modelIdentifier="pitch"/><UnitDefinitions>'
        '<Unit name="rad"><BaseUnit rad="1"/></Unit>'
        '<Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit><Unit name="g"/><Unit name="deg"/>'
        '<Unit name="model units"><BaseUnit m="1" s="-2" factor="1"/></Unit></UnitDefinitions>'
        f"<ModelVariables>{''.join(rows)}</ModelVariables>"
        f"<ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>"
    )
