"""In front of numba on PYTHONPATH this stands in for an environment without numba."""

raise ImportError("numba is left out, as PYTHONPATH=tests/without_numba asks")
