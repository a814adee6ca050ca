import os

# OpenBLAS in NumPy and SciPy reads it as they are imported. The matrices here are small, and idle threads spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
