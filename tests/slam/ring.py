"""A corridor round a block and drives through it: for scan graphs, of one drive and of several."""

from functools import cache

import numpy as np

from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.simulation import drifted
from slamlab.worlds import WallWorld

LIDAR = Lidar(180, field_of_view=np.pi, max_range=8.0, sigma_range=0.01)
CORNERS = np.array([[1.2, 1.2], [12.8, 1.2], [12.8, 8.8], [1.2, 8.8]])


def box(left, bottom, right, top):
    return [[left, bottom], [right, bottom], [right, top], [left, top]]


@cache
def building(seed=5):
    """A corridor of 2 m round a block; where boxes stand along its walls, the seed says."""
    rng = np.random.default_rng(seed)
    boxes = []
    for low, high, y in ((0, 14, 0.0), (0, 14, 10.0), (2, 12, 2.0), (2, 12, 8.0)):
        for x in rng.uniform(low + 0.3, high - 0.9, 5):
            w, h = rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.5)
            down = y in (10.0, 2.0)
            boxes.append(box(x, y - h if down else y, x + w, y if down else y + h))
    return WallWorld.from_polygons(box(0, 0, 14, 10), box(2, 2, 12, 8), *boxes)


@cache
def drive(seed, first=0, sides=4, world=5, start=0.0, back=False, turn_bias=0.5, turn_noise=1.5):
    """A drive of some sides of the corridor, 0.3 m a step, with wheels that drift (degrees)."""
    at = [CORNERS[(first + (-k if back else k)) % 4] for k in range(sides + 1)]
    path = [at[0] + start * (at[1] - at[0])]
    for a, b in zip([path[0], *at[1:]], at[1:], strict=False):
        n = int(np.hypot(*(b - a)) / 0.3)
        path += [a + (b - a) * i / n for i in range(1, n + 1)]
    path = np.array(path)
    step = np.gradient(path, axis=0)
    truth = np.column_stack([path, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))])
    rng = np.random.default_rng(seed)
    n = len(truth)
    log = Log(
        np.arange(n) * 1.0, np.zeros((n, 3)), np.r_[0.0, np.ones(n - 1)], np.zeros((3, 3)),
        ranges=LIDAR.scan(building(world), truth, rng), scan=LIDAR, truth=truth,
    )  # fmt: skip
    return drifted(log, rng, turn_bias=np.deg2rad(turn_bias), turn_noise=np.deg2rad(turn_noise))
