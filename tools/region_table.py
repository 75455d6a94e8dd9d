"""Time a step of the compressed EKF against the radius of its region: chapter 16's stored table.

python tools/region_table.py      (some minutes; processor time, so other programs hardly count)
"""

from functools import partial
from time import thread_time

import numpy as np

from slamlab.evaluation import run
from slamlab.robots import Unicycle
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import CompressedEKFSlam, EKFSlam

RADII = (24, 28, 32, 36, 40, 50, 60, 90)


class Clocked:
    """A system that adds up the time of its steps and remembers the longest (ms)."""

    measures = "landmarks"

    def __init__(self, system):
        self.system, self.spent = system, [0.0]

    pose = property(lambda self: self.system.pose)
    pose_cov = property(lambda self: self.system.pose_cov)

    def predict(self, u, dt, control_cov):
        """Pass it on."""
        begin = thread_time()
        self.system.predict(u, dt, control_cov)
        self.spent.append(1e3 * (thread_time() - begin))

    def update(self, z, ids=None):
        """Pass it on."""
        begin = thread_time()
        report = self.system.update(z, ids)
        self.spent[-1] += 1e3 * (thread_time() - begin)
        return report


def clocked(build, log, times=3):
    """Mean time of a step, and that of the slowest, each step at its fastest of three (ms).

    Any one step may be held up for 20 ms by the machine, most often in the first flight.
    """
    spent = np.array([run(Clocked(build()), log).system.spent for _ in range(times)])
    return spent.mean(), spent.min(0).max()


def main():
    print("landmarks |  full EKF |", "".join(f"   R = {radius:2d} m" for radius in RADII))
    for side in (140.0, 240.0, 320.0):
        log = field_flights(1, np.random.default_rng(1), side=side).single(0)
        arguments = (Unicycle(), FIELD_SENSOR, log.truth[0])
        cells = [clocked(partial(EKFSlam, *arguments), log)]
        for radius in RADII:
            region = {"radius": radius, "reach": FIELD_SENSOR.max_range}
            cells.append(clocked(partial(CompressedEKFSlam, *arguments, **region), log))
        for name, row in zip(("mean", "slowest"), zip(*cells, strict=True), strict=True):
            print(f"{len(log.landmarks):5d} {name:8s}", *(f"{ms:9.2f}" for ms in row), flush=True)
        print("      speed-up", *(f"{cells[0][0] / mean:9.2f}" for mean, _ in cells))


if __name__ == "__main__":
    main()
