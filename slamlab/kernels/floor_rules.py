"""What the compiled and the plain map of the floor agree on: states of cells, and limits.

Apart from the loops, so that who only reads them need not load numba.
"""

import numpy as np

__all__ = [
    "FREE",
    "MOST_PASSES",
    "OCCUPIED",
    "THROUGH",
    "UNKNOWN",
    "WALL_STEP",
    "WIDEST_WEDGE",
]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
# Between beams that are farther apart than this (rad) nothing is known.
WIDEST_WEDGE = np.deg2rad(12.5)
# End points of neighbouring beams nearer than this many cells belong to one wall.
WALL_STEP = 3.0
# So many scans must see through an occupied cell, by so many cells, to free it again.
MOST_PASSES, THROUGH = 3, 1.5
