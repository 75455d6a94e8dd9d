"""Compiled loops under grid FastSLAM: match, weigh and draw a scan on the maps of many particles.

`refine`, `touched`, `draw` and `penetrate`: their plain twins stand in `slamlab.slam.grid_fast`.
A map is a table of tiles: ``table[particle, tile]`` names the page (TILE, TILE, 4) that holds its
cells: hits, metres that beams travelled in the cell, and the sums of the end points (x, y) in it.
`frame` is (resolution, x0, y0) of the corner of the table, `columns` its tiles a row.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.linear import solve3

SHIFT = 4  # a tile is 2^4 = 16 cells wide
TILE = 1 << SHIFT
INSIDE = TILE - 1
HITS, METRES, SUM_X, SUM_Y = range(4)
# Steps of a climb with a quarter of the points and a wider neighbourhood, and with all.
COARSE, FINE = 5, 6
# Matching: more hits a metre than this make a wall; share of points that belong to the map.
RATE, HIT = 1.0, 0.9
# Penetration: free way of a laser in unseen cells (m), sides of a cell that are added to the
# metres of a seen one, floor of a beam's likelihood.
FREE_WAY, PRIOR, FLOOR = 8.0, 4.0, 1e-3
# A climb that is lost is tried from so many headings to either side, so far apart (rad). The turn
# has Student's t distribution of 3 degrees of freedom and this scale (rad).
FAN, APART, SCALE = 4, np.deg2rad(5.0), np.deg2rad(2.0)


@njit(cache=True)
def page_at(tiles, columns, column, row):  # type: ignore[no-untyped-def]
    """Page of the cell (column, row); 0, the empty one, beyond the table (tiles,)."""
    if column < 0 or row < 0 or (column >> SHIFT) >= columns:
        return 0
    tile = (row >> SHIFT) * columns + (column >> SHIFT)
    return tiles[tile] if tile < len(tiles) else 0


@njit(cache=True)
def nearest_wall(pages, tiles, columns, frame, x, y, reach):  # type: ignore[no-untyped-def]
    """Squared distance from (x, y) to the nearest wall within `reach` cells, and its place.

    A cell is wall if more than `RATE` hits came to a metre travelled in it; its place is the mean
    of its hits. The distance is inf if none is there.
    """
    column, row = (
        int(np.floor((x - frame[1]) / frame[0])),
        int(np.floor((y - frame[2]) / frame[0])),
    )
    least, near_x, near_y = np.inf, 0.0, 0.0
    page = page_at(tiles, columns, column, row)
    # Most neighbourhoods lie in one tile: then one look into the table is enough.
    within = reach <= (column & INSIDE) < TILE - reach and reach <= (row & INSIDE) < TILE - reach
    if within and page == 0:
        return least, near_x, near_y
    for r in range(row - reach, row + reach + 1):
        for c in range(column - reach, column + reach + 1):
            if not within:
                page = page_at(tiles, columns, c, r)
            # Number by number: to make a view of the cell takes longer than to read it.
            y_in, x_in = r & INSIDE, c & INSIDE
            hits = pages[page, y_in, x_in, HITS]
            if hits > 0.0 and hits > RATE * pages[page, y_in, x_in, METRES]:
                wx = pages[page, y_in, x_in, SUM_X] / hits
                wy = pages[page, y_in, x_in, SUM_Y] / hits
                d = (wx - x) ** 2 + (wy - y) ** 2
                if d < least:
                    least, near_x, near_y = d, wx, wy
    return least, near_x, near_y


@njit(cache=True)
def normal_equations(pages, tiles, columns, frame, points, pose, reach, sigma, H, g):  # type: ignore[no-untyped-def]
    """Fill the normal equations of sum 1 - exp(-d^2 / 2 sigma^2); return sum exp(...).

    d is the distance of a point (k, 2, in the body), seen from `pose`, to the nearest wall.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    H[:], g[:] = 0.0, 0.0
    total = 0.0
    for k in range(len(points)):
        px, py = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        x, y = pose[0] + px, pose[1] + py
        d, near_x, near_y = nearest_wall(pages, tiles, columns, frame, x, y, reach)
        if d == np.inf:
            continue
        w = np.exp(-0.5 * d / sigma**2)
        total += w
        ex, ey = near_x - x, near_y - y
        g[0] += w * ex
        g[1] += w * ey
        g[2] += w * (px * ey - py * ex)
        H[0, 0] += w
        H[0, 2] -= w * py
        H[1, 2] += w * px
        H[2, 2] += w * (px * px + py * py)
    H[1, 1], H[2, 0], H[2, 1] = H[0, 0], H[0, 2], H[1, 2]
    for i in range(3):
        H[i, i] += 1e-6
    return total


@njit(cache=True)
def gauss_newton(pages, tiles, columns, frame, points, few, start, sigma, H, g, top):  # type: ignore[no-untyped-def]
    """Climb from `start` to `top` (3,), the best place met; return the share of points explained.

    Gauss-Newton, first with `few` points and a wider look round. H and g are room to work in.
    """
    best, here, step = -1.0, start.copy(), np.zeros(3)
    for n in range(COARSE + FINE):
        coarse = n < COARSE
        some, reach = (few, 2) if coarse else (points, 1)
        total = normal_equations(pages, tiles, columns, frame, some, here, reach, sigma, H, g)
        if total > best or n == COARSE:
            best = total
            for a in range(3):  # number by number: a slice takes a second to compile
                top[a] = here[a]
        if not solve3(H, g, step):
            break
        for a in range(3):
            here[a] += step[a]
        if not coarse and abs(step[0]) + abs(step[1]) < 2e-3 and abs(step[2]) < 2e-4:
            break
    return best / len(points)


@njit(cache=True)
def refine(pages, table, columns, frame, points, poses, sigma, lost, score):  # type: ignore[no-untyped-def]
    """Move each pose (M, 3) to where its own map explains the points (k, 2, in the body) best.

    A climb that explains less than the share `lost` of them is lost: others begin from other
    headings, and the likeliest counts. The log likelihood of the points goes to `score` (M,).
    """
    H, g, top, start = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    few = np.ascontiguousarray(points[::4])
    for i in range(len(poses)):
        tiles, heading, most = table[i], poses[i, 2], -np.inf
        for a in range(3):
            start[a] = poses[i, a]
        for turn in range(2 * FAN + 1):
            # None, then one step to the right, one to the left, two to the right, ...
            start[2] = heading + APART * ((turn + 1) // 2) * (1 - 2 * (turn % 2))
            share = gauss_newton(
                pages, tiles, columns, frame, points, few, start, sigma, H, g, top
            )
            fits = fit(pages, tiles, columns, frame, points, top, sigma)
            # Wheels are off by a few degrees as a rule, and now and then by far more.
            worth = fits - 2.0 * np.log1p((top[2] - heading) ** 2 / (3 * SCALE**2))
            if worth > most:
                most, score[i] = worth, fits
                for a in range(3):
                    poses[i, a] = top[a]
            if turn == 0 and share >= lost:
                break


@njit(cache=True)
def fit(pages, tiles, columns, frame, points, pose, sigma):  # type: ignore[no-untyped-def]
    """Log likelihood of points: near a wall of the map, or anywhere."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    total = 0.0
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        d, _, _ = nearest_wall(pages, tiles, columns, frame, x, y, 1)
        total += np.log(HIT * np.exp(-0.5 * d / sigma**2) + 1 - HIT)
    return total


@njit(cache=True)
def start_walk(side, x0, y0, x, y, dx, dy):  # type: ignore[no-untyped-def]
    """Begin a walk from (x, y) along (dx, dy), a unit vector, over squares of this side.

    Square (column, row), direction of its steps, metres to the next line of each kind and from
    line to line.
    """
    column, row = int(np.floor((x - x0) / side)), int(np.floor((y - y0) / side))
    step_c, step_r = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_c = side / abs(dx) if dx != 0.0 else np.inf
    per_r = side / abs(dy) if dy != 0.0 else np.inf
    next_c = (x0 + side * (column + (dx > 0)) - x) / dx if dx != 0.0 else np.inf
    next_r = (y0 + side * (row + (dy > 0)) - y) / dy if dy != 0.0 else np.inf
    return column, row, step_c, step_r, next_c, next_r, per_c, per_r


@njit(cache=True)
def touched(columns, frame, starts, ends, out):  # type: ignore[no-untyped-def]
    """Mark in `out` (M, tiles) the tiles that beams from starts (M, 2) to ends (M, k, 2) meet."""
    side = frame[0] * TILE
    for i in range(len(starts)):
        x, y = starts[i]
        for k in range(ends.shape[1]):
            dx, dy = ends[i, k, 0] - x, ends[i, k, 1] - y
            length = np.hypot(dx, dy)
            if length == 0.0:
                continue
            column, row, step_c, step_r, next_c, next_r, per_c, per_r = start_walk(
                side, frame[1], frame[2], x, y, dx / length, dy / length
            )
            out[i, row * columns + column] = True
            while min(next_c, next_r) < length:
                if next_c < next_r:
                    column += step_c
                    next_c += per_c
                else:
                    row += step_r
                    next_r += per_r
                out[i, row * columns + column] = True


@njit(cache=True)
def draw(pages, table, columns, frame, marked, starts, ends):  # type: ignore[no-untyped-def]
    """Add beams from starts (M, 2) to ends (M, k, 2) to the tiles `marked` (M, tiles)."""
    for i in range(len(starts)):
        x, y = starts[i]
        for k in range(ends.shape[1]):
            ex, ey = ends[i, k]
            dx, dy = ex - x, ey - y
            length = np.hypot(dx, dy)
            if length == 0.0:
                continue
            column, row, step_c, step_r, next_c, next_r, per_c, per_r = start_walk(
                frame[0], frame[1], frame[2], x, y, dx / length, dy / length
            )
            t = 0.0
            while t < length:
                after = min(next_c, next_r, length)
                tile = (row >> SHIFT) * columns + (column >> SHIFT)
                # Rounding may lead past a corner into a tile that nobody marked: leave it.
                if marked[i, tile]:
                    pages[table[i, tile], row & INSIDE, column & INSIDE, METRES] += after - t
                t = after
                if next_c < next_r:
                    column += step_c
                    next_c += per_c
                else:
                    row += step_r
                    next_r += per_r
            column, row = (
                int(np.floor((ex - frame[1]) / frame[0])),
                int(np.floor((ey - frame[2]) / frame[0])),
            )
            tile = (row >> SHIFT) * columns + (column >> SHIFT)
            if marked[i, tile]:
                cell = pages[table[i, tile], row & INSIDE, column & INSIDE]
                cell[HITS] += 1
                cell[SUM_X] += ex
                cell[SUM_Y] += ey


@njit(cache=True)
def penetrate(pages, table, columns, frame, starts, ends, sigma, score):  # type: ignore[no-untyped-def]
    """Log likelihood of beams by DP-SLAM's model of a laser that may pass through any cell.

    A cell stops a beam of length l inside it with 1 - exp(-(h / d) l); P sums over the ray the
    chance to come to a cell, to stop there, and exp(-(r - r_c)^2 / 2 sigma^2) for a measured r.
    """
    prior = PRIOR * frame[0]
    for i in range(len(starts)):
        x, y = starts[i]
        score[i] = 0.0
        for k in range(ends.shape[1]):
            dx, dy = ends[i, k, 0] - x, ends[i, k, 1] - y
            length = np.hypot(dx, dy)
            if length == 0.0:
                continue
            column, row, step_c, step_r, next_c, next_r, per_c, per_r = start_walk(
                frame[0], frame[1], frame[2], x, y, dx / length, dy / length
            )
            reached, total, t = 1.0, 0.0, 0.0
            beyond = length + 4 * sigma
            while t < beyond and reached > 1e-4:
                after = min(next_c, next_r)
                cell = pages[
                    page_at(table[i], columns, column, row), row & INSIDE, column & INSIDE
                ]
                stop = 1 - np.exp(-stop_rate(cell, prior) * (after - t))
                off = length - 0.5 * (t + after)
                total += reached * stop * np.exp(-0.5 * off * off / sigma**2)
                reached *= 1 - stop
                t = after
                if next_c < next_r:
                    column += step_c
                    next_c += per_c
                else:
                    row += step_r
                    next_r += per_r
            score[i] += np.log(total + FLOOR)


@njit(cache=True)
def stop_rate(cell, prior):  # type: ignore[no-untyped-def]
    """How often a metre of this cell stops a beam; of a cell never seen, 1 / FREE_WAY."""
    if cell[METRES] == 0.0:
        return 1.0 / FREE_WAY
    return cell[HITS] / (cell[METRES] + prior)
