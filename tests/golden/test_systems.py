"""A rewrite moves no result: every system on one log of its chapter, against stored numbers."""

import json

import numpy as np
import pytest

from tests.golden import runs
from tests.golden.runs import GOLDEN, STORED

SYSTEMS = json.loads(STORED.read_text())


def off(found, stored):
    """Largest difference, relative to the largest number."""
    found, stored = np.asarray(found, float), np.asarray(stored, float)
    assert found.shape == stored.shape
    return np.abs(found - stored).max(initial=0.0) / max(1.0, np.abs(stored).max(initial=0.0))


@pytest.mark.parametrize("name", GOLDEN)
def test_a_system_ends_where_it_ended(name):
    make, tolerance = GOLDEN[name]
    found = {key: off(value, SYSTEMS[name][key]) for key, value in make().items()}
    assert set(found) == set(SYSTEMS[name])
    assert max(found.values()) <= tolerance, found


def test_a_number_that_moves_is_seen():
    poses = np.array(SYSTEMS["EKF-SLAM"]["poses"])
    assert off(poses * (1 + 1e-12), poses) < 1e-9
    assert off(poses + 1e-8, poses) > 1e-9


def test_every_stored_system_runs():
    assert set(SYSTEMS) == set(GOLDEN)


def test_a_new_system_is_stored_and_the_numbers_of_the_others_stay(tmp_path, monkeypatch):
    file = tmp_path / "systems.json"
    file.write_bytes(STORED.read_bytes())
    monkeypatch.setattr(runs, "STORED", file)
    runs.write()
    assert file.read_bytes() == STORED.read_bytes()
    made = {"poses": [[1.0, 2.0, 3.0 + 1e-14]]}
    monkeypatch.setattr(runs, "GOLDEN", {"new": (lambda: made, 0), **GOLDEN})
    monkeypatch.setitem(runs.GOLDEN, "walls", (lambda: made, 0))
    runs.write()
    assert json.loads(file.read_text()) == SYSTEMS | {"new": {"poses": [[1.0, 2.0, 3.0]]}}
    runs.write(["walls"])
    assert json.loads(file.read_text())["walls"] == {"poses": [[1.0, 2.0, 3.0]]}
