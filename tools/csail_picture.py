"""CSAIL by its odometry alone and by thirty particles: the drawing of chapter 15c.

SLAMLAB_DATA=FOLDER python tools/csail_picture.py      (a minute; the folder as in grid_table.py)

Writes book/static/drawings/15_csail.svg: one of the two drives in the middle of the twenty that
grid_table.py stores. A cell of 0.2 m is dark if two beams or more ended in it.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import ate, run
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from slamlab.simulation import drifted
from tools.grid_table import LOGS, best_path, drive, read

ROOT = Path(__file__).resolve().parents[1]
SEED, CELL, SIDE = 20, 0.2, 0.92  # a drive, a cell (m) and its pixels
SIZE = (335, 360)  # cells of a panel
WIDTH, HEIGHT, TOP = round(SIDE * SIZE[0]), round(SIDE * SIZE[1]), 34


def walls_of(scan, ranges, path, low):
    """SVG path of the cells in which two beams or more ended, one stroke for a run in a row."""
    points = scan.points(ranges, path).reshape(-1, 2)
    cells = np.floor((points[np.isfinite(points[:, 0])] - low) / CELL).astype(int)
    cells = cells[((cells >= 0) & (cells < SIZE)).all(1)]
    cells, counts = np.unique(cells, axis=0, return_counts=True)
    cells, strokes = cells[counts > 1], []
    for row in np.unique(cells[:, 1]):
        columns = np.sort(cells[cells[:, 1] == row, 0])
        for part in np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1):
            strokes.append(f"M{part[0]} {row}h{len(part)}")
    return "".join(strokes)


def path_of(poses, low):
    """SVG path through the poses, in cells."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in (poses[:, :2] - low) / CELL)


def drawing():
    """Text of the drawing."""
    whole = read(LOGS["CSAIL"])
    log = drifted(whole, np.random.default_rng(SEED))
    wheels = run(DeadReckoning(RelativePose(), log.truth[0]), log)
    best = best_path(drive(whole, SEED, 30, 0.3, 0.0)[0])
    dashed, solid = 'stroke="#D55E00" stroke-dasharray="7 5"', 'stroke="#0072B2"'
    parts = []
    for left, low, poses, error, name, style in (
        (4, (-10.5, -42.0), wheels.poses, ate(wheels).rmse, "odometry alone", dashed),
        (328, (-19.0, -26.0), best, ate(best, whole.truth).rmse, "thirty particles", solid),
    ):
        box = f'x="{left}" y="{TOP}" width="{WIDTH}" height="{HEIGHT}"'
        walls = walls_of(log.scan, log.ranges, poses, low)
        parts += [
            f'<clipPath id="at{left}"><rect {box}/></clipPath><g clip-path="url(#at{left})">',
            f'<g transform="translate({left},{TOP + HEIGHT}) scale({SIDE},-{SIDE})" fill="none">',
            '<path transform="translate(0,0.5)" stroke="#222222" stroke-width="1.2"',
            f' d="{walls}"/>',
            f'<path {style} stroke-width="1.8" d="{path_of(poses, low)}"/></g></g>',
            f'<rect {box} fill="none" stroke="#222222" stroke-opacity="0.3"/>',
            f'<text x="{left + 4}" y="24">{name}: path error {error:.2g} m</text>',
        ]
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 {TOP + HEIGHT + 4}" width="640"'
        f' height="{TOP + HEIGHT + 4}" font-family="DejaVu Sans, sans-serif" font-size="15"'
        ' fill="#222222">',
        "<title>CSAIL: scans laid along the odometry, and along the path of a particle</title>",
        *parts,
        f'<path d="M574 {TOP + 36}h{10 / CELL * SIDE:.0f}" stroke="#222222" stroke-width="2.5"/>',
        f'<text x="597" y="{TOP + 28}" text-anchor="middle">10 m</text>',
        "</svg>\n",
    ])  # fmt: skip


if __name__ == "__main__":
    (ROOT / "book/static/drawings/15_csail.svg").write_text(drawing())
