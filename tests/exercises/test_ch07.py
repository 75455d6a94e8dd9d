"""Right answers of chapter 07, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch07_walls_from_points as ch
from slamlab.geometry import wrap_angle
from slamlab.mapping import fit_line, line_cov


def by_eigenvectors(points):
    centre = np.mean(points, axis=0)
    normal = np.linalg.eigh(np.cov(np.transpose(points)))[1][:, 0]
    if normal @ centre < 0:
        normal = -normal
    return float(normal @ centre), math.atan2(normal[1], normal[0])


def by_normal_of_the_chord(points):
    (x0, y0), (x1, y1) = points[0], points[-1]
    off = [abs((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) for x, y in points]
    return off.index(max(off))


def by_the_library(along, variances):
    """A wall x = 10 with points at y = along, the noise across it."""
    points = np.stack([np.full(len(along), 10.0), along], -1)
    covs = np.zeros((len(along), 2, 2))
    covs[:, 0, 0] = variances
    return line_cov(points, covs).tolist()


def by_two_points(pose, P, wall, C):
    """Another right answer: move two points of the wall; its covariance by differences."""

    def moved(pose, wall):
        n = np.array([np.cos(wall[1]), np.sin(wall[1])])
        c, s = np.cos(pose[2]), np.sin(pose[2])
        a, b = (wall[0] * n + t * np.array([-n[1], n[0]]) for t in (0.0, 1.0))
        a, b = (np.array([[c, -s], [s, c]]) @ p + pose[:2] for p in (a, b))
        foot = a - (b - a) * (a @ (b - a))
        return np.array([np.hypot(*foot), np.arctan2(foot[1], foot[0])])

    def slope(function, at):
        ahead = [function(at + 1e-6 * step) for step in np.eye(len(at))]
        behind = [function(at - 1e-6 * step) for step in np.eye(len(at))]
        d = np.subtract(ahead, behind)
        d[:, 1] = wrap_angle(d[:, 1])
        return d.T / 2e-6

    J, G = slope(lambda p: moved(p, wall), pose), slope(lambda w: moved(pose, w), wall)
    return moved(pose, wall).tolist(), J @ P @ J.T + G @ C @ G.T


def by_a_stack(points, variance, threshold, fewest):
    """Another right answer: no function calls itself."""
    todo, lines, covs = [points], [], []
    while todo:
        piece = todo.pop()
        if len(piece) < fewest:
            continue
        r, alpha = fit_line(piece)
        if max(abs(x * np.cos(alpha) + y * np.sin(alpha) - r) for x, y in piece) <= threshold:
            lines.append([r, alpha])
            covs.append(line_cov(piece, np.tile(variance * np.eye(2), (len(piece), 1, 1))))
        else:
            cut = by_normal_of_the_chord(piece)
            todo += [piece[cut:], piece[:cut]]
    return lines, covs


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_line, by_eigenvectors),
        (ch.check_line, fit_line),
        (ch.check_line, lambda points: fit_line(points).tolist()),
        (ch.check_corner, by_normal_of_the_chord),
        (ch.check_wall_cov, by_the_library),
        (ch.check_to_world, by_two_points),
        (ch.check_walls, by_a_stack),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed
