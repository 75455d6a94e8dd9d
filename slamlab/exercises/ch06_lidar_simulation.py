"""Exercises, chapter 06: beams through cells and against walls, the fan of a lidar, a whole drive.

P5, chapters 3.2.2 (`Scan`) and 3.2.4 (`distancetodots`), repaired; points keep their place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
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
# of a fan, a lidar that is not at the robot's centre, a beam with two bugs, and a whole drive
# assembled. The chapter is [Lidar simulation](../06_lidar_simulation.ipynb). Replace each `...`
# and run the check below it as often as you like; then draw what you built beside what is
# expected.

# %% [markdown] tags=["solution"]
# # Solutions 06: lidar simulation
#
# The exercises are in [Exercises 06](../exercises/06_lidar_simulation.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.sensors import Lidar
# from slamlab.worlds import BitmapWorld

# %% [markdown] tags=["statement"]
# ## Exercise 1: a beam that meets glass
#
# A robot that drove without fault for a week is sent to a new office and drives against its glass
# door. Its map has the door as free floor at one place and as a wall at another. A pane sends
# light back only if a beam meets it nearly squarely; at a slant the light goes through, or away.
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
        is inside a wall, inf if the beam leaves the grid. A start inside glass is not
        tried, nor a beam at exactly 30 degrees.
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


def _first_hit_drawn(ax: Any, function: Any) -> None:
    """Draw the end points of 180 beams in an office; its walls are grey, its panes light grey."""
    from slamlab import plots

    cells = np.zeros((10, 14), dtype=int)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[4:6, 3] = 1
    cells[1:9, 10] = cells[7, 1:9] = 2
    x, y = 6.3, 4.6
    _cells_drawn(ax, cells)
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False) + 0.01
    ranges = np.array([float(function(cells, x, y, float(angle))) for angle in angles])
    ends = np.column_stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)])
    plots.lidar_points(ax, np.where(np.isfinite(ends), ends, np.nan), s=3)
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
        "a pane met at 28 degrees": (_PANE, 1.5, 0.4, 0.49),
        "a pane met at a slant lets the beam pass": (_PANE, 1.5, 0.6, 0.7),
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
# How much of a pane does a lidar miss? It stands one metre before a long pane (cells of 10 cm) and
# sends a beam every degree into the half circle ahead; behind the pane is a wall, three metres
# away:

# %% active="ipynb" tags=["solution"]
# office = np.zeros((400, 60), dtype=int)
# office[:, 20], office[:, 50] = 2, 1
# beams = np.deg2rad(np.arange(-80, 81))
# ranges = np.array([first_hit(office, 10.5, 200.5, beam) for beam in beams])
# on_glass = np.isclose(ranges * np.cos(beams), 9.5)
# print(f"{on_glass.sum()} of {len(beams)} beams see the pane, "
#       f"{(~on_glass).sum()} the wall behind it")

# %% [markdown] tags=["solution"]
# So the same pane is a wall in the middle of the scan and free floor at its sides, and an
# occupancy map of a drive along it is whatever was observed last and most often. Who takes glass
# for a wall:

# %% active="ipynb" tags=["solution"]
# def all_solid(cells, x, y, angle):
#     return first_hit(np.minimum(cells, 1), x, y, angle)
#
# check_first_hit(all_solid)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the beams of a lidar
#
# Two lidars: *720 beams, 360°* says the one maker, *181 beams, 180°* the other. In one of them
# neighbouring beams are half a degree apart, in the other a whole degree, and a program that
# treats both alike is wrong for one of them. Lay out the beams for any such lidar.


# %% tags=["exercise"]
def beam_angles(n_beams: int, field_of_view: float) -> Array:
    """Lay out the beams of a lidar.

    Parameters
    ----------
    n_beams : int
        At least one.
    field_of_view : float
        Opening angle (rad), at most 2 pi.

    Returns
    -------
    ndarray, shape (n_beams,)
        Directions (rad), counterclockwise. A full circle begins straight ahead. A part
        of it lies around straight ahead, with a beam on both edges; a single beam looks
        straight ahead. A full turn more or less does not matter.
    """
    if field_of_view >= 2 * np.pi:
        return 2 * np.pi * np.arange(n_beams) / n_beams
    if n_beams == 1:
        return np.zeros(1)
    return np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)


# %% active="ipynb" tags=["try"]
# beam_angles(4, 2 * np.pi)

# %% [markdown] tags=["hint"]
# How many gaps are there between n beams on a full circle, and how many on a part of it?

# %% [markdown] tags=["hint"]
# `np.arange(n_beams) / n_beams` for the circle, `np.linspace` for a part of it.


# %% tags=["cases"]
def _up_to_turns(function: Function, n_beams: int, field_of_view: float) -> Any:
    """Let every turn of 2 pi pass; the half turn is +pi."""
    came = function(n_beams, field_of_view)
    angles = np.mod(np.asarray(came, dtype=float) + np.pi, 2 * np.pi) - np.pi
    return np.where(angles < -np.pi + 1e-9, np.pi, angles)


def _fans_drawn(ax: Any, function: Any) -> None:
    """Draw the beams of three lidars: twelve all round, nine in 160 degrees, a single one."""
    from slamlab import plots

    for x, n, view in ((0.0, 12, 360.0), (2.0, 9, 160.0), (3.8, 1, 90.0)):
        beams = np.asarray(function(n, np.deg2rad(view)), float)
        for angle in beams[:n]:
            ends = np.array([[x, 0.0], [x + np.cos(angle), np.sin(angle)]])
            plots.path(ax, ends, color=plots.COLOURS["lidar"])
        ax.plot(x, 0, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)
    ax.set(xlabel="x (m), ahead", ylabel="y (m)")


check_beam_angles = Check(
    beam_angles,
    "angles",
    {
        "a full circle begins ahead and has no beam twice": (8, 2 * np.pi),
        "500 beams do not fall onto one ray": (500, 2 * np.pi),
        "a single beam looks ahead": (1, 1.0),
        "a single beam of a full circle": (1, 2 * np.pi),
        "two beams look along the edges": (2, 2.0),
        "nearly a full circle has both edges": (5, 6.0),
        "even more nearly a full circle": (7, 6.2),
        "any number shares the circle evenly": lambda rng: (rng.integers(2, 40), 2 * np.pi),
        "a part of the circle": lambda rng: (
            rng.integers(2, 40),
            np.round(rng.uniform(0.1, 6), 2),
        ),
    },
    use=_up_to_turns,
    picture=_fans_drawn,
)


# %% tags=["mistakes"]
def _from_ahead(n: int, view: float) -> Array:
    return beam_angles(n, view) + (0.0 if view >= 2 * np.pi or n == 1 else view / 2)


def _whole_degrees(n: int, view: float) -> Array:
    full = view >= 2 * np.pi
    return np.deg2rad(360 // n) * np.arange(n) if full else beam_angles(n, view)


check_beam_angles.mistakes = {
    "in a full circle the first and the last beam must not look the same way": (
        "field_of_view >= 2 * np.pi => False"
    ),
    "these turn clockwise: angles grow counterclockwise": lambda n, v: -beam_angles(n, v),
    "these are degrees: expected radians": lambda n, v: np.rad2deg(beam_angles(n, v)),
    "a part of the circle has a beam on both of its edges": (
        "np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)"
        " => -field_of_view / 2 + field_of_view * np.arange(n_beams) / n_beams"
    ),
    "a part of the circle lies symmetrically around straight ahead": _from_ahead,
    "whole degrees, as P5 has it: 360 // n leaves a gap or puts all beams on one ray": (
        _whole_degrees
    ),
    "a single beam looks straight ahead, not along the edge": "n_beams == 1 => False",
    "a full circle begins straight ahead, not behind": (
        "2 * np.pi * np.arange(n_beams) / n_beams"
        " => 2 * np.pi * np.arange(n_beams) / n_beams - np.pi"
    ),
    "the fan is twice as wide as the field of view": (
        "-field_of_view / 2, field_of_view / 2, => -field_of_view, field_of_view,"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the beams of a lidar
#
# On a circle there are as many gaps as beams; between two edges there is one less.

# %% [markdown] tags=["solution"]
# `linspace` over the whole circle looks behind the robot twice, and its beams are 360/(n - 1)
# degrees apart:

# %% active="ipynb" tags=["solution"]
# def behind_twice(n_beams, field_of_view):
#     if n_beams == 1:
#         return np.zeros(1)
#     return np.linspace(-field_of_view / 2, field_of_view / 2, n_beams)
#
# check_beam_angles(behind_twice)

# %% [markdown] tags=["statement"]
# ## Exercise 3: a lidar on the robot's nose
#
# In the lesson the lidar stood at the robot's centre. On a real robot it is mounted somewhere:
# ahead of the centre, to one side, often turned, because there was no other place for the cable.
# The pose that a filter estimates is that of the *robot*. Place the ends of a scan in the world.
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
        to the left (m), and how far its beam zero is turned from the nose (rad).
    ranges : ndarray, shape (n,)
        Distances (m); inf where a beam met nothing, NaN where its reading was lost.
    angles : ndarray, shape (n,)
        Directions of the beams from the lidar's beam zero (rad), counterclockwise.

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

# %% [markdown] tags=["hint"]
# `np.where(np.isfinite(ranges), ranges, np.nan)` first: NaN then spreads by itself.


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
    """Draw the ends of two scans, the robot (dot) and its lidar (cross) in a room of walls."""
    from slamlab import plots
    from slamlab.sensors import Lidar
    from slamlab.worlds import WallWorld

    world, lidar = WallWorld.from_polygons(_ROOM), Lidar(60, max_range=4.5)
    plots.walls(ax, world.segments)
    mount = np.array([0.4, -0.2, 1.0])
    for pose in np.array([[1.0, 1.2, 0.5], [4.6, 1.6, -2.6]]):
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
# How large is the mistake if the mount is forgotten? As large as the mount: 0.45 m for the lidar
# of the picture, if its angle is right. Forget the angle too, and a wall that is four metres away
# is drawn metres from its place:

# %% active="ipynb" tags=["solution"]
# pose, mount = np.array([1.0, 1.2, 0.5]), np.array([0.4, -0.2, 1.0])
# wall = scan_to_points(pose, mount, np.array([4.0]), np.array([0.3]))
# for name, wrong in (("place forgotten", [0, 0, 1.0]), ("all forgotten", np.zeros(3))):
#     off = scan_to_points(pose, np.array(wrong), np.array([4.0]), np.array([0.3])) - wall
#     print(f"{name}: {np.hypot(*off[0]):.2f} m")

# %% [markdown] tags=["solution"]
# Leaving out what is missing is tempting, for then no NaN appears in any plot. But the row of a
# point is the number of its beam, and whoever uses that number later gets the neighbour's:

# %% active="ipynb" tags=["solution"]
# def left_out(pose, mount, ranges, angles):
#     there = np.isfinite(ranges)
#     return scan_to_points(pose, mount, ranges[there], angles[there])
#
# check_scan_to_points(left_out)

# %% [markdown] tags=["statement"]
# ## Exercise 4: a robot that brakes for its own back, two bugs to find
#
# A room can also be drawn as straight walls. A beam from $p$ in the direction $d$ meets the wall
# from $a$ to $b$ where $p + t\,d = a + s\,(b - a)$: two equations, two unknowns. $t$ is the
# range, $s$ says where on the wall. With $u \times v = u_x v_y - u_y v_x$ they are
#
# $$
# t = \frac{(a - p) \times (b - a)}{d \times (b - a)}, \qquad s = \frac{(a - p) \times d}
# {d \times (b - a)} .
# $$
#
# Derive both with a pencil: take the product of the equation with $b - a$, then with $d$. A robot
# that is simulated with the program below brakes in the middle of an empty hall, and drives into a
# partition that stands before the wall. Both formulas are right, and two other things are not. Run
# the check, find the two bugs, repair them.


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
#     t = np.abs((to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / det)
#     s = (to[:, 0] * d[1] - to[:, 1] * d[0]) / det
#     met = (s >= 0) & (s <= 1)
#     return t[met][0] if met.any() else np.inf

# %% active="ipynb" tags=["try"]
# float(nearest_wall(np.array([[[2.0, -1.0], [2.0, 1.0]]]), 0.5, 0.0, 0.0))

# %% [markdown] tags=["hint"]
# Draw the scene of the first property that fails. On which side of the lidar is the wall?

# %% [markdown] tags=["hint"]
# What does the sign of $t$ say? And what is left of it in the program?

# %% [markdown] tags=["hint"]
# A beam may cross several walls. Which of them does the program report?


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
    across = np.round(rng.uniform(0.3, 1.0, (4, 1)), 2) * np.array([-d[1], d[0]]) + 0.1 * d
    start = np.round(rng.uniform(-2, 2, 2), 2)
    return np.stack([places - across, places + across], 1) + start, *start, angle


def _nearest_drawn(ax: Any, function: Any) -> None:
    """Draw the end points of 120 beams in a room of walls with a pillar."""
    from slamlab import plots

    pillar = [(1.5, 2.2), (2.5, 2.2), (2.5, 3.0), (1.5, 3.0)]
    rings = [np.array(ring, float) for ring in (_ROOM, pillar)]
    walls = np.vstack([np.stack([ring, np.roll(ring, -1, axis=0)], 1) for ring in rings])
    plots.walls(ax, walls)
    angles = np.linspace(-np.pi, np.pi, 120, endpoint=False) + 0.01
    ranges = np.array([float(function(walls, 3.2, 1.4, float(angle))) for angle in angles])
    ends = np.column_stack([3.2 + ranges * np.cos(angles), 1.4 + ranges * np.sin(angles)])
    plots.lidar_points(ax, np.where(np.isfinite(ends), ends, np.nan), s=4)
    ax.plot(3.2, 1.4, "o", color=plots.COLOURS["truth"])
    plots.floor(ax)
    ax.set(xlim=(-0.5, 6.5), ylim=(-0.5, 5.5))


check_nearest_wall = Check(
    nearest_wall,
    "range",
    {
        "one wall ahead": ([[[2.0, -1.0], [2.5, 1.0]]], 0.5, 0.0, 0.1),
        "one wall, drawn the other way round": ([[[2.5, 1.0], [2.0, -1.0]]], 0.5, 0.0, 0.1),
        "one wall, somewhere else": ([[[-2.0, -1.0], [-2.5, 1.0]]], 0.5, 0.0, 0.1),
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
check_nearest_wall.mistakes = {
    "the ends belong to a wall: s from 0 to 1, both included": (
        "(s >= 0) & (s <= 1) => (s > 0) & (s < 1)"
    ),
    "a lidar on a wall meets it at zero: t >= 0": "(t >= 0) => (t > 0)",
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
# ## Solution 4: a bug to find
#
# The product with $b - a$ removes $s$, since $(b - a) \times (b - a) = 0$; the product with $d$
# removes $t$. So far the program was right. The first bug: a negative $t$ is a crossing *behind*
# the lidar, and the absolute value hides it. The second: `[0]` takes the wall that
# stands first in the list, not the nearest one. With a single wall ahead neither shows; a wall
# behind the lidar shows the first, a second wall ahead may show the other.

# %% [markdown] tags=["solution"]
# Who takes the smallest *absolute* value repairs the second bug only. A robot then sees the wall
# at its back in each beam that finds nothing nearer ahead:

# %% active="ipynb" tags=["solution"]
# def eyes_in_the_back(segments, x, y, angle):
#     ahead = nearest_wall(segments, x, y, angle)
#     return min(ahead, nearest_wall(segments, x, y, angle + np.pi))
#
# check_nearest_wall(eyes_in_the_back)

# %% [markdown] tags=["statement"]
# ## Exercise 5: a lidar on a drive
#
# Assemble it from your three functions: a plan whose cells have a side of `resolution` metres, a
# robot at several poses, a lidar mounted on it. Poses and results are in metres, `first_hit`
# counts in cells. What is farther than `max_range` is not seen.
#
# Then draw. Two rooms share a wall with a doorway and a pane of glass (light grey); six scans,
# each in the colour of its pose. From which poses is the pane there, and from which is it open
# floor?


# %% tags=["exercise"]
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
        In radians, as for `beam_angles`.
    max_range : float
        Reach of the lidar (m).

    Returns
    -------
    ranges : ndarray, shape (k, n_beams)
        In metres; inf where a beam met nothing within its reach.
    points : ndarray, shape (k, n_beams, 2)
        Where the beams ended, in the world (m); NaN where they met nothing.
    """
    angles = beam_angles(n_beams, field_of_view)
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
# Two loops: over poses, and over the directions of the beams. In which direction of the world
# does a beam look, and where does it start? (`scan_to_points` with a range of 0 says where the
# lidar is.)

# %% [markdown] tags=["hint"]
# Metres go in, cells are counted, metres come out: a division before `first_hit` and a
# multiplication after it.

# %% [markdown] tags=["hint"]
# `scan_to_points` turns by both headings itself: give it the directions as `beam_angles` has them.
# inf becomes NaN there.


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


def _record_drawn(ax: Any, function: Any) -> None:
    """Draw six scans on a drive past a pane of glass (light grey), each in its pose's colour."""
    cells, path = _two_rooms()
    _, points = function(cells, 0.2, path, np.array([0.15, 0.1, -0.3]), 60, 4.0, 3.0)
    _cells_drawn(ax, cells, 0.2)
    colours = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#7f6000", "#000000"]
    for pose, ends, colour in zip(path, np.asarray(points, float), colours, strict=True):
        ax.plot(*pose[:2], "o", color=colour, markersize=6)
        ax.plot(*ends.T, ".", color=colour, markersize=2.5)
    ax.set(xlim=(0, 6.4), ylim=(0, 4), xlabel="x (m)", ylabel="y (m)")


def _two_rooms() -> tuple[Ints, Array]:
    """Return two rooms with a doorway and a pane between them, and a drive through the doorway."""
    cells = np.zeros((20, 32), dtype=int)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[:, 15] = 1
    cells[6:11, 15], cells[11:18, 15] = 0, 2
    path = np.array([[0.9, 2.9, 1.2], [1.5, 2.2, 0.4], [2.2, 1.7, 0], [3.1, 1.7, 0],
                     [4.0, 1.8, -0.9], [5.2, 2.4, 2.6]])  # fmt: skip
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
# ## Solution 5: a lidar on a drive
#
# What to notice: both headings are used twice, once to send the beam and once to place its end.
# You add them when you send; `scan_to_points` adds them when it places. `resolution` appears where
# metres become cells and where cells become metres, and nowhere else.

# %% [markdown] tags=["solution"]
# The pane of the picture. How many beams of each pose end on it, of those that would if it were a
# wall?

# %% active="ipynb" tags=["solution"]
# plan = np.zeros((20, 32), dtype=int)
# plan[[0, -1], :] = plan[:, [0, -1]] = plan[:, 15] = 1
# plan[6:11, 15], plan[11:18, 15] = 0, 2
# path = np.array([[0.9, 2.9, 1.2], [1.5, 2.2, 0.4], [2.2, 1.7, 0], [3.1, 1.7, 0],
#                  [4.0, 1.8, -0.9], [5.2, 2.4, 2.6]])
# seen = []
# for cells in (plan, np.minimum(plan, 1)):
#     _, ends = record(cells, 0.2, path, np.array([0.15, 0.1, -0.3]), 60, 4.0, 3.0)
#     x, y = ends[..., 0], ends[..., 1]
#     pane = (x > 2.99) & (x < 3.21) & (y > 2.2) & (y < 3.6)
#     seen.append(pane.sum(axis=1))
# print("on the glass, pose by pose: ", *seen[0])
# print("on a wall in the same place:", *seen[1])

# %% [markdown] tags=["solution"]
# It vanishes just where the robot drives past it. A map of this drive has a wall there by some
# scans and open floor by others, and a planner may take the floor.

# %% [markdown] tags=["solution"]
# Now a drive in a room whose truth is known, 60 by 80 cells of 10 cm with a fence and two boxes:
# twelve poses along an ellipse. Your ranges beside those of the library; then the map that the
# points draw, every end of a beam moved on by a millimetre into the cell that stopped it. No cell
# of it may be free in truth.

# %% active="ipynb" tags=["solution"]
# room = np.zeros((60, 80), dtype=int)
# room[[0, -1], :] = room[:, [0, -1]] = 1
# room[12:20, 50:62] = room[40:48, 15:22] = 1
# turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
# poses = np.column_stack([4 + 1.5 * np.cos(turn), 3 + 1.2 * np.sin(turn), turn + 1.3])
#
# def false_cells(ranges, points):
#     beams = poses[:, 2:] + beam_angles(60, 2 * np.pi)
#     behind = points + 1e-3 * np.stack([np.cos(beams), np.sin(beams)], -1)
#     column, row = np.floor(behind[np.isfinite(ranges)] / 0.1).astype(int).T
#     drawn = set(zip(row.tolist(), column.tolist()))
#     return len(drawn), len(drawn - set(zip(*np.nonzero(room))))
#
# centre = np.zeros(3)
# ranges, points = record(room, 0.1, poses, centre, 60, 2 * np.pi, 5.0)
# library = Lidar(60, max_range=5.0).scan(BitmapWorld(room, 0.1), poses)
# same = np.allclose(ranges, library, rtol=0, atol=1e-9)
# drawn, wrong = false_cells(ranges, points)
# print(f"{np.isfinite(ranges).sum()} beams came back, as in the library: {same}")
# print(f"the points draw {drawn} cells, {wrong} of them free or outside")

# %% [markdown] tags=["solution"]
# A way to be wrong that a scan with heading zero cannot show: the beams are sent without the
# heading, and their ends placed with it. From that one pose everything fits. On a drive the walls
# fall apart:

# %% active="ipynb" tags=["solution"]
# def forgets_the_heading(cells, resolution, poses, mount, *beams):
#     ranges, _ = record(cells, resolution, poses * [1, 1, 0], mount, *beams)
#     angles = beam_angles(*beams[:2])
#     scans = zip(poses, ranges)
#     points = [scan_to_points(pose, mount, scan, angles) for pose, scan in scans]
#     return ranges, np.reshape(points, (len(poses), len(angles), 2))
#
# wrongly = forgets_the_heading(room, 0.1, poses, centre, 60, 2 * np.pi, 5.0)
# drawn, wrong = false_cells(*wrongly)
# print(f"the points draw {drawn} cells, {wrong} of them free or outside")
# check_record(forgets_the_heading)

# %% [markdown] tags=["statement"]
# The solutions are in [Solutions 06](../solutions/06_lidar_simulation.ipynb).
