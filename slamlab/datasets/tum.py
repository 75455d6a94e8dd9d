"""Trajectories as the TUM benchmark writes them, the exchange format of evo and others.

A line is ``time x y z qx qy qz qw`` (Sturm et al. 2012); ours stay in the plane.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array
from slamlab.datasets.relations import line_of, numbers_of
from slamlab.geometry import wrap_angle

__all__ = ["read_tum", "write_tum"]

_FLAT = 1e-3


def read_tum(path: str | Path) -> tuple[Array, Array]:
    r"""Read a trajectory of the plane.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    times : ndarray, shape (n,)
        Seconds.
    poses : ndarray, shape (n, 3)
        x, y (m), theta (rad).

    Raises
    ------
    ValueError
        If a line is damaged, a quaternion has no length, or the path leaves the plane: z changes,
        or the body tilts, by more than a thousandth (m, rad).
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "poses.tum"
    >>> _ = path.write_text("12.5 1 2 0 0 0 0 1\n")
    >>> times, poses = read_tum(path)
    >>> times.tolist(), poses.tolist()
    ([12.5], [[1.0, 2.0, 0.0]])
    """
    path = Path(path)
    text = path.read_text(encoding="utf-8", errors="replace")
    table = numbers_of(text, path.name, 8)
    q = table[:, 4:]
    with np.errstate(over="ignore"):  # beyond all numbers is refused below
        length = np.linalg.norm(q, axis=1)
        rise = np.abs(table[:, 3] - table[0, 3])
    bad = np.flatnonzero(np.abs(length - 1) > _FLAT)
    if bad.size:
        raise ValueError(
            f"{path.name}: line {line_of(text, bad[0])}: expected a quaternion of length 1, "
            f"got {length[bad[0]]:.4g}"
        )
    off = np.maximum(rise, 2 * np.hypot(q[:, 0], q[:, 1]))
    bad = np.flatnonzero(off > _FLAT)
    if bad.size:
        raise ValueError(
            f"{path.name}: line {line_of(text, bad[0])}: expected a path in the plane, "
            "it rises or tilts"
        )
    theta = wrap_angle(2 * np.arctan2(q[:, 2], q[:, 3]))
    return table[:, 0].copy(), np.column_stack([table[:, 1:3], theta])


def write_tum(path: str | Path, times: ArrayLike, poses: ArrayLike) -> None:
    """Write a trajectory; `read_tum` gives it back.

    Parameters
    ----------
    path : str or Path
    times : array_like, shape (n,)
        Seconds.
    poses : array_like, shape (n, 3)
        x, y (m), theta (rad).

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "poses.tum"
    >>> write_tum(path, [0.0, 0.5], [[0, 0, 0], [1.0, 2.0, 0.5]])
    >>> read_tum(path)[1].round(6).tolist()
    [[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]]
    """
    times = as_array("times", times, ("n",))
    poses = as_array("poses", poses, (len(times), 3))
    half = poses[:, 2] / 2
    zero = np.zeros(len(times))
    table = np.column_stack(
        [times, poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half)]
    ).tolist()
    lines = [" ".join(repr(number) for number in row) for row in table]
    Path(path).write_text("".join(line + "\n" for line in lines), encoding="utf-8")
