"""Right answers of chapter 07, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch07_walls_from_points as ch
from slamlab.geometry import wrap_angle
from slamlab.mapping import fit_line, line_cov


def by_eigenvectors(points, variances):
    centre = np.average(points, axis=0, weights=1 / variances)
    scatter = np.cov(np.transpose(points), aweights=1 / variances, ddof=0)
    normal = np.linalg.eigh(scatter)[1][:, 0]
    if normal @ centre < 0:
        normal = -normal
    return float(normal @ centre), math.atan2(normal[1], normal[0])


def by_singular_vectors(points, variances):
    root = 1 / np.sqrt(variances)[:, None]
    centre = (root**2 * points).sum(0) / (root**2).sum()
    normal = np.linalg.svd(root * (points - centre))[2][1]
    normal = normal * np.sign(normal @ centre)
    return [normal @ centre, np.arctan2(normal[1], normal[0])]


def by_cases(points):
    """Return the farthest point; its distance by three cases, one point at a time."""
    (a, b), best, index = (points[0], points[-1]), -1.0, 0
    for k, p in enumerate(points):
        ahead, back = (p - a) @ (b - a), (p - b) @ (a - b)
        if ahead <= 0:
            off = math.dist(p, a)
        elif back <= 0:
            off = math.dist(p, b)
        else:
            off = abs((b - a)[0] * (p - a)[1] - (b - a)[1] * (p - a)[0]) / math.dist(a, b)
        if off > best:
            best, index = off, k
    return index


def by_weighted_sums(along, variances):
    """Return the lesson's two sums, with weights."""
    w = 1 / variances
    middle = np.average(along, weights=w)
    row_alpha = -w * (along - middle) / (w @ (along - middle) ** 2)
    J = np.stack([w / w.sum() + middle * row_alpha, row_alpha])
    return (J * variances @ J.T).tolist()


def point_by_point(along, variances):
    information = np.zeros((2, 2))
    for t, v in zip(along, variances, strict=True):
        information += np.outer([1, -t], [1, -t]) / v
    return np.linalg.solve(information, np.eye(2))


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


def by_calling_itself(points, variances, width, fewest):
    """Return the walls; the split is a function that calls itself, a piece a pair of arrays."""

    def straight(p, v):
        r, alpha = by_eigenvectors(p, v)
        off = p @ np.array([math.cos(alpha), math.sin(alpha)]) - r
        return max(abs(off) / np.sqrt(v)) <= width

    def split(p, v):
        if len(p) < 3 or straight(p, v):
            return [(p, v)]
        k = by_cases(p)
        return split(p[:k], v[:k]) + split(p[k:], v[k:])

    pieces = split(points, variances)
    if len(pieces) > 1:
        (p, v), (q, w) = pieces[-1], pieces[0]
        joined = np.vstack([p, q]), np.concatenate([v, w])
        if straight(*joined):
            pieces = [joined] + pieces[1:-1]
    lines, covs = [], []
    for p, v in pieces:
        if len(p) >= fewest:
            r, alpha = by_singular_vectors(p, v)
            lines.append([r, alpha])
            covs.append(point_by_point(p @ [-np.sin(alpha), np.cos(alpha)], v))
    return np.reshape(lines, (-1, 2)), np.reshape(covs, (-1, 2, 2))


def by_information(poses, P, scans, variances, gate):
    """Return the map; both names are tried for every pair, and information is added."""
    known = []
    for pose, points, v in zip(poses, scans, variances, strict=True):
        for seen in zip(*by_calling_itself(points, v, 4.0, 10), strict=True):
            (r, alpha), C = ch.to_world(pose, P, *seen)
            squared, best = gate, None
            for m, (mean, M) in enumerate(known):
                for sign, turn in ((1, 0.0), (-1, math.pi)):
                    off = [sign * r - mean[0], wrap_angle(alpha + turn - mean[1])]
                    W = np.diag([sign, 1]) @ C @ np.diag([sign, 1])
                    now = off @ np.linalg.inv(M + W) @ off
                    if now < squared:
                        squared, best = now, (m, off, W)
            if best is None:
                known.append(([r, alpha], C))
                continue
            m, off, W = best
            mean, M = known[m]
            new = np.linalg.inv(np.linalg.inv(M) + np.linalg.inv(W))
            r, alpha = mean + new @ np.linalg.inv(W) @ off
            known[m] = [r, math.remainder(alpha, 2 * math.pi)], new
    return [mean for mean, _ in known], [cov for _, cov in known]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_line, by_eigenvectors),
        (ch.check_line, by_singular_vectors),
        (ch.check_corner, by_cases),
        (ch.check_wall_cov, by_weighted_sums),
        (ch.check_wall_cov, point_by_point),
        (ch.check_to_world, by_two_points),
        (ch.check_walls, by_calling_itself),
        (ch.check_room_map, by_information),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_with_equal_variances_it_is_the_fit_of_the_library():
    points, even = ch._exact_scan(ch._BAY, 180)[1][:9] + [2.0, 1.0], np.full(9, 0.01)
    covs = np.tile(0.01 * np.eye(2), (9, 1, 1))
    r, alpha = ch.line(points, even)
    along = points @ [-np.sin(alpha), np.cos(alpha)]
    np.testing.assert_allclose([r, alpha], fit_line(points), atol=1e-9)
    np.testing.assert_allclose(ch.wall_cov(along, even), line_cov(points, covs), rtol=1e-6)
