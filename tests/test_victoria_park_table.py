"""The stored runs over Victoria Park: what the chapters say of them."""

import numpy as np

from slamlab.datasets import victoria_park_runs
from tools.victoria_park import SCALES

RUNS = victoria_park_runs()


def test_no_two_seeds_of_particles_are_alike_and_the_compressed_filter_is_the_filter():
    for name in ("FastSLAM 1.0", "FastSLAM 2.0"):
        for rows in RUNS[name].values():
            numbers = np.column_stack(list(rows.values()))  # one of three digits may agree
            assert len(np.unique(numbers, axis=0)) == len(rows["error"])
    for scale in SCALES:
        full, compressed = (RUNS[name][scale] for name in ("EKF-SLAM", "compressed EKF-SLAM"))
        np.testing.assert_allclose(compressed["error"], full["error"], rtol=1e-3)
