"""CARMEN log files: laser scans and odometry of real robots, as the Radish archive keeps them.

Lines read: FLASER, RLASER, ROBOTLASER1, ODOM, PARAM; ``#`` begins a comment. Chapter 08.
"""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamlab._checks import Array
from slamlab.sensors.scan import ScanGeometry

__all__ = ["CarmenLog", "read_carmen"]

# Tags of CARMEN (and of GMapping, NEFF) without a front scan or odometry; they are passed over.
_IGNORED = {
    "PARAM",
    "SYNC",
    "RLASER",
    "SONAR",
    "TRUEPOS",
    "GPS",
    "NMEAGGA",
    "NMEARMC",
    "IMU",
    "NEFF",
}
_NO_RETURN = 50.0


@dataclass(frozen=True, eq=False)
class CarmenLog:
    """Scans of one log, in the order of the file.

    Attributes
    ----------
    ranges : ndarray, shape (n, n_beams)
        Ranges (m); NaN where a beam met nothing.
    lidar : ScanGeometry
        Directions of the beams in the frame of the body (rad).
    poses : ndarray, shape (n, 3)
        Pose of the laser as the log gives it (in a "corrected" log, the corrected one).
    timestamps : ndarray, shape (n,)
        Seconds.
    odometry : ndarray, shape (k, 3)
        Poses of the ODOM lines.
    odometry_timestamps : ndarray, shape (k,)
        Seconds.
    """

    ranges: Array
    lidar: ScanGeometry
    poses: Array
    timestamps: Array
    odometry: Array
    odometry_timestamps: Array


@dataclass(frozen=True)
class _Scan:
    ranges: list[float]
    pose: list[float]
    timestamp: float
    angles: Array
    max_range: float


def read_carmen(path: str | Path, field_of_view: float = np.pi) -> CarmenLog:
    """Read the scans and the odometry of a CARMEN log, plain or ``.gz``.

    Parameters
    ----------
    path : str or Path
    field_of_view : float, default pi
        Opening of FLASER scans (rad), which the format does not write down; their first beam
        looks to the right. ROBOTLASER1 lines carry their own.

    Returns
    -------
    CarmenLog

    Raises
    ------
    ValueError
        For a line that breaks the format, with its number: an unknown tag, a missing or extra
        field, no finite number, a negative range, another number of beams than before; for a
        damaged ``.gz``; for a log without any scan.
    FileNotFoundError
        If there is no such file.
    """
    scans: list[_Scan] = []
    odometry: list[list[float]] = []
    lines = _lines(Path(path))
    for number, line in enumerate(lines, start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#") or fields[0] in _IGNORED:
            continue
        try:
            if fields[0] == "ODOM":
                odometry.append(_odom(fields))
            elif fields[0] == "FLASER":
                scans.append(_flaser(fields, field_of_view))
            elif fields[0] == "ROBOTLASER1":
                scans.append(_robotlaser(fields))
            else:
                raise ValueError(f"expected a CARMEN tag such as FLASER or ODOM, got {_cut(line)}")
            _same_beams(scans)
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: {error}") from error
    if not scans:
        raise ValueError(f"{path}: expected at least one FLASER or ROBOTLASER1 line, got none")
    return _log(scans, odometry)


def _lines(path: Path) -> list[str]:
    data = path.read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise ValueError(f"{path}: the gzip file is damaged ({error})") from error
    try:
        return data.decode("ascii").split("\n")
    except UnicodeDecodeError as error:
        number = data.count(b"\n", 0, error.start) + 1
        byte = data[error.start]
        raise ValueError(f"{path}, line {number}: expected ASCII, got byte {byte}") from error


def _numbers(fields: list[str]) -> list[float]:
    values = []
    for field in fields:
        try:
            value = float(field)
        except ValueError:
            raise ValueError(f"expected a number, got {_cut(field)}") from None
        if not np.isfinite(value):
            raise ValueError(f"expected a finite number, got {field}")
        values.append(value)
    return values


def _cut(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...")


def _count(field: str) -> int:
    if not (field.isascii() and field.isdigit()) or len(field) > 6:
        raise ValueError(f"expected a number of readings, got {_cut(field)}")
    return int(field)


def _odom(fields: list[str]) -> list[float]:
    # ODOM x y theta tv rv accel ipc_timestamp hostname logger_timestamp
    if len(fields) != 10:
        raise ValueError(f"expected 10 fields in ODOM, got {len(fields)}")
    values = _numbers([*fields[1:8], fields[9]])
    return [*values[:3], values[6]]


def _ranges(fields: list[str]) -> list[float]:
    values = _numbers(fields)
    if min(values, default=0.0) < 0:
        raise ValueError(f"expected ranges, got {min(values):g}")
    return values


def _flaser(fields: list[str], field_of_view: float) -> _Scan:
    # FLASER n r1..rn x y theta odom_x odom_y odom_theta ipc_timestamp hostname logger_timestamp
    n = _count(fields[1]) if len(fields) > 1 else 0
    if n == 0 or len(fields) != n + 11:
        raise ValueError(f"expected {n} ranges and 9 more fields in FLASER, got {len(fields) - 2}")
    tail = _numbers([*fields[n + 2 : n + 9], fields[n + 10]])
    # 180 readings in half a turn stand one degree apart, 181 and 361 reach both ends.
    step = field_of_view / (n if n % 2 == 0 else max(n - 1, 1))
    angles = -field_of_view / 2 + step * np.arange(n, dtype=np.float64)
    return _Scan(_ranges(fields[2 : n + 2]), tail[:3], tail[6], angles, _NO_RETURN)


def _robotlaser(fields: list[str]) -> _Scan:
    # ROBOTLASER1 type start fov resolution max_range accuracy remission_mode n r1..rn k m1..mk
    # laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv 3 more, timestamp host logger
    if len(fields) < 9:
        raise ValueError(f"expected at least 9 fields in ROBOTLASER1, got {len(fields)}")
    start, _, resolution, max_range, *_ = _numbers(fields[2:8])
    n = _count(fields[8])
    if n == 0 or len(fields) < n + 10:
        raise ValueError(f"expected {n} ranges in ROBOTLASER1, got {len(fields) - 9} fields")
    if max_range <= 0:
        raise ValueError(f"expected a positive maximal range, got {max_range:g}")
    k = _count(fields[n + 9])
    tail = fields[n + 10 + k :]
    if len(tail) != 14:
        raise ValueError(f"expected 14 fields after the readings, got {len(tail)}")
    _numbers(fields[n + 10 : n + 10 + k])
    values = _numbers([*tail[:12], tail[13]])
    angles = start + resolution * np.arange(n, dtype=np.float64)
    return _Scan(_ranges(fields[9 : n + 9]), values[:3], values[11], angles, max_range)


def _same_beams(scans: list[_Scan]) -> None:
    if len(scans) > 1 and not np.array_equal(scans[-1].angles, scans[0].angles):
        raise ValueError(
            f"expected {len(scans[0].angles)} beams laid out as in the first scan, "
            f"got {len(scans[-1].angles)}"
        )


def _log(scans: list[_Scan], odometry: list[list[float]]) -> CarmenLog:
    max_range = scans[0].max_range
    ranges = np.array([scan.ranges for scan in scans])
    odom = np.array(odometry).reshape(-1, 4)
    return CarmenLog(
        ranges=np.where(ranges < max_range, ranges, np.nan),
        lidar=ScanGeometry(scans[0].angles, max_range),
        poses=np.array([scan.pose for scan in scans]),
        timestamps=np.array([scan.timestamp for scan in scans]),
        odometry=odom[:, :3],
        odometry_timestamps=odom[:, 3],
    )
