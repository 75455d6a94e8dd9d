"""Real logs and synthetic graphs: Killian Court, CARMEN files, Manhattan worlds."""

from slamlab.datasets.carmen import read_carmen
from slamlab.datasets.killian import Killian, killian
from slamlab.datasets.relations import Relations, read_relations
from slamlab.datasets.rosbag import read_rosbag
from slamlab.datasets.simulator_log import read_simulator
from slamlab.datasets.synthetic import ManhattanGraph, manhattan_graph, town_with_false_closures
from slamlab.datasets.trials import stored_runs
from slamlab.datasets.tum import read_tum, write_tum
from slamlab.datasets.victoria_park import (
    read_landmark_log,
    victoria_park,
    victoria_park_runs,
)

__all__ = [
    "Killian",
    "ManhattanGraph",
    "Relations",
    "killian",
    "manhattan_graph",
    "read_carmen",
    "read_landmark_log",
    "read_relations",
    "read_rosbag",
    "read_simulator",
    "read_tum",
    "stored_runs",
    "town_with_false_closures",
    "victoria_park",
    "victoria_park_runs",
    "write_tum",
]
