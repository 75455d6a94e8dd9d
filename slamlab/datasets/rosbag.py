"""ROS bags: laser scans and odometry of robots that run ROS 1 or 2, read without ROS.

Messages read: sensor_msgs/LaserScan and nav_msgs/Odometry. Needs the extra `maps` (rosbags).
Chapter 14.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab._optional import needed
from slamlab.geometry import between
from slamlab.logs import Log, ScanGeometry

__all__ = ["read_rosbag"]

_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
# Without wheels a step may be anything that a robot does between two scans.
_ANYTHING = np.diag(np.square([0.2, 0.1, 0.2]))
# Odometry pauses where its messages are farther apart than so many periods, and than so long (s).
_PERIODS, _PAUSE = 5.0, 0.5


def read_rosbag(
    path: str | Path, scan_topic: str | None = None, odometry_topic: str | None = None
) -> Log:
    """Read a bag: a ``.bag`` file of ROS 1, or a folder or file (.db3, .mcap) of ROS 2.

    The lidar is taken to look ahead from the middle of the body, as the frames of the bag are not
    read.

    Parameters
    ----------
    path : str or Path
    scan_topic, odometry_topic : str, optional
        Which topics; needed only where there are several of a kind.

    Returns
    -------
    Log
        A step a scan. `u` is the odometry's motion from scan to scan, for `robots.RelativePose`,
        between its messages by interpolation. Where there is no odometry, or it begins late, ends
        early or pauses, it is zero with a wide covariance, and a warning says in how many steps.
        Header stamps that are all zero give way to the times of recording.

    Raises
    ------
    ImportError
        If rosbags is not installed.
    ValueError
        If the bag is damaged, holds no scan, or several topics and none was named; if the layout
        of the beams changes, an orientation is no quaternion, or scans and odometry share no time.
    FileNotFoundError
        If there is no such file.
    """
    AnyReader = needed("rosbags.highlevel", "ROS bags", "maps", "rosbags").AnyReader
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise ValueError(f"{path}: expected a bag of ROS 2, a folder with a metadata.yaml in it")
    try:
        with AnyReader([path]) as bag:
            scans = _messages(bag, _SCAN, scan_topic, path)
            odometry = _messages(bag, _ODOMETRY, odometry_topic, path)
    except (ValueError, FileNotFoundError):
        raise
    except Exception as error:  # what the reader makes of damaged bytes has many names
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"{path.name}: the bag cannot be read ({reason})") from error
    if not scans:
        raise ValueError(f"{path.name}: expected at least one LaserScan, got none")
    return _log(scans, odometry, path.name)


def _messages(bag: Any, kind: str, topic: str | None, path: Path) -> list[tuple[float, Any]]:
    """Time stamps (s) and messages of one topic, in their order."""
    there = [one for one in bag.connections if one.msgtype == kind]
    names = sorted({one.topic for one in there})
    if topic is not None and topic not in names:
        raise ValueError(f"{path.name}: expected the topic {topic}, there are {names}")
    if topic is None and len(names) > 1:
        raise ValueError(f"{path.name}: expected the name of one of the topics {names}")
    chosen = [one for one in there if topic in (None, one.topic)]
    if not chosen:
        return []
    found = []
    for connection, recorded, raw in bag.messages(connections=chosen):
        message = bag.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        found.append((stamp.sec + 1e-9 * stamp.nanosec, 1e-9 * recorded, message))
    stamped = any(stamp for stamp, _, _ in found)
    times = [(stamp if stamped else recorded, message) for stamp, recorded, message in found]
    return sorted(times, key=lambda one: one[0])


def _log(scans: list[tuple[float, Any]], odometry: list[tuple[float, Any]], name: str) -> Log:
    first = scans[0][1]
    n = len(first.ranges)
    angles = first.angle_min + first.angle_increment * np.arange(n)
    for time, scan in scans:
        if len(scan.ranges) != n:
            raise ValueError(
                f"{name}: the scan at {time:.3f} s: expected {n} beams as in the first one, "
                f"got {len(scan.ranges)}"
            )
        for part in ("angle_min", "angle_increment", "range_max"):
            due, got = float(getattr(first, part)), float(getattr(scan, part))
            if abs(got - due) > 1e-6:
                raise ValueError(
                    f"{name}: the scan at {time:.3f} s: expected {part} {due:g} as in the first "
                    f"one, got {got:g}"
                )
    ranges = np.array([scan.ranges for _, scan in scans], dtype=np.float64)
    # REP 117: -inf is too near to measure, NaN an error, +inf nothing in reach.
    ranges[(ranges < float(first.range_min)) | (ranges < 0)] = np.nan
    ranges[ranges > float(first.range_max)] = np.inf
    times = np.array([time for time, _ in scans])
    u, cov = _motion(times, odometry, name)
    dt = np.diff(times, prepend=times[:1])
    scan = ScanGeometry(angles, float(first.range_max))
    return Log(times, u, dt, cov, ranges=ranges, scan=scan, controls="displacement")


def _motion(times: Array, odometry: list[tuple[float, Any]], name: str) -> tuple[Array, Array]:
    """Motion (n, 3) up to each scan and its covariances (n, 3, 3)."""
    u = np.zeros((len(times), 3))
    if len(odometry) < 2:
        return u, np.tile(_ANYTHING, (len(times), 1, 1))
    moments = np.array([time for time, _ in odometry])
    poses = np.array([_pose(message.pose.pose, f"{name}: {t:.3f} s") for t, message in odometry])
    heading = np.unwrap(poses[:, 2])
    at = [np.interp(times, moments, column) for column in (poses[:, 0], poses[:, 1], heading)]
    path = np.stack(at, axis=-1)
    u[1:] = between(path[:-1], path[1:])
    # As for CARMEN logs: 10 % of each motion, and 1 cm and 0.5 degrees besides.
    length = np.hypot(u[:, 0], u[:, 1])
    cov = np.zeros((len(u), 3, 3))
    cov[:, 0, 0] = cov[:, 1, 1] = (0.1 * length) ** 2 + 0.01**2
    cov[:, 2, 2] = (0.1 * u[:, 2]) ** 2 + np.deg2rad(0.5) ** 2
    known = _covered(times, moments)
    if not known.any():
        raise ValueError(
            f"{name}: expected scans and odometry of one time, got scans from {times[0]:.3f} to "
            f"{times[-1]:.3f} s and odometry from {moments[0]:.3f} to {moments[-1]:.3f} s"
        )
    blind = np.flatnonzero(~known[1:] | ~known[:-1]) + 1
    if len(blind):
        u[blind], cov[blind] = 0.0, _ANYTHING
        warnings.warn(f"{name}: no odometry in {len(blind)} of {len(u) - 1} steps", stacklevel=4)
    return u, cov


def _covered(times: Array, moments: Array) -> NDArray[np.bool_]:
    """Which scans have odometry on both sides, nearer than a few of its periods."""
    limit = max(_PERIODS * float(np.median(np.diff(moments))), _PAUSE)
    after = np.searchsorted(moments, times).clip(0, len(moments) - 1)
    before = np.searchsorted(moments, times, side="right").clip(1) - 1
    gap = np.abs(moments[after] - times) + np.abs(times - moments[before])
    return np.asarray(gap <= limit)


def _pose(pose: Any, where: str) -> tuple[float, float, float]:
    """Pose in the plane; the heading of a quaternion of any length but zero."""
    q = np.array([pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w])
    length = np.linalg.norm(q)
    if not 1e-6 < length < np.inf:
        raise ValueError(f"{where}: expected an orientation as a quaternion, got {q.tolist()}")
    x, y, z, w = q / length
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    return float(pose.position.x), float(pose.position.y), float(yaw)
