"""The application around the numerics: command line, files, figures."""

import os

# Training multiplies many small matrices. The threads of BLAS only wait for each other there: with
# them a forecast of peaks takes ten times the processor time. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
