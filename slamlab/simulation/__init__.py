"""A robot in a world, driven by a pilot who knows what the robot believes: out comes a log."""

from slamlab.simulation.drift import drifted
from slamlab.simulation.flights import FIELD_SENSOR, field_flights
from slamlab.simulation.ground import ground_laps
from slamlab.simulation.landmarks import (
    ORCHARD_SENSOR,
    ROOM_SENSOR,
    landmark_drives,
    orchard_loop,
    room_drives,
)
from slamlab.simulation.record import PerfectEstimator, record
from slamlab.simulation.rings import ring_laps

__all__ = [
    "FIELD_SENSOR",
    "ORCHARD_SENSOR",
    "ROOM_SENSOR",
    "PerfectEstimator",
    "drifted",
    "field_flights",
    "ground_laps",
    "landmark_drives",
    "orchard_loop",
    "record",
    "ring_laps",
    "room_drives",
]
