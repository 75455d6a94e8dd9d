"""CARMEN log files: laser scans and odometry of real robots, as the Radish archive keeps them.

Lines read: FLASER, RLASER, ROBOTLASER1, ODOM, PARAM; ``#`` begins a comment. Chapter 08.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamlab._checks import Array, as_positive
from slamlab._files import about, read_bytes
from slamlab.geometry import between
from slamlab.logs import Log, ScanGeometry

__all__ = ["read_carmen"]

# Tags of CARMEN (and of GMapping, NEFF) without a front scan or odometry; they are passed over.
_IGNORED = {"SYNC", "RLASER", "SONAR", "TRUEPOS", "GPS", "NMEAGGA", "NMEARMC", "IMU", "NEFF"}
_NO_RETURN = 50.0


@dataclass(frozen=True)
class _Scan:
    ranges: list[float]
    pose: list[float]
    timestamp: float
    angles: Array
    max_range: float | None


def read_carmen(
    path: str | Path,
    field_of_view: float = np.pi,
    *,
    max_range: float | None = None,
    corrected: bool = False,
) -> Log:
    r"""Read the scans and the odometry of a CARMEN log, plain or ``.gz``.

    The motion of a step is that between the poses of two scans as the log gives them, so that
    `robots.RelativePose` is its motion model. Readings of `max_range` and more are beams that met
    nothing (inf); ``notes["beyond"]`` counts those of each scan.

    Parameters
    ----------
    path : str or Path
    field_of_view : float, default pi
        Opening of FLASER scans (rad), which the format does not write down; their first beam
        looks to the right. ROBOTLASER1 lines carry their own.
    max_range : float, optional
        Range (m) of FLASER scans that means "nothing". Without it a ``PARAM ...laser_max`` line of
        the log decides, else 50 m.
    corrected : bool, default False
        Whether the poses in the log are already corrected (the Radish archive has such logs):
        then they are kept as `truth` as well.

    Returns
    -------
    Log
        A step a scan; `control_cov` is 10 % of each motion and 1 cm, 0.5 degrees besides, squared:
        the format says nothing of its odometry.

    Raises
    ------
    ValueError
        For a line that breaks the format, with its number: an unknown tag, a missing or extra
        field, no finite number, a negative range, another number of beams than before; for a
        damaged ``.gz``; for a log without any scan.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "robot.log"
    >>> _ = path.write_text("FLASER 3 1.0 81.9 2.0 0 0 0 0 0 0 7.5 host 7.5\n")
    >>> log = read_carmen(path)
    >>> log.ranges.tolist(), log.scan.beam_angles.round(3).tolist()
    ([[1.0, inf, 2.0]], [-1.571, 0.0, 1.571])
    """
    field_of_view = as_positive("field_of_view", field_of_view, 2 * np.pi)
    limit = None if max_range is None else as_positive("max_range", max_range)
    scans: list[_Scan] = []
    for number, line in enumerate(_lines(Path(path)), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#") or fields[0] in _IGNORED:
            continue
        with about(f"{path}, line {number}"):
            if fields[0] == "ODOM":
                _check_odom(fields)
            elif fields[0] == "PARAM":
                limit = _laser_max(fields) if limit is None else limit
            elif fields[0] == "FLASER":
                scans.append(_flaser(fields, field_of_view))
            elif fields[0] == "ROBOTLASER1":
                scans.append(_robotlaser(fields))
            else:
                raise ValueError(f"expected a CARMEN tag such as FLASER or ODOM, got {_cut(line)}")
            _same_beams(scans)
    if not scans:
        raise ValueError(f"{path}: expected at least one FLASER or ROBOTLASER1 line, got none")
    with about(str(path)):
        return _log(scans, _NO_RETURN if limit is None else limit, corrected)


def _lines(path: Path) -> list[str]:
    data = read_bytes(path)
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
            raise ValueError(f"expected a finite number, got {field[:40]}")
        values.append(value)
    return values


def _cut(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...")


def _count(field: str) -> int:
    if not (field.isascii() and field.isdigit()) or len(field) > 6:
        raise ValueError(f"expected a number of readings, got {_cut(field)}")
    return int(field)


def _check_odom(fields: list[str]) -> None:
    # ODOM x y theta tv rv accel ipc_timestamp hostname logger_timestamp: scans carry their pose.
    if len(fields) != 10:
        raise ValueError(f"expected 10 fields in ODOM, got {len(fields)}")
    _numbers([*fields[1:8], fields[9]])


def _laser_max(fields: list[str]) -> float | None:
    # PARAM laser_front_laser_max 81.9 ...: names differ, all end in laser_max.
    if len(fields) < 3 or not fields[1].endswith("laser_max"):
        return None
    (value,) = _numbers(fields[2:3])
    if value <= 0:
        raise ValueError(f"expected a positive maximal range, got {value:g}")
    return value


def _ranges(fields: list[str]) -> list[float]:
    values = _numbers(fields)
    if min(values, default=0.0) < 0:
        raise ValueError(f"expected ranges, got {min(values):g}")
    return values


def _pose(values: list[float]) -> list[float]:
    # What follows squares differences of poses.
    if max(map(abs, values)) > 1e9:
        raise ValueError(f"expected a pose within 1e9 m, got {values}")
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
    return _Scan(_ranges(fields[2 : n + 2]), _pose(tail[:3]), tail[6], angles, None)


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
    return _Scan(_ranges(fields[9 : n + 9]), _pose(values[:3]), values[11], angles, max_range)


def _same_beams(scans: list[_Scan]) -> None:
    if len(scans) > 1 and not np.array_equal(scans[-1].angles, scans[0].angles):
        wanted = f"{len(scans[0].angles)} beams laid out as in the first scan"
        raise ValueError(f"expected {wanted}, got {len(scans[-1].angles)}")


def _log(scans: list[_Scan], limit: float, corrected: bool) -> Log:
    max_range = scans[0].max_range or limit
    ranges = np.array([scan.ranges for scan in scans])
    poses = np.array([scan.pose for scan in scans])
    motion = between(np.concatenate([poses[:1], poses[:-1]]), poses)
    times = np.array([scan.timestamp for scan in scans])
    size = np.linalg.norm(motion[:, :2], axis=1, keepdims=True)
    sigmas = np.hstack([0.1 * size + 0.01] * 2 + [0.1 * np.abs(motion[:, 2:]) + np.deg2rad(0.5)])
    sigmas[0] = 0.0
    return Log(
        times,
        motion,
        _durations(times),
        sigmas[:, :, None] ** 2 * np.eye(3),
        ranges=np.where(ranges < max_range, ranges, np.inf),
        scan=ScanGeometry(scans[0].angles, max_range),
        truth=poses if corrected else None,
        controls="displacement",
        notes={"beyond": (ranges >= max_range).sum(1)},
    )


def _durations(times: Array) -> Array:
    """Seconds between scans; where coarse time stamps stand still, the median of the others."""
    dt = np.diff(times, prepend=times[0])
    moving = dt[1:] > 0
    dt[1:][~moving] = np.median(dt[1:][moving]) if moving.any() else 1.0
    return dt
