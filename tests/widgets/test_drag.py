"""Figures whose things are dragged: their algorithms, in node, against the library's own."""

import json
import shutil
import subprocess

import numpy as np
import pytest

from slamlab.filters import extended
from slamlab.gaussian import Gaussian, confidence_ellipse
from slamlab.geometry import inverse_transform, wrap_angle
from slamlab.mapping import fit_line, line_cov, point_covs
from slamlab.matching import PointsWithNormals, match_icp
from slamlab.sensors import RangeBearing, Wall
from slamlab.widgets import ScanDrag, Sighting, WallDrag
from slamlab.widgets._pack import script
from slamlab.worlds import WallWorld

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
SPREAD, SIGMAS, WAY = [0.1, 0.1, 0.35], [0.1, 0.0175], 10.0


def in_node(tmp_path, figure, line):
    """What a line of JavaScript gives, with the functions of a figure in sight as `lib`."""
    (tmp_path / "figure.mjs").write_text(script("shared.js", "drag.js", figure))
    call = tmp_path / "call.mjs"
    call.write_text(
        f'import * as lib from "./figure.mjs";\nconsole.log(JSON.stringify({line}));\n'
    )
    done = subprocess.run(["node", call], check=True, capture_output=True, text=True, timeout=60)
    return json.loads(done.stdout)


def predicted():
    F = np.array([[1, 0, 0], [0, 1, WAY], [0, 0, 1.0]])
    return Gaussian([WAY, 0, 0], F @ np.diag(SPREAD) ** 2 @ F.T)


@needs_node
@pytest.mark.parametrize("landmark", [[14.0, 3.0], [10.5, -6.0], [3.0, 0.01], [3.0, -0.01]])
def test_the_page_updates_as_the_extended_filter(tmp_path, landmark):
    eye, truth = RangeBearing(*SIGMAS), np.array([9.0, 4.0, np.arctan2(4.0, 9.0)])
    z = eye.observe(truth, landmark)
    page = in_node(
        tmp_path,
        "sighting.js",
        f"lib.updateBelief(lib.predictStraight({SPREAD}, {WAY}), "
        f"{z.tolist()}, {landmark}, {SIGMAS})",
    )
    due, innovation = extended.update(
        predicted(), z, lambda x: eye.observe(x, landmark),
        lambda x: eye.jacobians(x, np.array(landmark))[0], eye.cov, eye.residual,
    )  # fmt: skip
    np.testing.assert_allclose(page["mean"], due.mean, atol=1e-9)
    np.testing.assert_allclose(page["cov"], due.cov, atol=1e-9)
    assert page["nis"] == pytest.approx(float(innovation.nis), rel=1e-9)


@needs_node
def test_a_bearing_across_the_seam_needs_the_wrap(tmp_path):
    """Without it the two landmarks behind the robot would throw it round."""
    for side in (0.01, -0.01):
        z = in_node(tmp_path, "sighting.js", f"lib.observe([10, 0, 0.1], [3, {side}])")
        assert abs(z[1]) <= np.pi
        assert abs(wrap_angle(z[1] - (np.pi * np.sign(side) - 0.1))) < 0.01


@needs_node
def test_the_page_draws_the_ellipse_of_the_library(tmp_path):
    a, b, angle = in_node(tmp_path, "sighting.js", f"lib.ellipseOf({predicted().cov.tolist()})")
    due = confidence_ellipse(predicted().mean[:2], predicted().cov[:2, :2])
    np.testing.assert_allclose([a, b], due.half_axes, rtol=1e-9)
    assert abs(np.sin(angle - due.angle)) < 1e-9


@needs_node
def test_robots_are_weighed_by_their_likelihood(tmp_path):
    cloud = np.random.default_rng(1).normal([10, 0, 0], [0.3, 0.5, 0.1], (50, 3))
    eye, z = RangeBearing(*SIGMAS), [5.0, 0.6]
    call = f"lib.weigh({cloud.tolist()}, {z}, [14, 3], {SIGMAS})"
    page = in_node(tmp_path, "sighting.js", call)
    residual = eye.residual(z, eye.observe(cloud, [14.0, 3.0]))
    logs = -0.5 * (residual**2 / np.array(SIGMAS) ** 2).sum(-1)
    np.testing.assert_allclose(page["weights"], np.exp(logs - logs.max()), atol=1e-9)
    weights = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    np.testing.assert_allclose(page["mean"], weights @ cloud[:, :2], atol=1e-9)


def room():
    walls = [[[0, 0], [4, 0]], [[4, 0], [4, 3]], [[4, 3], [0, 3]], [[0, 3], [0, 0]]]
    return np.concatenate([np.linspace(a, b, 40, endpoint=False) for a, b in walls])


@needs_node
@pytest.mark.parametrize("rounds", [1, 3, 20])
@pytest.mark.parametrize("metric", ["line", "point"])
def test_the_page_matches_as_the_library(tmp_path, metric, rounds):
    outline = PointsWithNormals.estimate(room())
    on_wall = np.isfinite(outline.normals[:, 0])
    truth, guess = [2.0, 1.5, 0.3], [2.15, 1.4, 0.38]
    points = inverse_transform(truth, room() + 0.003)
    scans = {
        "reference": outline.points[on_wall].tolist(),
        "normals": outline.normals[on_wall].tolist(),
        "points": points.tolist(),
    }
    settings = f"{{ gate: 0.5, width: 0.05, line: {str(metric == 'line').lower()} }}"
    loop = (
        f"((pose) => {{ for (let k = 0; k < {2 * rounds}; k++) "
        f"pose = lib.icpStep({json.dumps(scans)}, pose, {settings}).pose; "
        f"return pose; }})({guess})"
    )
    page = in_node(tmp_path, "scan_drag.js", loop)
    reference = PointsWithNormals(
        outline.points[on_wall], outline.normals[on_wall], outline.normal_variances[on_wall]
    )
    due = match_icp(reference, points, guess, metric, gate=0.5, fine_gate=0.5, n_iterations=rounds)
    np.testing.assert_allclose(page, due.pose, atol=2e-6)
    assert np.abs(np.array(page) - guess).max() > 0.01


ENDS = [[[-0.5, 2.0], [0.5, 2.0]], [[-2.0, -1.0], [-1.0, -3.0]], [[1.0, 3.0], [2.5, 0.4]]]


@needs_node
@pytest.mark.parametrize("ends", ENDS)
def test_the_page_meets_fits_and_doubts_a_wall_as_the_library(tmp_path, ends):
    rng, sigma = np.random.default_rng(3), 0.05
    beams, numbers = np.linspace(-np.pi, np.pi, 180, endpoint=False), rng.standard_normal(180)
    page = in_node(
        tmp_path,
        "wall_drag.js",
        f"((points) => {{ const line = lib.fitLine(points); return {{ points, line, "
        f"cov: lib.lineCov(points, line[1], {sigma}) }}; }})"
        f"(lib.pointsOn({ends}, {beams.tolist()}, {sigma}, {numbers.tolist()}))",
    )
    exact = WallWorld([ends]).cast(np.zeros((180, 2)), beams)
    met = np.isfinite(exact)
    ranges = (exact + sigma * numbers)[met]
    points = ranges[:, None] * np.stack([np.cos(beams[met]), np.sin(beams[met])], -1)
    np.testing.assert_allclose(page["points"], points, atol=1e-9)
    line = fit_line(points)
    np.testing.assert_allclose(page["line"], line, atol=1e-9)
    due = line_cov(points, point_covs(points, sigma))
    np.testing.assert_allclose(page["cov"], due, rtol=1e-7)
    alike = line_cov(points, np.broadcast_to(sigma**2 * np.eye(2), (len(points), 2, 2)))
    assert not np.allclose(page["cov"], alike, rtol=1e-3), "noise lies along the beam"


@needs_node
@pytest.mark.parametrize("line", [[0.02, 0.1], [0.02, 0.1 - np.pi], [3.0, -3.1]])
def test_the_page_knows_both_names_of_a_wall(tmp_path, line):
    due = [0.03, 0.08] if line[0] < 1 else [3.1, 3.1]
    page = in_node(tmp_path, "wall_drag.js", f"lib.lineError({line}, {due})")
    np.testing.assert_allclose(page, Wall(1, 1).residual(line, due), atol=1e-9)


def test_what_goes_into_the_page_is_small():
    outline = PointsWithNormals.estimate(room())
    for figure in (Sighting(), ScanDrag(outline, room(), [0, 0, 0]), WallDrag()):
        assert len(json.dumps(figure.payload)) < 40_000


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sighting(heading=7), "heading: expected one of"),
        (lambda: Sighting(way=-1), "way"),
        (lambda: Sighting(robot=[1, 2, 3]), "robot"),
        (lambda: ScanDrag(room(), room(), [0, 0, 0], gate=0.37), "gate: expected one of"),
        (lambda: ScanDrag(room(), room()[0], [0, 0, 0]), "points"),
        (lambda: ScanDrag(5 * room()[::29], room(), [0, 0, 0]), "reference"),
        (lambda: WallDrag(sigma=0.03), "sigma: expected one of"),
        (lambda: WallDrag(ends=[[0, 1]]), "ends"),
    ],
)
def test_bad_arguments_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_repr_is_stable():
    assert repr(Sighting()) == "Sighting(10 m blind, heading to 20 degrees)"
    assert repr(ScanDrag(room(), room(), [0, 0, 0])).startswith("ScanDrag(160 points on ")
    assert repr(WallDrag()) == "WallDrag(20 scans of 360 beams)"
