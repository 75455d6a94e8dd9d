"""The stored runs over Victoria Park: one made again, and what the chapters say of them."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import victoria_park, victoria_park_runs

ROOT = Path(__file__).resolve().parents[1]
SPEC = importlib.util.spec_from_file_location("park", ROOT / "tools" / "victoria_park.py")
park = importlib.util.module_from_spec(SPEC)
sys.modules["park"] = park
SPEC.loader.exec_module(park)
RUNS = victoria_park_runs()


def test_a_stored_run_can_be_had_again():
    row = park.one("EKF-SLAM", 25, 0, victoria_park())
    for name, value in row.items():
        assert value == pytest.approx(RUNS["EKF-SLAM"][25][name][0], rel=0.02), name


def test_every_system_is_stored_and_no_other():
    assert set(RUNS) == set(park.SYSTEMS)
    for name, scales in RUNS.items():
        assert set(scales) == set(park.SCALES), name


def test_no_two_seeds_of_particles_are_alike_and_the_compressed_filter_is_the_filter():
    for name in ("FastSLAM 1.0", "FastSLAM 2.0"):
        for rows in RUNS[name].values():
            assert len(np.unique(rows["error"])) == len(rows["error"])
    for scale in park.SCALES:
        full, compressed = (RUNS[name][scale] for name in ("EKF-SLAM", "compressed EKF-SLAM"))
        np.testing.assert_allclose(compressed["error"], full["error"], rtol=1e-3)
