"""Exercises, chapter 06: beams through cells and against walls, the fan of a lidar, a whole drive.

P5, chapters 3.2.2 (`Scan`) and 3.2.4 (`distancetodots`), repaired; points keep their place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints, Mask
from slamlab.geometry import compose

__all__ = [
    "check_beam_angles",
    "check_first_hit",
    "check_nearest_wall",
    "check_record",
    "check_scan_to_points",
]


# %% [markdown] tags=["chapter"]
# # Exercises 06: lidar simulation
#
# Five exercises that turn a drawn house into what a robot sees: a beam that meets glass, the beams
# of a robot that turns while it scans, a lidar that is not at the robot's centre, a beam with two
# bugs, and a whole drive past a glass door with its map. The chapter is [Lidar
# simulation](../06_lidar_simulation.ipynb). Replace each `...` and run the check below it as often
# as you like; then draw what you built beside what is expected.

# %% [markdown] tags=["solution"]
# # Solutions 06: lidar simulation
#
# The exercises are in [Exercises 06](../exercises/06_lidar_simulation.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np

# %% [markdown] tags=["statement"]
# ## Exercise 1: a beam that meets glass
#
# A robot that drove without fault for a week is sent to a new office and drives against its glass
# door. A pane sends light back only if a beam meets it nearly squarely; at a slant the light goes
# through, or away. Exercise 5 will draw the map that this makes; here is its beam.
#
# So the picture has three kinds of cells: 0 is free, 1 a wall, 2 glass. Follow the beam from grid
# line to grid line, as the lesson does. A wall always ends it. Glass ends it on two conditions:
# the beam comes from a cell that is *not* glass, and the angle between the beam and the
# perpendicular of the grid line that it crosses there is less than 30°. Else the beam goes on, as
# if the cell were free.
#
# Everything is in cells: the cell in row r and column c is the square from (c, r) to (c + 1, r +
# 1).


# %% tags=["exercise"]
def first_hit(cells: Ints, x: float, y: float, angle: float) -> float:
    """Range of one beam.

    Parameters
    ----------
    cells : ndarray of int, shape (rows, columns)
        0 free, 1 wall, 2 glass; row 0 at the bottom.
    x, y : float
        Where the beam starts, inside the grid (cells).
    angle : float
        Direction (rad), counterclockwise from the x axis.

    Returns
    -------
    float
        Distance (cells) to the border of the cell that ends the beam: 0 if the start
        is inside a wall, inf if the beam leaves the grid. Not tried: a start inside
        glass, a beam at exactly 30 degrees or exactly through a corner.
    """
    dx, dy = float(np.cos(angle)), float(np.sin(angle))
    column, row, t = int(x), int(y), 0.0
    rows, columns = cells.shape
    before, cosine = 0, 0.0
    while 0 <= row < rows and 0 <= column < columns:
        here = cells[row, column]
        if here == 1 or (here == 2 and before == 0 and cosine > np.cos(np.pi / 6)):
            return t
        before = here
        t_x = (column + (dx > 0) - x) / dx if dx else np.inf
        t_y = (row + (dy > 0) - y) / dy if dy else np.inf
        t = min(t_x, t_y)
        if t_x <= t_y:
            column, cosine = column + (1 if dx > 0 else -1), abs(dx)
        else:
            row, cosine = row + (1 if dy > 0 else -1), abs(dy)
    return np.inf


# %% active="ipynb" tags=["try"]
# first_hit(np.array([[0, 0, 2, 1]]), 0.5, 0.5, 0.0)

# %% [markdown] tags=["hint"]
# Begin with the lesson's walk, and forget the glass. Then ask: what does the walk know, at the
# moment when it steps into a cell, that tells how squarely the beam meets it?

# %% [markdown] tags=["hint"]
# A beam that steps across a *vertical* grid line meets it squarely if it runs along x. The cosine
# of the angle from the perpendicular is then `abs(dx)`; across a horizontal line it is `abs(dy)`.

# %% [markdown] tags=["hint"]
# Keep two things from one cell to the next: what the cell before was, and the cosine with which
# its border was crossed.

# %% tags=["cases"]
_CELLS = np.zeros((6, 9), dtype=int)


_CELLS[[1, 4, 5, 3], [7, 2, 0, 8]] = 1


_DIAGONAL = np.eye(9, dtype=int)[::-1]


# A pane of glass along column 5, two cells thick in rows 3 and 4, and a wall behind it.
_PANE = np.zeros((6, 9), dtype=int)


_PANE[:, 5], _PANE[3:5, 6], _PANE[:, 8] = 2, 2, 1


# A pane that runs up along column 3, and another across row 10.
_TWO_PANES = np.zeros((12, 8), dtype=int)


_TWO_PANES[:, 3] = _TWO_PANES[10] = 2


# A pane along column 2 with a wall directly behind it.
_BACKED = np.zeros((6, 6), dtype=int)


_BACKED[:, 2], _BACKED[:, 3] = 2, 1


def _beam(rng: np.random.Generator) -> Any:
    rows, columns = rng.integers(2, 9, 2)
    x, y = np.round(rng.uniform(0.05, [columns - 0.05, rows - 0.05]), 2) + 0.004
    cells = rng.choice([0, 1, 2], (rows, columns), p=[0.7, 0.15, 0.15])
    cells[int(y), int(x)] = 0
    return cells, x, y, np.round(rng.uniform(-np.pi, np.pi), 3)


def _away(rng: np.random.Generator) -> Any:
    """Draw a beam that leaves a grid with walls on the two edges behind it."""
    cells = np.zeros((5, 6), dtype=int)
    cells[-1, :] = cells[:, -1] = 1
    return cells, 2.4, 1.7, np.round(rng.uniform(np.pi, 1.5 * np.pi), 3)


def _along(axis: float) -> Any:
    return lambda rng: (rng.random((7, 5)) < 0.15, 2.3, 3.6, axis)


def _cells_drawn(ax: Any, cells: Any, resolution: float = 1.0) -> None:
    """Draw walls dark and glass light, as a picture of this resolution."""
    from slamlab import plots

    rows, columns = cells.shape
    plots.occupancy(
        ax, np.array([0.0, 0.5, 0.2])[cells], [0, columns * resolution, 0, rows * resolution]
    )


def _beams_drawn(ax: Any, start: Array, ends: Array, colour: str = "") -> None:
    """Draw beams (n,) from a place to their ends as thin lines; NaN is left out."""
    from slamlab import plots

    lines = np.full((len(ends), 3, 2), np.nan)
    lines[:, 0], lines[:, 1] = start, ends
    style = {"color": colour, "alpha": 0.8} if colour else {"color": plots.COLOURS["lidar"]}
    ax.plot(*lines.reshape(-1, 2).T, **({"lw": 0.5, "alpha": 0.35} | style))


def _first_hit_drawn(ax: Any, function: Any) -> None:
    """Draw 180 beams in an office with three panes of glass (light grey)."""
    from slamlab import plots

    cells = np.zeros((11, 15), dtype=int)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[4:6, 2] = 1
    cells[1:10, 9] = cells[8, 1:6] = cells[8, 10:14] = 2
    x, y = 8.0, 2.6
    _cells_drawn(ax, cells)
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False) + 0.01
    ranges = np.array([float(function(cells, x, y, float(angle))) for angle in angles])
    ends = np.column_stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)])
    ends[~np.isfinite(ranges)] = np.nan
    _beams_drawn(ax, np.array([x, y]), ends)
    plots.lidar_points(ax, ends, s=2.5)
    ax.plot(x, y, "o", color=plots.COLOURS["truth"])
    ax.set(xlabel="x (cells)", ylabel="y (cells)")


check_first_hit = Check(
    first_hit,
    "range",
    {
        "straight along a row": (_CELLS, 1.25, 1.5, 0.0),
        "straight up": _along(np.pi / 2),
        "straight back": _along(np.pi),
        "straight down": _along(-np.pi / 2),
        "a cell that is cut only near its corner": (_CELLS, 0.5, 0.5, np.arctan2(2.45, 7.6)),
        "between two cells that touch at a corner": (_DIAGONAL, 1.2, 1.3, np.arctan2(2.78, 2.7)),
        "a beam that leaves the grid": (_CELLS, 3.5, 2.5, -1.2),
        "walls on the far edges are behind this beam": _away,
        "a pane met squarely": (_PANE, 1.5, 2.4, 0.2),
        "a pane met from the right": (_PANE, 7.5, 1.4, np.pi - 0.2),
        "a pane met at 29.5 degrees": (_PANE, 1.5, 0.4, np.deg2rad(29.5)),
        "a pane met at 30.5 degrees lets the beam pass": (_PANE, 1.5, 0.4, np.deg2rad(30.5)),
        "through one pane at a slant, over free floor, squarely onto another": (
            _TWO_PANES,
            1.5,
            1.5,
            1.2,
        ),
        "a wall directly behind glass, at a slant": (_BACKED, 0.5, 0.5, np.deg2rad(40)),
        "glass behind glass: the beam is inside it already": (_PANE, 4.6, 1.2, 1.2),
        "a pane met from below": (_PANE.T.copy(), 2.4, 1.5, np.pi / 2 + 0.3),
        "a pane met from above": (_PANE.T.copy(), 1.4, 7.5, -np.pi / 2 + 0.3),
        "a start inside a wall": (_CELLS, 2.5, 4.5, 1.0),
        "a start in the first row and the last column": (_CELLS, 8.5, 0.5, 2.2),
        "any grid, any beam": _beam,
    },
    draws=30,
    picture=_first_hit_drawn,
)


# %% tags=["mistakes"]
def _to_the_centre(occupied: Ints, x: float, y: float, angle: float) -> float:
    t = first_hit(occupied, x, y, angle)
    if np.isinf(t):
        return t
    column, row = x + (t + 1e-9) * np.cos(angle), y + (t + 1e-9) * np.sin(angle)
    return float(np.hypot(np.floor(column) + 0.5 - x, np.floor(row) + 0.5 - y))


def _fenced(occupied: Ints, x: float, y: float, angle: float) -> float:
    return first_hit(np.pad(occupied, 1, constant_values=1), x + 1, y + 1, angle)


check_first_hit.mistakes = {
    "rows and columns are exchanged: the row comes first, cells[row, column]": (
        "cells[row, column] => cells[column, row]"
    ),
    "a negative index counts from the other end: a beam that leaves the grid met nothing": (
        "while 0 <= row < rows and 0 <= column < columns => while row < rows and column < columns"
    ),
    "this is the distance to the cell's centre: the beam ends at its border": _to_the_centre,
    "a beam that leaves the grid met nothing: expected inf, not the way to the edge": _fenced,
    "row 0 is at the bottom: the picture was turned over": (
        lambda o, x, y, a: first_hit(o[::-1], x, y, a)
    ),
    "rows and columns are exchanged: cells[row, column], row from y": (
        lambda o, x, y, a: first_hit(o.T, x, y, a)
    ),
    "the angle is in radians": lambda o, x, y, a: first_hit(o, x, y, np.deg2rad(a)),
    "this is the way along x: the range runs along the beam": (
        lambda o, x, y, a: first_hit(o, x, y, a) * abs(np.cos(a))
    ),
    "the start was rounded: its cell is the whole part of x and y": (
        "int(x), int(y) => round(x), round(y)"
    ),
    "the beam began in the middle of its cell": (
        lambda o, x, y, a: first_hit(o, int(x) + 0.5, int(y) + 0.5, a)
    ),
    "the angle grows counterclockwise: y upwards": lambda o, x, y, a: first_hit(o, x, y, -a),
    "the cell of the start was not looked at": ("if here == 1 or => if (t and here == 1) or"),
    "glass was taken for a wall: at a slant the beam goes through": (
        " and before == 0 and cosine > np.cos(np.pi / 6) => "
    ),
    "glass was taken for free floor: a beam that meets it squarely comes back": (
        " or (here == 2 and before == 0 and cosine > np.cos(np.pi / 6)) => "
    ),
    "glass ended the beam at a slant, and let it pass squarely": (
        "cosine > np.cos(np.pi / 6) => cosine < np.cos(np.pi / 6)"
    ),
    "the 30 degrees count from the perpendicular of the grid line, not from the line": (
        "cosine > np.cos(np.pi / 6) => cosine > np.cos(np.pi / 3)"
    ),
    "the beam was in the glass already: only what comes from outside is sent back": (
        " and before == 0 => "
    ),
    "a wall behind glass was passed through: only glass asks where the beam comes from": (
        "here == 1 or (here == 2 and before == 0 and cosine > np.cos(np.pi / 6))"
        " => before != 2 and (here == 1 or (here == 2 and cosine > np.cos(np.pi / 6)))"
    ),
    "a beam that has left the glass meets the next pane from outside again": (
        "before = here => before = 2 if before == 2 else here"
    ),
    "the limit is 30 degrees from the perpendicular, here it is another angle": (
        "np.cos(np.pi / 6) => np.cos(np.deg2rad(31))"
    ),
    "this is the larger of `abs(dx)` and `abs(dy)`: the line that was crossed says which counts": (
        "else -1), abs(dx) => else -1), max(abs(dx), abs(dy))",
        "else -1), abs(dy) => else -1), max(abs(dx), abs(dy))",
    ),
    "this is always `abs(dx)`: across a horizontal line `abs(dy)` counts": (
        "else -1), abs(dy) => else -1), abs(dx)"
    ),
    "which line was crossed? Across a vertical one `abs(dx)` counts, across a horizontal one "
    "`abs(dy)`": (
        "else -1), abs(dx) => else -1), abs(dy)",
        "row, cosine = row + (1 if dy > 0 else"
        " -1), abs(dy) => row, cosine = row + (1 if dy > 0 else -1), abs(dx)",
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: a beam that meets glass
#
# The beam enters each cell at a distance t that the last step has found, so when a cell turns out
# to end it the answer is at hand. And the step knows more: which of the two lines was crossed, and
# with it the angle. Computing `t_x` and `t_y` anew from the start, instead of adding up, keeps
# rounding from piling up.

# %% [markdown] tags=["solution"]
# How much of a pane does a lidar miss? It stands about a metre before a long pane (cells of 10 cm)
# and sends a beam every degree ahead, from -80° to 80°; about three metres behind the pane is a
# wall:

# %% active="ipynb" tags=["solution"]
# office = np.zeros((500, 60), dtype=int)
# office[:, 20], office[:, 50] = 2, 1
# beams = np.deg2rad(np.arange(-80, 81))
# ranges = np.array([first_hit(office, 10.5, 250.5, beam) for beam in beams])
# on_glass = np.isclose(ranges * np.cos(beams), 9.5)
# on_wall = np.isclose(ranges * np.cos(beams), 39.5)
# print(f"{on_glass.sum()} of {len(beams)} beams end on the pane, "
#       f"{on_wall.sum()} on the wall behind it")

# %% [markdown] tags=["solution"]
# So the same pane is a wall in the middle of the scan and free floor at its sides. What a map
# makes of it on a drive, exercise 5 draws. An answer that takes glass for
# a wall:

# %% active="ipynb" tags=["solution"]
# def all_solid(cells, x, y, angle):
#     return first_hit(np.minimum(cells, 1), x, y, angle)
#
# check_first_hit(all_solid)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the beams of a robot that turns
#
# A vacuum robot spins on the spot in a square room, and its scan is no square: the walls are
# crooked, and there is a corner too many. Its lidar sends the beams one after another, while its
# mirror turns counterclockwise on the robot, evenly, once round in each revolution. In that time
# the robot turns as well, evenly, by `turned`. Only the first beam leaves with the heading that
# the scan is stored with.
#
# Lay out the beams as they really left, for any lidar. *720 beams, 360°* says one maker, *181
# beams, 180°* another: in one of them neighbouring beams are half a degree apart, in the other a
# whole degree. And a lidar with a smaller field sends only while its mirror is turned to that
# field.


# %% tags=["exercise"]
def beam_angles(n_beams: int, field_of_view: float, turned: float) -> Array:
    """Lay out the beams of a lidar on a robot that turns.

    Parameters
    ----------
    n_beams : int
        At least one.
    field_of_view : float
        Opening angle (rad), at most 2 pi.
    turned : float
        Angle (rad), counterclockwise, by which the robot turns in one revolution of
        the mirror; 0 if it stands.

    Returns
    -------
    ndarray, shape (n_beams,)
        Directions (rad), counterclockwise from the heading at which the first beam
        leaves. On a robot that stands, a full circle begins straight ahead; a smaller
        field is centred on straight ahead, from the right edge to the left, with a
        beam on both edges, and a single beam points straight ahead. Angles are
        compared up to a full turn.
    """
    if field_of_view >= 2 * np.pi:
        beams = 2 * np.pi * np.arange(n_beams) / n_beams
    elif n_beams == 1:
        beams = np.zeros(1)
    else:
        beams = np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)
    return beams + turned * (beams - beams[0]) / (2 * np.pi)


# %% active="ipynb" tags=["try"]
# beam_angles(4, 2 * np.pi, 0.2)

# %% [markdown] tags=["hint"]
# First a robot that stands. How many gaps are there between n beams on a full circle, and how many
# on a part of it?

# %% [markdown] tags=["hint"]
# Now it turns. What share of a revolution has the mirror made between the first beam and beam i?
# On the full circle, and on a half circle?

# %% [markdown] tags=["hint"]
# The mirror's angle since the first beam says how much of the revolution has passed. How far has
# the robot turned in that time, and what does that do to the direction of the beam?


# %% tags=["cases"]
def _up_to_turns(function: Function, n_beams: int, field_of_view: float, turned: float) -> Any:
    """Let every turn of 2 pi pass; the half turn is +pi."""
    came = function(n_beams, field_of_view, turned)
    angles = np.mod(np.asarray(came, dtype=float) + np.pi, 2 * np.pi) - np.pi
    return np.where(angles < -np.pi + 1e-9, np.pi, angles)


def _turning_drawn(ax: Any, function: Any) -> None:
    """Draw two rooms, scanned all round and over 240°, by a robot that turns 40° a revolution."""
    from slamlab import plots
    from slamlab.worlds import WallWorld

    square = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], float)
    off = []
    for corner, n, view in ((0.0, 90, 2 * np.pi), (5.0, 41, 4 * np.pi / 3)):
        world = WallWorld.from_polygons(square + [corner, 0])
        start, heading, turned = np.array([corner + 1.7, 1.8]), 1.2, np.deg2rad(40)
        ranges = world.cast(start, heading + beam_angles(n, view, turned))
        angles = heading + np.asarray(function(n, view, turned), float)[:n]
        ends = start + ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        off.append(np.abs(np.abs(ends - [corner + 2, 2]).max(axis=1) - 2).max())
        plots.walls(ax, world.segments)
        _beams_drawn(ax, start, ends)
        plots.lidar_points(ax, ends, s=2.5)
        ax.plot(*start, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)
    ax.set(xlim=(0.2, 9.0), ylim=(-0.5, 4.3))
    ax.set_title(f"farthest off its wall: {max(off):.2f} m", loc="left")


check_beam_angles = Check(
    beam_angles,
    "angles",
    {
        "a full circle begins ahead and has no beam twice": (8, 2 * np.pi, 0.0),
        "500 beams do not fall onto one ray": (500, 2 * np.pi, 0.0),
        "a single beam points ahead": (1, 1.0, 0.0),
        "a single beam of a full circle": (1, 2 * np.pi, 0.0),
        "two beams on the edges": (2, 2.0, 0.0),
        "nearly a full circle has both edges": (5, 6.0, 0.0),
        "even more nearly a full circle": (7, 6.2, 0.0),
        "any number shares the circle evenly": lambda rng: (rng.integers(2, 40), 2 * np.pi, 0.0),
        "a part of the circle": lambda rng: (
            rng.integers(2, 40),
            np.round(rng.uniform(0.1, 6), 2),
            0.0,
        ),
        "a full circle on a robot that turns left": (8, 2 * np.pi, 0.3),
        "a full circle on a robot that turns right": (9, 2 * np.pi, -0.5),
        "half a circle on a robot that turns": (7, np.pi, 0.4),
        "a single beam leaves before the robot has turned": (1, 2.0, 0.6),
        "any lidar on any robot": lambda rng: (
            rng.integers(2, 40),
            rng.choice([2 * np.pi, np.round(rng.uniform(0.1, 6), 2)]),
            np.round(rng.uniform(-0.9, 0.9), 2),
        ),
    },
    use=_up_to_turns,
    picture=_turning_drawn,
)


# %% tags=["mistakes"]
def _from_ahead(n: int, view: float, turned: float) -> Array:
    return beam_angles(n, view, turned) + (0.0 if view >= 2 * np.pi or n == 1 else view / 2)


def _whole_degrees(n: int, view: float, turned: float) -> Array:
    full = view >= 2 * np.pi
    step = np.deg2rad(360 // n) * (1 + turned / (2 * np.pi))
    return step * np.arange(n) if full else beam_angles(n, view, turned)


def _whole_turn(n: int, view: float, turned: float) -> Array:
    share = np.arange(n) / n if view >= 2 * np.pi else np.linspace(0, 1, n)
    return beam_angles(n, view, 0.0) + turned * share


check_beam_angles.mistakes = {
    "in a full circle the first and the last beam must not have the same direction": (
        "field_of_view >= 2 * np.pi => False"
    ),
    "these turn clockwise: angles grow counterclockwise": (lambda n, v, w: -beam_angles(n, v, w)),
    "these are degrees: expected radians": lambda n, v, w: np.rad2deg(beam_angles(n, v, w)),
    "a part of the circle has a beam on both of its edges": (
        "np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)"
        " => -field_of_view / 2 + field_of_view * np.arange(n_beams) / n_beams"
    ),
    "a part of the circle lies symmetrically around straight ahead": _from_ahead,
    "whole degrees, as P5 has it: 360 // n leaves a gap or puts all beams on one ray": (
        _whole_degrees
    ),
    "a single beam points straight ahead, not along the edge": "n_beams == 1 => False",
    "a full circle begins straight ahead, not behind": (
        "2 * np.pi * np.arange(n_beams) / n_beams"
        " => 2 * np.pi * np.arange(n_beams) / n_beams - np.pi"
    ),
    "the fan is twice as wide as the field of view": (
        "-field_of_view / 2, field_of_view / 2, => -field_of_view, field_of_view,"
    ),
    "the robot turns while the beams leave: `turned` is missing": (
        " + turned * (beams - beams[0]) / (2 * np.pi) => "
    ),
    "the robot's turn adds to the mirror's: here it was taken off": (
        "beams + turned => beams - turned"
    ),
    "angles count from the heading of the first beam, not from that in the middle of the scan": (
        "(beams - beams[0]) => beams"
    ),
    "a smaller field takes only a part of the revolution, and the robot turns by that part": (
        _whole_turn
    ),
    "each beam leaves at its own time: not all are turned alike": (
        "turned * (beams - beams[0]) / (2 * np.pi) => turned"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the beams of a robot that turns
#
# On a circle there are as many gaps as beams; between two edges there is one less. The mirror's
# angle since the first beam is the clock: over 2 pi it is the share of the revolution, and the
# robot has turned by that share of `turned`. So a half circle is sent in half the time. The
# repair has a name, *deskewing*, and programs that drive with a lidar do it; the turn comes
# from the wheels or a gyroscope.

# %% [markdown] tags=["solution"]
# What does each mistake cost? A lidar of 181 beams, 180°, two metres from the wall ahead, then
# five; the ends are those between -60° and 60°. First the beams are placed as if there were as
# many gaps as beams, then the robot turns by 20° in a revolution and its program forgets that.

# %% active="ipynb" tags=["solution"]
# for wall in (2.0, 5.0):
#     for name, turned, placed in (
#         ("n gaps", 0.0, -np.pi / 2 + np.pi * np.arange(181) / 181),
#         ("turn forgotten", np.deg2rad(20), beam_angles(181, np.pi, 0.0)),
#     ):
#         sent = beam_angles(181, np.pi, turned)
#         ahead = np.abs(sent) < np.deg2rad(60)
#         ends = wall / np.cos(sent[ahead]) * np.cos(placed[ahead])
#         print(f"wall at {wall:.0f} m, {name}: drawn from {ends.min():.2f} m "
#               f"to {ends.max():.2f} m")

# %% [markdown] tags=["solution"]
# A degree shared among all gaps bends the wall a little, the robot's turn tilts and bends it much
# more. Both grow with the distance, and no range shows either. An answer that forgets the turn:

# %% active="ipynb" tags=["solution"]
# def as_if_it_stood(n_beams, field_of_view, turned):
#     return beam_angles(n_beams, field_of_view, 0.0)
#
# check_beam_angles(as_if_it_stood)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a lidar on the robot's nose
#
# In the lesson the lidar stood at the robot's centre. On a real robot it is mounted somewhere:
# ahead of the centre, to one side, often turned, because there was no other place for the cable.
# The pose that a filter estimates is that of the *robot*. Place the ends of a scan in the world.
#
# **Pencil first.** A robot scans all round, from 0.4 m ahead of its centre and 0.2 m to the right.
# It drives straight up to a wall, scans, turns round on the spot and scans again. Its program
# places both scans as if the lidar were at the centre, and the map has the wall twice. How far
# apart, and how far is each from the true one? The picture has this robot; there its lidar is
# turned by 0.1 rad as well.
#
# Each beam keeps its place in the list, with or without a return.


# %% tags=["exercise"]
def scan_to_points(pose: Array, mount: Array, ranges: Array, angles: Array) -> Array:
    """Where the beams of a scan ended.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x, y, heading of the robot in the world (m, m, rad).
    mount : ndarray, shape (3,)
        The lidar in the frame of the robot: how far ahead of its centre (m), how far
        to the left (m), and how far its straight ahead is turned from the nose (rad).
    ranges : ndarray, shape (n,)
        Distances (m); inf where a beam met nothing, NaN where its reading was lost.
    angles : ndarray, shape (n,)
        Directions of the beams from the lidar's own straight ahead (rad),
        counterclockwise.

    Returns
    -------
    ndarray, shape (n, 2)
        Points in the world (m); NaN where there is none.
    """
    kept = np.where(np.isfinite(ranges), ranges, np.nan)
    beams, c, s = pose[2] + mount[2] + angles, np.cos(pose[2]), np.sin(pose[2])
    x0 = pose[0] + c * mount[0] - s * mount[1]
    y0 = pose[1] + s * mount[0] + c * mount[1]
    return np.stack([x0 + kept * np.cos(beams), y0 + kept * np.sin(beams)], -1)


# %% active="ipynb" tags=["try"]
# pose, mount = np.array([1.0, 2.0, np.pi / 2]), np.array([0.3, 0.0, 0.0])
# scan_to_points(pose, mount, np.array([3.0, np.inf]), np.array([0.0, 1.0]))

# %% [markdown] tags=["hint"]
# Where in the world is the lidar, if the robot is turned by a right angle and the lidar sits 0.3 m
# ahead of its centre? Draw it.

# %% [markdown] tags=["hint"]
# The pose of the lidar in the world is the robot's pose composed with the mount: the mount's place
# is turned by the robot's heading and added, the two headings add.


# %% tags=["cases"]
@drawn
def _scan(rng: np.random.Generator, lost: bool) -> Any:
    n = int(rng.integers(1, 9)) + 2 * lost
    ranges = np.round(rng.uniform(0.2, 9, n), 2)
    if lost:
        ranges[rng.permutation(n)[:2]] = [np.nan, np.inf]
    mount = np.round(rng.uniform([-0.5, -0.5, -3], [0.5, 0.5, 3]), 2)
    return a_pose(rng), mount, ranges, np.sort(np.round(rng.uniform(-3, 3, n), 2))


_ROOM = [(0, 0), (6, 0), (6, 3), (4, 3), (4, 5), (0, 5)]


def _points_drawn(ax: Any, function: Any) -> None:
    """Draw the ends of two scans in a room of walls, before and after the robot turned round.

    The dot is the robot, the crosses are its lidar.
    """
    from slamlab import plots
    from slamlab.sensors import Lidar
    from slamlab.worlds import WallWorld

    world, lidar = WallWorld.from_polygons(_ROOM), Lidar(60, max_range=4.5)
    plots.walls(ax, world.segments)
    mount = np.array([0.4, -0.2, 0.1])
    for pose in np.array([[2.0, 3.4, np.pi / 2], [2.0, 3.4, -np.pi / 2]]):
        scan = lidar.scan(world, compose(pose, mount))
        points = function(pose, mount, scan, lidar.beam_angles)
        plots.lidar_points(ax, np.asarray(points, float), s=4)
        ax.plot(pose[0], pose[1], "o", color=plots.COLOURS["truth"])
        ax.plot(*compose(pose, mount)[:2], "x", color=plots.COLOURS["truth"], markersize=6)
    plots.floor(ax)
    ax.set(xlim=(-0.5, 6.5), ylim=(-0.5, 5.5))


check_scan_to_points = Check(
    scan_to_points,
    "points",
    {
        "a robot at the origin, the lidar at its centre": (
            [0, 0, 0],
            [0, 0, 0],
            [1.0, 2.0, 3.0],
            [-1.0, 0.0, 0.9],
        ),
        "a lidar ahead of the centre of a turned robot": (
            [1.0, 2.0, 1.2],
            [0.5, 0, 0],
            [1.0, 2.0, 3.0],
            [-1.0, 0.0, 0.9],
        ),
        "a lidar that is mounted askew": ([1.0, 2.0, 0.4], [0, 0, -1.3], [2.0, 1.0], [-1.0, 0.5]),
        "beams that all came back": _scan(lost=False),
        "lost readings and beams that met nothing keep their place": _scan(lost=True),
        "nothing came back at all": ([1.0, 2.0, 0.5], [0.1, 0, 0], [np.inf, np.nan], [0.0, 1.0]),
        "a scan without beams": ([1.0, 2.0, 0.5], [0.1, 0, 0], [], []),
    },
    picture=_points_drawn,
)

# %% tags=["mistakes"]
check_scan_to_points.mistakes = {
    "beams without a return were left out: each beam keeps its place, missing ones as NaN": (
        lambda p, m, r, a: scan_to_points(p, m, r[np.isfinite(r)], a[np.isfinite(r)])
    ),
    "the list moved up, as P5's does: a distance now belongs to its neighbour's beam": (
        lambda p, m, r, a: scan_to_points(p, m, r[np.isfinite(r)], a[: np.isfinite(r).sum()])
    ),
    "inf is no place: a beam that met nothing gives NaN": (
        "np.where(np.isfinite(ranges), ranges, np.nan) => ranges"
    ),
    "a missing return became a point on the robot: expected NaN": (
        "ranges, np.nan => ranges, 0.0"
    ),
    "the heading is missing in the beams: they turn with the robot": (
        "pose[2] + mount[2] + angles => mount[2] + angles"
    ),
    "the position is missing: these points are seen from the robot": (
        "pose[0] +  => ",
        "pose[1] +  => ",
    ),
    "the lidar sits at the centre here: its place on the robot is missing": (
        lambda p, m, *scan: scan_to_points(p, m * [0, 0, 1], *scan)
    ),
    "the lidar is turned on the robot: add the mount's angle to the beams": (
        "pose[2] + mount[2] + angles => pose[2] + angles"
    ),
    "the mount's angle was taken off: it adds to the heading": (
        "pose[2] + mount[2] => pose[2] - mount[2]"
    ),
    "the place of the lidar was not turned by the heading: ahead means ahead of the robot": (
        "pose[0] + c * mount[0] - s * mount[1] => pose[0] + mount[0]",
        "pose[1] + s * mount[0] + c * mount[1] => pose[1] + mount[1]",
    ),
    "the place of the lidar was turned the wrong way round": (
        "np.sin(pose[2])\n => -np.sin(pose[2])\n"
    ),
    "the place of the lidar was turned by the mount's angle, too: it is given in the robot's "
    "frame": (
        "np.cos(pose[2]), np.sin(pose[2])\n => "
        "np.cos(pose[2] + mount[2]), np.sin(pose[2] + mount[2])\n"
    ),
    "pose and mount are exchanged": lambda p, m, *scan: scan_to_points(m, p, *scan),
    "the scan was turned against the heading: add it, do not subtract it": (
        "pose[2] + mount[2] + angles => mount[2] + angles - pose[2]"
    ),
    "x and y are exchanged": (lambda *given: scan_to_points(*given)[:, ::-1]),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: a lidar on the robot's nose
#
# Two poses in a row: the robot in the world, the lidar on the robot. The second is given in the
# frame of the first, so its place is turned before it is added, and the headings add. It is the
# composition that [chapter 00](../00_slam_in_ten_minutes.ipynb) builds paths with.

# %% [markdown] tags=["solution"]
# The wall that is drawn twice: facing it, the lidar is 0.4 m nearer to the wall than the centre,
# and its ranges are 0.4 m shorter; with the back to it, 0.4 m longer. Here the wall is at x = 5 m:

# %% active="ipynb" tags=["solution"]
# mount, as_if = np.array([0.4, -0.2, 0.0]), np.zeros(3)
# for heading in (0.0, np.pi):
#     pose, zero = np.array([2.0, 1.0, heading]), np.zeros(1)
#     ahead = np.array([-heading])  # the beam that runs along the x axis of the world
#     seen = 5.0 - scan_to_points(pose, mount, zero, zero)[:, 0]
#     print(f"range {seen[0]:.1f} m, drawn at x = "
#           f"{scan_to_points(pose, as_if, seen, ahead)[0, 0]:.1f} m")

# %% [markdown] tags=["solution"]
# So the two walls are 0.8 m apart, each 0.4 m from the true one, and the 0.2 m to the right shift
# the ends along the wall, where it does not show.
#
# How large is the mistake of a single end if the mount is forgotten? As large as the mount, here
# 0.45 m, if its angle is right. Forget an angle of 1 rad too, and a wall that is four metres away
# is drawn metres from its place:

# %% active="ipynb" tags=["solution"]
# pose, mount = np.array([1.0, 1.2, 0.5]), np.array([0.4, -0.2, 1.0])
# wall = scan_to_points(pose, mount, np.array([4.0]), np.array([0.3]))
# for name, wrong in (("place forgotten", [0, 0, 1.0]), ("all forgotten", np.zeros(3))):
#     off = scan_to_points(pose, np.array(wrong), np.array([4.0]), np.array([0.3])) - wall
#     print(f"{name}: {np.hypot(*off[0]):.2f} m")

# %% [markdown] tags=["solution"]
# Leaving out what is missing is tempting, for then no NaN appears in any plot. But the row of a
# point is the number of its beam, and a program that uses that number later gets the neighbour's:

# %% active="ipynb" tags=["solution"]
# def left_out(pose, mount, ranges, angles):
#     there = np.isfinite(ranges)
#     return scan_to_points(pose, mount, ranges[there], angles[there])
#
# check_scan_to_points(left_out)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a robot that brakes in an empty hall, two bugs to find
#
# A robot that is simulated with the program below brakes in the middle of an empty hall. Its rooms
# are drawn as straight walls, not as cells, which makes them exact at any angle. A beam from $p$
# in the direction $d$, a unit vector, meets the wall from $a$ to $b$ where
#
# $$
# p + t\,d = a + s\,(b - a) .
# $$
#
# **Pencil first.** Two equations, two unknowns: $t$ and $s$. Take the product of both sides with
# $b - a$ to be rid of one, then with $d$ to be rid of the other, where $u \times v = u_x v_y -
# u_y v_x$. Mind the order: $u \times v = -\,v \times u$, and $u \times u = 0$.
#
# <details><summary>The two formulas, to compare with yours</summary>
#
# $$
# t = \frac{(a - p) \times (b - a)}{d \times (b - a)}, \qquad s = \frac{(a - p) \times d}
# {d \times (b - a)} .
# $$
#
# </details>
#
# Now the program. The call below it has two cases in which the robot brakes. In the first,
# straight ahead is a gate, open from y = -1 to y = 1, with nothing behind it. In the second, the
# robot has its back to the only wall. There are two bugs, and each alone makes a robot brake. Run
# the check, find both, repair them.


# %% tags=["exercise"]
def nearest_wall(segments: Array, x: float, y: float, angle: float) -> float:
    """Range of one beam in a room of straight walls.

    Parameters
    ----------
    segments : ndarray, shape (n, 2, 2)
        The two ends of each wall (m).
    x, y : float
        Where the beam starts (m).
    angle : float
        Its direction (rad), counterclockwise from the x axis.

    Returns
    -------
    float
        Distance (m) to the nearest wall that is met, its ends included; 0 if the beam
        starts on it, inf if none is met. A wall that runs along the beam
        (abs(d x (b - a)) < 1e-12) is not met, not even by a beam that starts on it.
    """
    d = np.array([np.cos(angle), np.sin(angle)])
    along, to = segments[:, 1] - segments[:, 0], segments[:, 0] - np.array([x, y])
    det = d[0] * along[:, 1] - d[1] * along[:, 0]
    crossing = np.abs(det) > 1e-12
    along, to, det = along[crossing], to[crossing], det[crossing]
    t = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / det
    s = (to[:, 0] * d[1] - to[:, 1] * d[0]) / det
    met = (t >= 0) & (s >= 0) & (s <= 1)
    return t[met].min() if met.any() else np.inf


# %% active="ipynb" tags=["stub"]
#     d = np.array([np.cos(angle), np.sin(angle)])
#     along, to = segments[:, 1] - segments[:, 0], segments[:, 0] - np.array([x, y])
#     det = d[0] * along[:, 1] - d[1] * along[:, 0]
#     crossing = np.abs(det) > 1e-12
#     along, to, det = along[crossing], to[crossing], det[crossing]
#     t = np.abs((along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]) / det)
#     s = (to[:, 0] * d[1] - to[:, 1] * d[0]) / det
#     length = np.hypot(along[:, 0], along[:, 1])
#     met = (s >= 0) & (s <= length)
#     return t[met].min() if met.any() else np.inf

# %% active="ipynb" tags=["try"]
# gate, back = [[[4, 1], [4, 4]], [[4, -4], [4, -1]]], [[[-2, -0.5], [-2, 0.5]]]
# [float(nearest_wall(np.array(walls), 0.0, 0.0, 0.0)) for walls in (gate, back)]

# %% [markdown] tags=["hint"]
# Draw the scene of the first property that fails, with numbers. Compute $t$ and $s$ of that wall
# with a pencil and your own two formulas; then print what the program has.

# %% [markdown] tags=["hint"]
# One of them differs from yours. What does the sign of $t$ say about a wall, and can the program
# still know it? Repair that line whole, and compare it once more with yours.

# %% [markdown] tags=["hint"]
# Then the other. What are $t$ and $s$ measured in, and which values of both mean that the wall is
# met? Where is the point $a + s\,(b - a)$ for s = 0, for s = 1 and for s = 2?


# %% tags=["cases"]
@drawn
def _walls(rng: np.random.Generator, n: int) -> Any:
    start = np.round(rng.uniform(-5, 5, (n, 2)), 2)
    ends = start + np.round(rng.uniform(0.5, 5, (n, 2)) * rng.choice([-1, 1], (n, 2)), 2)
    x, y = np.round(rng.uniform(-2, 2, 2), 2)
    return np.stack([start, ends], 1), x, y, np.round(rng.uniform(-3.1, 3.1), 3)


def _on_one_line(rng: np.random.Generator) -> Any:
    """Draw three walls across one beam, in any order of distance, one of them behind."""
    angle = float(np.round(rng.uniform(-3.1, 3.1), 2))
    d = np.array([np.cos(angle), np.sin(angle)])
    places = rng.permutation([-1.0, 2.0, 3.0, 5.0])[:, None] * d
    aside = np.round(rng.uniform([[0.2, 1.0]], [[0.6, 9.0]], (4, 2)), 2)  # off the middle
    aside = rng.permuted(aside, axis=1)[:, :, None] * np.array([-d[1], d[0]])
    start = np.round(rng.uniform(-2, 2, 2), 2)
    return np.stack([places - aside[:, 0], places + aside[:, 1]], 1) + start, *start, angle


def _nearest_drawn(ax: Any, function: Any) -> None:
    """Draw 120 beams in a hall with an open gate on the right, a pillar and a partition."""
    from slamlab import plots

    hall = [(6, 3.3), (6, 5), (0, 5), (0, 0), (6, 0), (6, 1.5)]
    pillar = [(1.2, 3), (2.2, 3), (2.2, 3.8), (1.2, 3.8), (1.2, 3)]
    rings = [np.array(ring, float) for ring in (hall, pillar, [(2.2, 0.9), (2.2, 1.5)])]
    walls = np.vstack([np.stack([ring[:-1], ring[1:]], 1) for ring in rings])
    start, angles = np.array([4.0, 2.1]), np.linspace(-np.pi, np.pi, 120, endpoint=False) + 0.01
    ranges = np.array([float(function(walls, *start, float(angle))) for angle in angles])
    ranges[~np.isfinite(ranges)] = np.nan
    ends = start + ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    plots.walls(ax, walls)
    _beams_drawn(ax, start, ends)
    plots.lidar_points(ax, ends, s=3)
    ax.plot(*start, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)
    ax.set(xlim=(-0.5, 6.5), ylim=(-0.5, 5.5))


check_nearest_wall = Check(
    nearest_wall,
    "range",
    {
        "one wall ahead": ([[[2.0, -1.0], [2.5, 1.0]]], 0.5, 0.0, 0.1),
        "one wall, drawn the other way round": ([[[2.5, 1.0], [2.0, -1.0]]], 0.5, 0.0, 0.1),
        "one wall, somewhere else": ([[[-2.0, -1.0], [-2.5, 1.0]]], 0.5, 0.0, 0.1),
        "one wall, met near its second end": ([[[2.0, -3.0], [2.5, 0.6]]], 0.5, 0.0, 0.1),
        "another wall, met near its second end": (
            [[[2.0, -0.2], [2.1, 0.3]]],
            0.5,
            0.0,
            0.1,
        ),
        "an open gate between two walls": (
            [[[4.0, 1.0], [4.0, 4.0]], [[4.0, -4.0], [4.0, -1.0]]],
            0.0,
            0.0,
            0.1,
        ),
        "two walls, one after the other": (
            [[[1.0, -0.1], [1.0, 6.0]], [[2.0, -1.0], [2.0, 1.0]]],
            0.0,
            0.0,
            0.1,
        ),
        "four walls, somewhere": _on_one_line,
        "a wall that the beam passes by": ([[[2.0, 1.0], [2.5, 3.0]]], 0.5, 0.0, 0.1),
        "the beam touches the first end of a wall": ([[[2, 0], [2, 1]]], 0.5, 0.0, 0.0),
        "the beam touches the second end of a wall": ([[[3, -1], [3, 0]]], 0.5, 0.0, 0.0),
        "the lidar stands on a wall": ([[[3.0, 0.0], [3.0, 2.0]], [[1, -1], [1, 1]]], 1, 0, 0),
        "a wall along the beam, and two across": (
            [[[1, 0.5], [2, 0.5]], [[2, 0.5], [2, -0.5]], [[3, -1], [3, 2]]],
            0,
            0,
            0,
        ),
        "a wall along the beam that the lidar stands on, and one across": (
            [[[1.0, 0.0], [1.0, 2.0]], [[0.0, 3.0], [2.0, 3.0]]],
            1.0,
            0.5,
            np.pi / 2,
        ),
        "any walls, any beam": _walls(5),
        "no walls at all": (np.zeros((0, 2, 2)), 0.5, 0.0, 0.1),
    },
    draws=15,
    tolerance=1e-8,
    picture=_nearest_drawn,
    hunt=True,
)


# %% tags=["mistakes"]
def _nearest_middle(segments: Array, x: float, y: float, angle: float) -> float:
    ranges = np.array([nearest_wall(wall[None], x, y, angle) for wall in segments])
    far = np.hypot(*(segments.mean(axis=1) - [x, y]).T)
    met = np.isfinite(ranges)
    return float(ranges[met][np.argmin(far[met])]) if met.any() else np.inf


check_nearest_wall.mistakes = {
    "the ends belong to a wall: s from 0 to 1, both included": (
        "(s >= 0) & (s <= 1) => (s > 0) & (s < 1)"
    ),
    "a lidar on a wall meets it at zero: t >= 0": "(t >= 0) => (t > 0)",
    "the product has a sign: (a - p) x (b - a), not (b - a) x (a - p)": "t = (to => t = -(to",
    "s is a share of the wall, from 0 to 1: this compares it with metres": (
        "(s <= 1) => (s <= np.hypot(along[:, 0], along[:, 1]))"
    ),
    "the wall's direction was made a unit vector: s is then in metres, and 1 no longer its end": (
        "along, to, det = along[crossing] => along /= np.linalg.norm(along, axis=1)[:, None]\n"
        "    det = d[0] * along[:, 1] - d[1] * along[:, 0]\n"
        "    along, to, det = along[crossing]"
    ),
    "this is the wall whose middle is nearest: another may be met before it": _nearest_middle,
    "walls behind the lidar are met as well: only those ahead count, t >= 0": (
        "(t >= 0) &  => ",
        "t[met].min() => np.abs(t[met]).min()",
    ),
    "a range is negative: walls behind the lidar do not count": "(t >= 0) &  => ",
    "this is the first wall of the list that is met: expected the nearest": (
        "t[met].min() => t[met][0]"
    ),
    "this is the last wall of the list that is met: expected the nearest": (
        "t[met].min() => t[met][-1]"
    ),
    "this is the farthest wall that is met: the nearest hides it": "min() => max()",
    "the walls go on for ever: each ends where s leaves 0 to 1": (" & (s >= 0) & (s <= 1) => "),
    "a wall goes on beyond its second end: s <= 1": " & (s <= 1) => ",
    "a wall goes on before its first end: s >= 0": " & (s >= 0) => ",
    "a wall was made twice as long: s runs from 0 to 1, not from -1": "s >= 0 => s >= -1",
    "a beam that meets nothing gives inf": "else np.inf => else 0.0",
    "t and s are exchanged: t runs along the beam, s along the wall": (
        "met = (t => t, s = s, t\n    met = (t"
    ),
    "sine and cosine are exchanged: angle 0 points along x": (
        "[np.cos(angle), np.sin(angle)] => [np.sin(angle), np.cos(angle)]"
    ),
    "x and y have no effect: the beam starts there": "- np.array([x, y]) => - 0.0",
    "det has the wrong sign: it is d x along, not along x d": "det = d => det = -d",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: a robot that brakes in an empty hall
#
# The product with $b - a$ removes $s$, since $(b - a) \times (b - a) = 0$; the product with $d$
# removes $t$. $d$ has length one, so $t$ is in metres; $b - a$ has the length of the wall, so $s$
# is a share of it.
#
# The first bug: the program has $(b - a) \times (a - p)$, the other way round, so walls ahead get
# a negative $t$. The absolute value makes them look right, and with them the walls *behind* the
# lidar. Without `np.abs`, but with t >= 0 asked for, only what is behind is seen. The second bug:
# $s$ is compared with the length in metres. A wall of three metres goes on to s = 3, six metres
# beyond its end, and closes the gate; a wall of half a metre ends at s = 0.5, in its middle.

# %% [markdown] tags=["solution"]
# With a single wall ahead, a metre long, neither bug shows. Another mistake shows even less: the
# wall whose middle is nearest is taken for the one that is met first. But a long wall beside the
# robot has its middle far away:

# %% active="ipynb" tags=["solution"]
# def nearest_middle(segments, x, y, angle):
#     far = np.hypot(*(segments.mean(axis=1) - [x, y]).T)
#     for wall in segments[np.argsort(far)]:
#         if nearest_wall(wall[None], x, y, angle) < np.inf:
#             return nearest_wall(wall[None], x, y, angle)
#     return np.inf
#
# check_nearest_wall(nearest_middle)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a drive past a glass door
#
# Exercise 1's robot has driven past its glass door before, and made a map of what it saw. Repeat
# that drive, from your own functions: a plan whose cells have a side of `resolution` metres, a
# robot that stops at several poses and scans, a lidar mounted on it. Poses and results are in
# metres, `first_hit` counts in cells. What is farther than `max_range` is not seen.
#
# **Predict first.** Two rooms share a wall (x from 2.8 to 3.2 m) with a doorway (y from 0.4 to
# 1.2) and a pane of glass (y from 1.6 to 3.6). The cells have a side of 0.4 m, so five of them are
# glass. The robot scans from 1 (0.9, 2.4), 2 (1.6, 1.9) and 3 (2.1, 1.1) in the left room, from 4
# (3.1, 0.8) in the doorway, where the wall hides the pane, and from 5 (3.9, 1.2) and 6 (3.9, 2.0)
# in the right room. Each scan has 90 beams over 258°, and without a mount the pane is within these
# 258° at every pose. The map counts for each cell the beams that ended in it and the beams that
# passed through it, and has a wall there if at least as many ended as passed. Sketch it, and leave
# the mount out: on which part of the pane do beams of each pose end? Then say for each of the five
# cells, from the bottom up: wall or hole?
#
# Then draw, and open the picture. Its lidar has the mount (0.15, 0.1, -0.3). The pane is outlined
# with dots, beams that went through it are orange, and in the map white is free, dark a wall, and
# grey was never seen. Beside each cell of the pane is written how many ended and how many passed.


# %% tags=["exercise", "predict"]
def record(
    cells: Ints,
    resolution: float,
    poses: Array,
    mount: Array,
    n_beams: int,
    field_of_view: float,
    max_range: float,
) -> tuple[Array, Array]:
    """Scans of a drive, as ranges and as points.

    Parameters
    ----------
    cells : ndarray of int, shape (rows, columns)
        0 free, 1 wall, 2 glass; row 0 at the bottom.
    resolution : float
        Side of a cell (m).
    poses : ndarray, shape (k, 3)
        x (m), y (m), heading (rad) of the robot.
    mount : ndarray, shape (3,)
        The lidar on the robot, as for `scan_to_points`.
    n_beams : int
    field_of_view : float
        In radians, as for `beam_angles`; the robot stands while it scans.
    max_range : float
        Reach of the lidar (m).

    Returns
    -------
    ranges : ndarray, shape (k, n_beams)
        In metres; inf where a beam met nothing within its reach.
    points : ndarray, shape (k, n_beams, 2)
        Where the beams ended, in the world (m); NaN where they met nothing.
    """
    angles = beam_angles(n_beams, field_of_view, 0.0)
    ranges = np.full((len(poses), n_beams), np.inf)
    points = np.full((len(poses), n_beams, 2), np.nan)
    for k, pose in enumerate(poses):
        x, y = scan_to_points(pose, mount, np.zeros(1), np.zeros(1))[0] / resolution
        for i, angle in enumerate(angles):
            r = resolution * first_hit(cells, x, y, pose[2] + mount[2] + angle)
            if r <= max_range:
                ranges[k, i] = r
        points[k] = scan_to_points(pose, mount, ranges[k], angles)
    return ranges, points


# %% active="ipynb" tags=["try"]
# pose = np.array([[0.25, 0.25, 0.0]])
# record(np.array([[0, 0, 0, 1]]), 0.5, pose, np.zeros(3), 1, 1.0, 5.0)

# %% [markdown] tags=["hint"]
# For the prediction: a lidar is at a distance D before the pane. How far beside the foot of the
# perpendicular does the beam end that meets the pane at 30°?

# %% [markdown] tags=["hint"]
# Two loops: over poses, and over the directions of the beams. In which direction of the world
# does a beam point, and where does it start? (`scan_to_points` with a range of 0 says where the
# lidar is.)

# %% [markdown] tags=["hint"]
# Metres go in, cells are counted, metres come out: a division before `first_hit` and a
# multiplication after it. `scan_to_points` turns by both headings itself: give it the directions
# as `beam_angles` has them.


# %% tags=["cases"]
@drawn
def _tour(
    rng: np.random.Generator, poses: int, n_beams: int, view: float, reach: float = np.inf
) -> Any:
    rows, columns = rng.integers(6, 12, 2)
    cells = rng.choice([0, 1, 2], (rows, columns), p=[0.8, 0.12, 0.08])
    resolution = float(rng.choice([0.25, 0.4, 2.0]))
    places = rng.uniform(1.1, [columns - 1.1, rows - 1.1], (poses, 2))
    headings = np.round(rng.uniform(-3.1, 3.1, (poses, 1)), 3)
    path = np.hstack([np.round(places, 3) * resolution, headings])
    mount = np.round(rng.uniform([-0.6, -0.6, -2], [0.6, 0.6, 2]), 2) * [resolution, resolution, 1]
    cells[tuple((compose(path, mount)[:, :2] / resolution).astype(int).T[::-1])] = 0
    return cells, resolution, path, mount, n_beams, view, reach * resolution


_CORRIDOR = np.zeros((3, 8), dtype=int)


_CORRIDOR[1, [5, 7]] = 1


def _tally(cells: Ints, side: float, starts: Array, ends: Array, met: Mask) -> tuple[Any, ...]:
    """Return how many beams ended in each cell, how many passed it, and which passed glass.

    `ends` (k, n, 2) are those of the beams from `starts` (k, 1, 2); `met` says which hit.
    """
    way = ends - starts
    along = np.arange(0.0, 1.0, 0.0025)[:, None]
    places = (starts[..., None, :] + along * way[..., None, :]).reshape(met.size, -1, 2)
    column, row = np.moveaxis(np.floor(places / side).astype(int), -1, 0)
    rows, columns = cells.shape
    beam, step = np.nonzero((row >= 0) & (row < rows) & (column >= 0) & (column < columns))
    passed = np.zeros((met.size, rows, columns), dtype=bool)
    passed[beam, row[beam, step], column[beam, step]] = True
    behind = (ends + 1e-3 * way / np.linalg.norm(way, axis=-1, keepdims=True))[met]
    edges = side * np.arange(rows + 1), side * np.arange(columns + 1)
    hit = np.histogram2d(behind[:, 1], behind[:, 0], bins=edges)[0].astype(int)
    return hit, passed.sum(axis=0), passed[:, cells == 2].any(axis=1).reshape(met.shape)


def _record_drawn(ax: Any, function: Any) -> None:
    """Draw a drive past a pane of glass (dotted); below it the map of its six scans.

    Beside each cell of the pane: beams that ended in it / passed it. Grey in the map was never
    seen. The arrow is a way that the map has free.
    """
    from slamlab import plots

    cells, path = _two_rooms()
    mount, reach = np.array([0.15, 0.1, -0.3]), 4.0
    _, points = function(cells, 0.4, path, mount, 90, 4.5, reach)
    lidar = compose(path, mount)
    beams = lidar[:, 2:] + beam_angles(90, 4.5, 0.0)
    points = np.broadcast_to(np.asarray(points, float), (*beams.shape, 2))
    met = np.isfinite(points).all(axis=-1)
    starts = lidar[:, None, :2]
    far = starts + reach * np.stack([np.cos(beams), np.sin(beams)], -1)
    ends = np.where(met[..., None], points, far)
    hit, passed, through = _tally(cells, 0.4, starts, ends, met)
    wall = (hit > 0) & (hit >= passed)
    ax.figure.set_figheight(5.4)
    _cells_drawn(ax, cells, 0.4)
    state = np.where(wall, 0.8, np.where(passed > 0, 0.0, 0.3))
    below = -4.8
    plots.occupancy(ax, state, [0, 6.4, below, below + 4])
    for start, scan, glass in zip(starts, ends, through, strict=True):
        _beams_drawn(ax, start, scan[~glass])
        _beams_drawn(ax, start, scan[glass], plots.COLOURS["dead_reckoning"])
    ax.plot(*points.reshape(-1, 2).T, ".", color=plots.COLOURS["truth"], markersize=1.5)
    nose = np.stack([np.cos(path[:, 2]), np.sin(path[:, 2])])
    ax.quiver(*path[:, :2].T, *(0.55 * nose), angles="xy", scale_units="xy", scale=1, width=0.008)
    ax.plot(*path[:, :2].T, "o", markersize=9, markerfacecolor="white", color="black")
    for k, pose in enumerate(path, 1):
        ax.text(*pose[:2], str(k), ha="center", va="center_baseline", fontsize=7)
    pane = np.argwhere(cells == 2)
    for row, column in pane:
        said = f"{hit[row, column]} / {passed[row, column]}"
        ax.text(3.3, below + 0.4 * row + 0.2, said, va="center", fontsize=8)
    hole = [row for row, column in pane if not wall[row, column] and passed[row, column]]
    if hole:
        y = below + 0.4 * hole[len(hole) // 2] + 0.2
        ax.annotate("", (3.2, y), (1.2, y), arrowprops={"arrowstyle": "-|>", "color": "black"})
    ax.text(0, 4.1, "the drive", fontsize=8)
    ax.text(0, below + 4.1, "the map of its scans", fontsize=8)
    for up, out in ((0.0, 0.09), (below, 0.0)):  # beside the ends of the beams, not over them
        left, right, low, high = 2.8 - out, 3.2 + out, up + 1.6 - out, up + 3.6 + out
        around = [left, right, right, left, left], [low, low, high, high, low]
        ax.plot(*around, "k:", lw=1.3, zorder=5)
    ax.set(xlim=(0.5, 5.9), ylim=(below + 0.7, 3.8), xlabel="x (m)", ylabel="", yticks=[])
    ax.set_title(f"{through.sum()} through the glass, hole {0.4 * len(hole):.1f} m", loc="left")


def _two_rooms() -> tuple[Ints, Array]:
    """Return two rooms with a doorway and a pane between them, and a drive through the doorway."""
    cells = np.zeros((10, 16), dtype=int)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[:, 7] = 1
    cells[1:3, 7], cells[4:9, 7] = 0, 2
    path = np.array([[0.9, 2.4, -0.4], [1.6, 1.9, -0.8], [2.1, 1.1, -0.5], [3.1, 0.8, 0.0],
                     [3.9, 1.2, 1.7], [3.9, 2.0, 1.8]])  # fmt: skip
    return cells, path


check_record = Check(
    record,
    "ranges, points",
    {
        "one beam, one pose, the lidar at the centre": (
            _CORRIDOR,
            0.4,
            [[0.5, 0.5, 0.0]],
            np.zeros(3),
            1,
            1.0,
            9.0,
        ),
        "one beam, one pose": _tour(1, 1, 1.0),
        "a full circle from three poses": _tour(3, 8, 2 * np.pi),
        "a part of the circle": _tour(2, 7, 2.0),
        "a short reach": _tour(3, 9, 2 * np.pi, 3.0),
        "a wall just within the reach": (
            _CORRIDOR,
            0.5,
            [[0.5, 0.75, 0.0]],
            np.zeros(3),
            1,
            1.0,
            2.01,
        ),
        "a wall just beyond the reach": (
            _CORRIDOR,
            0.5,
            [[0.5, 0.75, 0.0]],
            np.zeros(3),
            1,
            1.0,
            1.99,
        ),
        "no pose": (_CORRIDOR, 0.5, np.zeros((0, 3)), np.zeros(3), 4, 2 * np.pi, 5.0),
    },
    tolerance=1e-7,
    draws=4,
    picture=_record_drawn,
)

# %% tags=["mistakes"]
check_record.mistakes = {
    "a pose is in metres, `first_hit` counts in cells: divide by the resolution": (
        "[0] / resolution => [0]"
    ),
    "the ranges are in cells: expected metres": "r = resolution *  => r = ",
    "the resolution was used the wrong way round: cells times resolution are metres": (
        "resolution * first_hit( => 1 / resolution * first_hit("
    ),
    "the beams do not turn with the robot: add its heading to the direction of the beam": (
        "pose[2] + mount[2] + angle) => mount[2] + angle)"
    ),
    "the beams do not turn with the lidar on the robot: add the mount's angle": (
        "pose[2] + mount[2] + angle) => pose[2] + angle)"
    ),
    "the beams start at the robot's centre: they start at the lidar": (
        "scan_to_points(pose, mount, np.zeros(1), np.zeros(1))[0] => pose[:2]"
    ),
    "the heading counts twice in the points": (
        "ranges[k], angles) => ranges[k], angles + pose[2])"
    ),
    "the points are seen from the robot: expected points in the world": (
        "scan_to_points(pose, mount, ranges => scan_to_points(np.zeros(3), mount, ranges"
    ),
    "every scan was taken from the first pose": (
        lambda o, s, p, *a: record(o, s, np.repeat(p[:1], len(p), 0), *a)
    ),
    "what is farther than max_range is not seen: expected inf": "if r <= max_range => if True",
    "a beam that met nothing within its reach has the range inf, not max_range": (
        "ranges[k, i] = r\n"
        " => ranges[k, i] = r\n            else:\n                ranges[k, i] = max_range\n"
    ),
    "the ranges are cut at max_range, and the points are not: beyond it there is none": (
        lambda o, s, p, c, n, v, m: (
            record(o, s, p, c, n, v, m)[0],
            record(o, s, p, c, n, v, np.inf)[1],
        )
    ),
    "the points are right, but the range of a beam that met nothing is inf, not max_range": (
        "return ranges, points => return np.minimum(ranges, max_range), points"
    ),
    "max_range is in metres: it was compared with cells": (
        "if r <= max_range => if r / resolution <= max_range"
    ),
    "the points are in cells: expected metres": (
        "return ranges, points => return ranges, points / resolution"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a drive past a glass door
#
# What to notice: both headings are used twice, once to send the beam and once to place its end.
# You add them when you send; `scan_to_points` adds them when it places. `resolution` appears where
# metres become cells and where cells become metres, and nowhere else.

# %% [markdown] tags=["solution"]
# A way to be wrong that a scan with heading zero cannot show: the beams are sent without the
# heading of the robot, and their ends placed with it.

# %% active="ipynb" tags=["solution"]
# def forgets_the_heading(cells, resolution, poses, mount, *beams):
#     angles, zero = beam_angles(*beams[:2], 0.0), np.zeros(1)
#     lidar = [[*scan_to_points(p, mount, zero, zero)[0], mount[2]] for p in poses]
#     sent = np.reshape(lidar, (-1, 3))
#     ranges, _ = record(cells, resolution, sent, np.zeros(3), *beams)
#     points = [scan_to_points(p, mount, r, angles) for p, r in zip(poses, ranges)]
#     return ranges, np.reshape(points, (len(poses), len(angles), 2))
#
# check_record(forgets_the_heading)

# %% [markdown] tags=["solution"]
# Now the prediction, without the mount. At a distance $D$ before the pane, 30° reach
# $D \tan 30° = 0.58\,D$ to each side, and glass is from y = 1.6 to 3.6:
#
# | pose | D (m) | y within 30° (m) | ends on glass at y (m) |
# |---|---|---|---|
# | 1 | 1.9 | 1.3 to 3.5 | 1.6 to 3.5 |
# | 2 | 1.2 | 1.2 to 2.6 | 1.6 to 2.6 |
# | 3 | 0.7 | 0.7 to 1.5 | nowhere |
# | 4 | in the doorway | none | nowhere: the wall hides it |
# | 5 | 0.7 | 0.8 to 1.6 | nowhere |
# | 6 | 0.7 | 1.6 to 2.4 | 1.6 to 2.4 |
#
# So beams of three poses end on the lower two cells, of pose 1 alone on the upper two, and of
# poses 1 and 2 on the middle one, where pose 2 has a half of it. All other beams that come there
# pass. And the scans, first without the mount, then with that of the picture. Neighbouring beams
# are 2.9° apart, so the last end is a little short of the limit:

# %% active="ipynb" tags=["solution"]
# plan = np.zeros((10, 16), dtype=int)
# plan[[0, -1], :] = plan[:, [0, -1]] = plan[:, 7] = 1
# plan[1:3, 7], plan[4:9, 7] = 0, 2
# path = np.array([[0.9, 2.4, -0.4], [1.6, 1.9, -0.8], [2.1, 1.1, -0.5], [3.1, 0.8, 0.0],
#                  [3.9, 1.2, 1.7], [3.9, 2.0, 1.8]])
# for mount in np.zeros(3), np.array([0.15, 0.1, -0.3]):
#     print("mount", mount)
#     _, points = record(plan, 0.4, path, mount, 90, 4.5, 4.0)
#     for k, (x, y) in enumerate(np.swapaxes(points, 1, 2), 1):
#         there = y[(x > 2.79) & (x < 3.21) & (y > 1.61) & (y < 3.59)]
#         part = f", y = {there.min():.1f} to {there.max():.1f}" if len(there) else ""
#         print(f"  pose {k}: {len(there)} beams end on the pane{part}")

# %% [markdown] tags=["solution"]
# The mount moves the lidar by 0.18 m: pose 6 begins at y = 1.8 instead of 1.6, and pose 5
# meets the lower end of the pane with two beams. The five cells come out the same: wall, wall,
# hole, hole, hole.
#
# Each pose has only the part of the pane that is straight before it; its other beams go through,
# and on their way they count the glass as free. Above y = 2.6 only pose 1 has a wall, and in the
# upper three cells at least three times as many beams passed as ended. So the lower two cells of
# the pane are a wall in the map, and the upper three a hole of 1.2 m. A robot that is asked to
# cross takes it: this is how exercise 1's robot met its door. What helps is a map that keeps
# *from where* a cell was seen, or a second sensor: sound comes back from glass.

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 06](../solutions/06_lidar_simulation.ipynb).
