"""Stored trials: results over many seeds, made apart and read by a page. Chapters 9 to 16."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from slamlab._checks import Array

__all__ = ["stored_runs"]


def stored_runs(trial: str) -> dict[str, dict[str, dict[str, Array]]]:
    """Return the stored runs of a trial: of its tool in `tools/`, one number a seed.

    Parameters
    ----------
    trial : str
        "grid_loops": grid FastSLAM round two corridors; 8 m before the lap is complete, "before"
        (error of the mean) and "spread" of the particles; at the end (m): "carried" there by the
        true motion, "nearest" of the particles carried so, and "end", and the same off the
        particles' own first laps: "apart", "apart nearest", "apart end"; "grid_logs": grid
        FastSLAM on two real logs, "error" of the path (m); "killian_walls": filters on the walls
        of nine parts of Killian Court, "error" of the position (m); "matching": scan matchers on
        the two logs, "error" of the path (m); "orchard": who decides which tree was observed,
        after a drive with the sensor off: "precision" and "recall" of the pairs, "end" (error, m);
        "orchard_returns": the same where the names are given until then, and "sigma" of the place
        on return (m); "park_start": Victoria Park's first 0.9 km by the factor on its odometry's
        variance, as `victoria_park_runs`; "park_twins": Victoria Park with measurements drawn
        anew, "trees", "error" of the path, "early" of its first 0.9 km (m); "printed_formulas":
        filters with formulas as P1 prints them, over sets of twenty drives: "rmse" of the position
        (m), NEES of the pose after the "first" step and at the end, "nees"; the "map" (m), and the
        share of it "inside" the 95 % ellipses; "range_trial": fixed and adaptive ranges over 20
        fields of trees: "seen" (landmarks at once), "error" (root mean square of fifty flights,
        m), "nees" (mean of the pose at the end), shares of the steps with a range "beyond" 15 m
        and with "none" seen; "rough_ground": of ten pictures of a drive, the 95 % intervals by
        Gamma-SLAM's likelihood that "held" the true place, also "smoothed", by a "power 0.3" (0.1,
        0.03), and "of 60" (1000) particles; "start_heading": EKF-SLAM by the σ of the heading at
        the start (degrees), over sets of twenty drives: "nees" (invariant, mean of the steps) and
        its "end", "sigma" of the heading at the end (degrees), "nis" over its degrees of freedom.

    Returns
    -------
    dict
        ``stored_runs(trial)[log][system]`` maps names to arrays of shape (number of seeds,).

    Examples
    --------
    >>> float(stored_runs("matching")["CSAIL"]["20 scans and closures"]["error"][0])
    0.088
    """
    names = (
        "grid_logs", "grid_loops", "killian_walls", "matching", "orchard", "orchard_returns",
        "park_start", "park_twins", "printed_formulas", "range_trial", "rough_ground",
        "start_heading",
    )  # fmt: skip
    if trial not in names:
        raise ValueError(f"trial: expected one of {', '.join(names)}, got {trial!r}")
    stored = json.loads((Path(__file__).parent / "data" / f"{trial}.json").read_text())
    return {
        first: {
            second: {key: np.array([run.get(key, np.nan) for run in runs]) for key in runs[0]}
            for second, runs in rows.items()
        }
        for first, rows in stored.items()
    }
