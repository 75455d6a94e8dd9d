"""Real logs and synthetic graphs: Killian Court, CARMEN files, Manhattan worlds."""

from slamlab.datasets.carmen import read_carmen
from slamlab.datasets.killian import killian
from slamlab.datasets.simulator_log import read_simulator
from slamlab.datasets.synthetic import manhattan_graph, town_with_false_closures
from slamlab.datasets.trials import stored_runs
from slamlab.datasets.victoria_park import victoria_park, victoria_park_runs

__all__ = [
    "killian",
    "manhattan_graph",
    "read_carmen",
    "read_simulator",
    "stored_runs",
    "town_with_false_closures",
    "victoria_park",
    "victoria_park_runs",
]
