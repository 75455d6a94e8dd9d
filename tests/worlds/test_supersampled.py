"""Casting against supersampled geometry: 10^5 random rays in random bitmaps."""

import numpy as np
import pytest

from slamlab.worlds import BitmapWorld

STEP = 0.02  # of a cell


def supersampled(world, points, angles, reach):
    """First sample inside an occupied cell, rays marched together; inf where there is none."""
    rows, columns = world.occupied.shape
    direction = np.stack([np.cos(angles), np.sin(angles)], -1)
    found = np.full(len(points), np.inf)
    open_rays = np.arange(len(points))
    for t in np.arange(0.0, reach, STEP):
        at = points[open_rays] + t * direction[open_rays]
        column, row = np.floor(at).astype(int).T
        inside = (0 <= column) & (column < columns) & (0 <= row) & (row < rows)
        hit = inside & world.occupied[np.where(inside, row, 0), np.where(inside, column, 0)]
        found[open_rays[hit]] = t
        open_rays = open_rays[~hit & inside]
        if len(open_rays) == 0:
            break
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
