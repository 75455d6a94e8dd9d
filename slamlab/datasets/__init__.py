"""Real logs and synthetic graphs: Killian Court, CARMEN files, Manhattan worlds."""

from slamlab.datasets.carmen import read_carmen
from slamlab.datasets.killian import Killian, killian
from slamlab.datasets.synthetic import ManhattanGraph, manhattan_graph

__all__ = [
    "Killian",
    "ManhattanGraph",
    "killian",
    "manhattan_graph",
    "read_carmen",
]
