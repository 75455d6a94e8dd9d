"""Stored trials: results over many seeds, made apart and read by a page. Chapters 9 to 20."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from slamlab._checks import Array

__all__ = ["stored_runs"]

# What a run of each trial holds, by name.
TRIALS = {
    "ambiguous_closures": (
        "a scan graph along a plain corridor and back by what it does with ambiguous closures: "
        'how many are "kept", how far the way back is off the way out "along" and "across" it '
        '(m), the worst "closure along" and "closure across" (m), and "sigmas", the largest '
        "error along it over the claimed standard deviation"
    ),
    "certificates": (
        'towns by the noise of a heading (rad), "certified" (1 or 0), "gap" of cost and bound '
        '(%), whether the map from the true poses is "cheaper"'
    ),
    "court_drifts": (
        'scan matchers on the first scans of Killian Court with drifting wheels, "error" of '
        "the path (m)"
    ),
    "fast_rounds": (
        'FastSLAM round a circle, "shared" (first steps that all particles have in common) '
        'and the "nees" of the pose at every third step'
    ),
    "grid_logs": 'grid FastSLAM on two real logs, "error" of the path (m)',
    "grid_loops": (
        'grid FastSLAM round two corridors; 8 m before the lap is complete, "before" (error '
        'of the mean) and "spread" of the particles; at the end (m): "carried" there by the '
        'true motion, "nearest" of the particles carried so, and "end", and the same off the '
        'particles\' own first laps: "apart", "apart nearest", "apart end"'
    ),
    "killian_walls": (
        'filters on the walls of nine parts of Killian Court, "error" of the position (m)'
    ),
    "lesson_tables": (
        "tables of the lessons, by chapter and subject: what the functions of the page give"
    ),
    "long_way": (
        "robots that drive home along a straight path by its length (m): median distance from "
        'the start at the "end", and the "stops" of the robots (m)'
    ),
    "matching": 'scan matchers on the two logs, "error" of the path (m)',
    "orchard": (
        'who decides which tree was observed, after a drive with the sensor off: "precision" '
        'and "recall" of the pairs, at the larger drift those of before "found_again", "end" '
        '(error, m); of particles the "nearest_before" the return and "nearest_end" (m), and how '
        'many "count" at the first tree'
    ),
    "orchard_returns": (
        'the same where the names are given until then, and "sigma" of the place on return (m); '
        'a hundred drives more at the drift of the lesson, "1.25, other drives"'
    ),
    "park_fitted": (
        'Victoria Park with a noise fitted by parts, error of the "trees" (m) by the '
        "linearisation of the filter"
    ),
    "park_start": (
        "Victoria Park's first 0.9 km by the factor on its odometry's variance, as "
        "`victoria_park_runs`"
    ),
    "park_twins": (
        'Victoria Park with measurements drawn anew, "trees", "error" of the path, "early" of '
        "its first 0.9 km (m)"
    ),
    "path_fits": (
        'chapter 17\'s drive stored by P3\'s four fits: "segments", mean "kink" (degrees), and '
        'the distance of the points over that from the nearest cubics, "excess"'
    ),
    "picture_flights": (
        'EKF-SLAM of trees from two pictures, by what it is given: mean "squared" error of '
        'the positions (m^2) and "nees" of the last pose'
    ),
    "printed_formulas": (
        'filters with formulas as P1 prints them, over sets of twenty drives: "rmse" of the '
        'position (m), NEES of the pose after the "first" step and at the end, "nees"; the '
        '"map" (m), and the share of it "inside" the 95 % ellipses'
    ),
    "range_trial": (
        'fixed and adaptive ranges over 20 fields of trees: "seen" (landmarks at once), '
        '"error" (root mean square of fifty flights, m), "nees" (mean of the pose at the '
        'end), shares of the steps with a range "beyond" 15 m and with "none" seen'
    ),
    "return_variants": (
        'ways home of chapter 20 with one thing changed: how far "off" the marker a robot '
        'ends ("along" and "across" the corridor), and as "believed"; how far cut loops have '
        '"carried" the marker, and the end "apart" from that; the errors at the far end, "far '
        'along" and "far across", or "off" and the claimed "sigma"; or how long its "path" home '
        "is (m)"
    ),
    "rough_ground": (
        'Gamma-SLAM over twenty grounds: of ten "pictures" the 95 % intervals that "held" the '
        'true place, also "smoothed", by a "power 0.3" (0.1, 0.03), "of 60" (1000) particles, '
        'of two worlds with "L 1 km" (1 m, 10 cm, 1 cm, 1 mm) and their "best" places (m) '
        'with the "roll" of the camera (rad), of one "by E"; "maps": error of the best place '
        '(m) by map, and "held, height" ("held, height, plane fitted"); "drives": "error" of '
        'the path (m), "nees" and "parents" (medians)'
    ),
    "short_range": (
        'EKF-SLAM by its Jacobians and how far it sees, over 20 fields: "seen", "error" and '
        '"nees" as in "range_trial"'
    ),
    "signatures": (
        'answers of a database of scans: "places" in it, median error of the place ("off", '
        'pixels) and heading ("turn", degrees), "wrong" and "flagged" (%); of six robots '
        'whose particles start there, how many have "begun", a "wrong" start, are "lost", are '
        '"lost from a right start"'
    ),
    "slip": (
        'EKF-SLAM by the noise of the wheels (rad/s), over sets of ten drives: "nees" at the '
        'end, "error" of the position (cm)'
    ),
    "start_heading": (
        "EKF-SLAM by the σ of the heading at the start (degrees), over sets of twenty drives: "
        '"nees" (invariant, mean of the steps) and its "end", "sigma" of the heading at the '
        'end (degrees), "nis" over its degrees of freedom'
    ),
    "tilted_flights": (
        "flights with an attitude that errs, by a plane and a filter of heights and by a "
        '"large" filter: "error" of the last position (m), its "nees", "trees" (m)'
    ),
    "time_updates": (
        "EKF-SLAM with and without the cross-covariance's time update, over sets of ten "
        'drives: "nees" of the pose, "error" of the position (m)'
    ),
}


def stored_runs(trial: str) -> dict[str, dict[str, dict[str, Array]]]:
    """Return the stored runs of a trial: of its tool in `tools/`, one number a seed.

    Parameters
    ----------
    trial : str
        A key of `slamlab.datasets.trials.TRIALS`, which says what its runs hold.

    Returns
    -------
    dict
        ``stored_runs(trial)[log][system]`` maps names to arrays of shape (number of seeds,).

    Examples
    --------
    >>> float(stored_runs("matching")["CSAIL"]["20 keyframes and closures"]["error"][0])
    0.089
    """
    if trial not in TRIALS:
        raise ValueError(f"trial: expected one of {', '.join(TRIALS)}, got {trial!r}")
    return stored(trial)


def stored(name: str) -> dict[str, dict[str, dict[str, Array]]]:
    """Read the runs of a file of ours: first word, second word, name, one number a seed."""
    text = (Path(__file__).parent / "data" / f"{name}.json").read_text()
    return {
        first: {
            second: {key: np.array([run.get(key, np.nan) for run in runs]) for key in runs[0]}
            for second, runs in rows.items()
        }
        for first, rows in json.loads(text).items()
    }
