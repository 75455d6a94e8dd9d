"""Stored trials: results over many seeds that are made apart and read by a page. Chapter 16."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from slamlab._checks import Array

__all__ = ["range_trial_runs"]


def range_trial_runs() -> dict[str, dict[str, dict[str, Array]]]:
    """Return the stored runs of `tools/range_trial.py`: fixed and adaptive ranges on 20 fields.

    Returns
    -------
    dict
        ``range_trial_runs()[field][range]`` maps "seen" (landmarks at once), "error" (root mean
        square of fifty flights, m) and "nees" (mean of the pose at the end) to one number a
        field. Fields: "clearing", on half of which three trees of four are felled, and "even".

    Examples
    --------
    >>> runs = range_trial_runs()["clearing"]
    >>> len(runs["fixed, 20 m"]["error"])
    20
    """
    stored = json.loads((Path(__file__).parent / "data" / "range_trial.json").read_text())
    return {
        field: {
            name: {key: np.array([row[key] for row in rows], float) for key in rows[0]}
            for name, rows in ranges.items()
        }
        for field, ranges in stored.items()
    }
