"""Robot calibration from scans of a three-faced jig: corners, five-parameter kinematics, what can be known."""

import os

# Before numpy loads: the matrices here are small, and BLAS threads that wait for each other cost up to ten times what
# they save, more so beside worker processes. Whoever sets the variable, or loads numpy first, decides.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
