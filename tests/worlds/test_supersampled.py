"""Casting against supersampled geometry: 10^5 random rays in random bitmaps."""

import numpy as np
import pytest
from scipy import ndimage

from slamlab.worlds import BitmapWorld

STEP = 0.02  # of a cell


def supersampled(world, points, angles, reach):
    """First sample inside an occupied cell, rays marched together; inf where there is none."""
    kind = np.pad(world.occupied.astype(np.int8), 1, constant_values=2)  # 2 is outside
    found, open_rays = np.full(len(points), np.inf), np.arange(len(points))
    # From a corner of the padded cells on, so that cutting off the fraction rounds down.
    rays = np.stack([*(points.T + 1.0), np.cos(angles), np.sin(angles)])
    for t in np.arange(0.0, reach, STEP):
        x, y, dx, dy = rays
        met = kind[(y + t * dy).astype(np.int32), (x + t * dx).astype(np.int32)]
        if met.any():
            found[open_rays[met == 1]] = t
            open_rays, rays = open_rays[met == 0], rays[:, met == 0]
    return found


def pixel_walk(world, points, angles):
    """P5's way, as the wrong form: one step a pixel of the longer side."""
    rows, columns = world.occupied.shape
    direction = np.stack([np.cos(angles), np.sin(angles)], -1)
    direction /= np.abs(direction).max(-1, keepdims=True)
    found = np.full(len(points), np.inf)
    for k in range(rows + columns):
        at = points + k * direction
        column, row = np.floor(at).astype(int).T
        inside = (0 <= column) & (column < columns) & (0 <= row) & (row < rows)
        hit = inside & world.occupied[np.where(inside, row, 0), np.where(inside, column, 0)]
        new = hit & np.isinf(found)
        found[new] = k * np.hypot(*direction[new].T)
    return found


@pytest.mark.parametrize("share", [0.002, 0.02, 0.2])
def test_ranges_equal_supersampled_geometry_to_half_a_pixel(share):
    rng = np.random.default_rng(int(1000 * share))
    world = BitmapWorld(rng.random((120, 90)) < share, 1.0)
    points = rng.uniform(0, (90, 120), (35_000, 2))
    angles = rng.uniform(-np.pi, np.pi, 35_000)
    ours, due = world.cast(points, angles), supersampled(world, points, angles, 160)
    same = np.isclose(ours, due, rtol=0, atol=0.5)
    # Where they differ the beam cut a corner so little that no sample fell into it.
    chords = [chord(world, points[i], angles[i], ours[i]) for i in np.flatnonzero(~same)]
    assert max(chords, default=0.0) < STEP
    assert (~same).mean() < 0.01
    walk = pixel_walk(world, points, angles)
    wrong = ~np.isclose(walk, due, rtol=0, atol=0.5)
    assert wrong.mean() > 10 * (~same).mean()


def chord(world, point, angle, distance):
    """Length of the beam inside the cell that it hit."""
    d = np.array([np.cos(angle), np.sin(angle)])
    cell = np.floor(point + (distance + 1e-7) * d)
    with np.errstate(divide="ignore"):
        sides = np.sort((np.stack([cell, cell + 1]) - point) / d, axis=0)
    return sides[1].min() - sides[0].max()


def thin_outline(rng, size=100):
    """A closed polygon drawn one pixel wide, as Bresenham does: corners touch, sides need not."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
    corners = 50 + rng.uniform(20, 46, 9)[:, None] * np.stack([np.cos(angles), np.sin(angles)], -1)
    corners = corners.astype(int)
    cells = np.zeros((size, size), bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = max(abs(x1 - x0), abs(y1 - y0), 1)
        t = np.arange(n + 1) / n
        cells[np.rint(y0 + t * (y1 - y0)).astype(int), np.rint(x0 + t * (x1 - x0)).astype(int)] = 1
    return cells


@pytest.mark.parametrize("seed", range(4))
def test_no_beam_leaves_a_room_whose_walls_are_one_pixel_thin(seed):
    rng = np.random.default_rng(seed)
    cells = thin_outline(rng)
    world = BitmapWorld(cells, 1.0)
    # Rooms are what hangs together by sides; the outline touches by corners only.
    rooms_of_cells, _ = ndimage.label(~cells)
    points = rng.uniform(0, 100, (25_000, 2))
    lattice = rng.integers(0, 100, (2_000, 2)) + rng.choice([0.0, 0.5], (2_000, 2))
    points = np.concatenate([points, lattice])
    angles = rng.uniform(-np.pi, np.pi, len(points))
    angles[-2000:] = np.pi / 4 * rng.integers(0, 8, 2000)
    column, row = np.floor(points).astype(int).T
    inside = (rooms_of_cells[row, column] != rooms_of_cells[0, 0]) & ~cells[row, column]
    points, angles, row, column = points[inside], angles[inside], row[inside], column[inside]
    ranges = world.cast(points, angles)
    assert len(ranges) > 5_000
    assert np.isfinite(ranges).all()
    before = points + np.maximum(ranges - 1e-6, 0)[:, None] * np.stack(
        [np.cos(angles), np.sin(angles)], -1
    )
    last_column, last_row = np.floor(before).astype(int).T
    home = rooms_of_cells[row, column] == rooms_of_cells[last_row, last_column]
    # A beam along a grid line may end in the line's other cell; nothing lies farther off.
    assert (home | (ranges < 1e-6) | cells[last_row, last_column]).all()
    walk = pixel_walk(world, points, angles)
    assert (walk > ranges + 3).sum() > 50
