"""The compiled rays of a stereo rig meet the ground where the plain ones do, in chapter 15.

A picture of 5000 rays takes 2.3 ms and the plain code 61: 27 times, a second in 17 pictures. The
seconds saved: "Kernels and their plain twins" in book/performance_tables.md.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.sensors import StereoRig
from slamlab.sensors.stereo import march
from slamlab.worlds import Terrain

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")


@pytest.mark.parametrize("at", [[10.0, 10.0, 0.3], [1.0, 19.0, 2.0], [30.0, 5.0, 3.0]])
@pytest.mark.parametrize("reach", [20.0, 2.5])
def test_both_meet_the_ground_at_the_same_distance(at, reach):
    """In the middle, near an edge and beyond it; and with a reach that ends many rays."""
    terrain = Terrain.rough(np.random.default_rng(15))
    frame = np.array([terrain.grid.resolution, *terrain.grid.origin])
    origin = np.array([*at[:2], float(terrain.height(at[:2])) + 1.0])
    rays = StereoRig(2000)._rays(0.02, -0.01)
    assert TWINS["march.march"] is march.plain
    kernel = march(terrain.heights, frame, origin, rays, reach)
    plain = march.plain(terrain.heights, frame, origin, rays, reach)
    np.testing.assert_allclose(plain, kernel, atol=1e-9)
    assert np.isfinite(plain).sum() > 300
    assert np.isinf(plain).any() == (reach < 10)
