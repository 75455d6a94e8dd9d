"""Pose graphs as text: the g2o and TORO formats, and the lidar scans that ride along.

Format: Grisetti et al. 2011 (g2o), Grisetti et al. 2007 (TORO), CARMEN for ROBOTLASER1.
`PoseGraph.read_g2o` and `write_g2o` are the doors; chapter 00 starts from such a file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamlab._checks import Array, cut
from slamlab._files import read_bytes

__all__ = ["Scans"]

# Where the six numbers of a line stand in the upper triangle of the information matrix.
_G2O_ORDER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_TORO_ORDER = ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))
_POINT_ORDER = ((0, 0), (0, 1), (1, 1))
_LASER_HEADER = 8  # type, start, field of view, resolution, range, accuracy, remission, count


@dataclass(frozen=True, eq=False)
class Scans:
    """Lidar scans of a pose graph, as its file gives them (ROBOTLASER1 lines).

    Attributes
    ----------
    rows : ndarray of int, shape (k,)
        Row of the pose from which each scan was taken.
    ranges : ndarray, shape (k, n_beams)
        Measured ranges (m). A range of `max_range` or more is a beam that met nothing.
    angles : ndarray, shape (n_beams,)
        Beam directions in the frame of the body (rad).
    max_range : float
        Range (m) from which a reading means "nothing seen".
    odometry : ndarray, shape (k, 3)
        Pose of the lidar in the world by odometry, when the scan was taken.
    timestamps : ndarray, shape (k,)
        Seconds.
    lines : tuple of str, length k
        The lines themselves; writing gives them back unchanged.
    """

    rows: np.ndarray
    ranges: Array
    angles: Array
    max_range: float
    odometry: Array
    timestamps: Array
    lines: tuple[str, ...]


class _Vertices(NamedTuple):
    """Vertices of one kind: in which line of the file each id stands, and their numbers."""

    lines: dict[int, int]
    values: list[list[float]]


class _Edges(NamedTuple):
    """Edges of one kind, by vertex id, and in which line of the file each stands."""

    pairs: list[tuple[int, int]]
    measurements: list[list[float]]
    information: list[list[list[float]]]
    lines: list[int]

    def arguments(self, size: int, first: dict[int, int], second: dict[int, int]) -> list[Any]:
        """Rows of the vertices, measurements (m, size) and information (m, size, size)."""
        rows = [(first[i], second[j]) for i, j in self.pairs]
        information = np.reshape(self.information, (-1, size, size))
        return [rows, np.reshape(self.measurements, (-1, size)), information]


class _Parser:
    """Reads line by line; remembers the line number for every complaint."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.number = 0
        self.poses, self.points = _Vertices({}, []), _Vertices({}, [])
        self.edges, self.observations = _Edges([], [], [], []), _Edges([], [], [], [])
        self.fixed: list[tuple[int, int]] = []  # id, line
        self.scan_numbers: dict[int, list[float]] = {}  # by the row of the pose
        self.scan_lines: list[str] = []
        self.tags: dict[str, Callable[[list[str]], None]] = {
            "VERTEX_SE2": lambda words: self.vertex(words, self.poses, 3),
            "VERTEX2": lambda words: self.vertex(words, self.poses, 3),
            "EDGE_SE2": lambda words: self.edge(words, self.edges, _G2O_ORDER),
            "EDGE2": lambda words: self.edge(words, self.edges, _TORO_ORDER),
            "VERTEX_XY": lambda words: self.vertex(words, self.points, 2),
            "EDGE_SE2_XY": lambda words: self.edge(words, self.observations, _POINT_ORDER),
            "FIX": self.fix,
            "ROBOTLASER1": self.scan,
        }

    def error(self, message: str, number: int | None = None) -> ValueError:
        return ValueError(f"{self.name}: line {number or self.number}: {message}")

    def line(self, text: str) -> None:
        words = text.split()
        if not words or words[0].startswith("#"):
            return
        if words[0] not in self.tags:
            known = ", ".join(self.tags)
            raise self.error(f"expected one of {known}, got {words[0][:40]!r}")
        if words[0] == "ROBOTLASER1":
            self.scan_lines.append(text.strip())
        self.tags[words[0]](words)

    def whole(self, word: str) -> int:
        if not (word.isascii() and word.isdecimal()):
            raise self.error(f"expected a vertex id (a whole number), got {word[:40]!r}")
        if len(word) > 18:
            raise self.error(f"expected a vertex id below 1e18, got {word[:40]!r}")
        return int(word)

    def floats(self, words: list[str]) -> list[float]:
        try:
            numbers = [float(word) for word in words]
        except ValueError as error:
            raise self.error(f"expected numbers, {cut(error)}") from error
        if not all(map(isfinite, numbers)):
            raise self.error("expected finite numbers, got NaN or infinity")
        text = "".join(words)
        if "_" in text or not text.isascii():
            raise self.error("expected plain decimal numbers")
        return numbers

    def words_expected(self, words: list[str], count: int) -> None:
        if len(words) != count:
            raise self.error(
                f"{words[0]}: expected {count - 1} fields, got {len(words) - 1} (truncated line?)"
            )

    def vertex(self, words: list[str], vertices: _Vertices, size: int) -> None:
        self.words_expected(words, 2 + size)
        identity = self.whole(words[1])
        for kind in (self.poses, self.points):
            if identity in kind.lines:
                first = kind.lines[identity]
                raise self.error(f"vertex {identity} was already defined in line {first}")
        vertices.lines[identity] = self.number
        vertices.values.append(self.floats(words[2:]))

    def edge(self, words: list[str], edges: _Edges, order: tuple[tuple[int, int], ...]) -> None:
        size = 1 + max(order)[0]
        self.words_expected(words, 3 + size + len(order))
        i, j = self.whole(words[1]), self.whole(words[2])
        if i == j and edges is self.edges:
            raise self.error(f"edge joins vertex {i} with itself")
        numbers = self.floats(words[3:])
        information = [[0.0] * size for _ in range(size)]
        for (row, column), number in zip(order, numbers[size:], strict=True):
            information[row][column] = information[column][row] = number
        edges.pairs.append((i, j))
        edges.measurements.append(numbers[:size])
        edges.information.append(information)
        edges.lines.append(self.number)

    def fix(self, words: list[str]) -> None:
        if len(words) < 2:
            raise self.error("FIX: expected at least one vertex id")
        for word in words[1:]:
            self.fixed.append((self.whole(word), self.number))

    def scan(self, words: list[str]) -> None:
        if not self.poses.lines:
            raise self.error("ROBOTLASER1: expected a vertex before the first scan")
        if len(words) < 1 + _LASER_HEADER:
            raise self.error("ROBOTLASER1: truncated header")
        n_beams = self.whole(words[_LASER_HEADER])
        after = 1 + _LASER_HEADER + n_beams
        if len(words) <= after:
            raise self.error(f"ROBOTLASER1: expected {n_beams} ranges, the line is truncated")
        after += 1 + self.whole(words[after])
        # Then lidar pose (3), body pose (3), five settings, time, host name, logger time.
        self.words_expected(words, after + 14)
        numbers = self.floats([*words[1 : after + 12], words[after + 13]])
        first = next(iter(self.scan_numbers.values()), numbers)
        if numbers[:_LASER_HEADER] != first[:_LASER_HEADER]:
            raise self.error("ROBOTLASER1: expected the same lidar as in the scans before")
        row = len(self.poses.lines) - 1
        if row in self.scan_numbers:
            raise self.error(f"ROBOTLASER1: second scan of vertex {list(self.poses.lines)[row]}")
        tail = after - 1
        self.scan_numbers[row] = (
            numbers[: _LASER_HEADER + n_beams] + numbers[tail : tail + 3] + [numbers[tail + 11]]
        )

    def finish(self) -> dict[str, Any]:
        """Check what only the whole file tells; return the arguments of `PoseGraph`."""
        edges, observations = self.edges, self.observations
        poses, points = self.poses.lines, self.points.lines
        if not poses:
            raise self.error("the file ends without a vertex")
        if not edges.pairs and not observations.pairs:
            raise self.error("the file ends without an edge")
        for (i, j), number in zip(edges.pairs, edges.lines, strict=True):
            self.defined(i, poses, number)
            self.defined(j, poses, number)
        for (i, j), number in zip(observations.pairs, observations.lines, strict=True):
            self.defined(i, poses, number)
            self.defined(j, points, number, "landmark")
        for identity, number in self.fixed:
            if identity not in poses:
                raise self.error(f"FIX {identity}: the vertex is not defined", number)
        reached = {identity for pair in edges.pairs + observations.pairs for identity in pair}
        for identity, number in (poses | points).items():
            if identity not in reached:
                raise self.error(f"no edge reaches vertex {identity} (truncated file?)", number)
        self.check_information(edges)
        self.check_information(observations)
        row = {identity: k for k, identity in enumerate(poses)}
        spot = {identity: k for k, identity in enumerate(points)}
        names = ("edges", "measurements", "information")
        return {
            "poses": self.poses.values,
            "ids": list(poses),
            "fixed": [row[identity] for identity, _ in self.fixed] or (0,),
            "scans": self.scans(),
            "landmarks": np.reshape(self.points.values, (-1, 2)),
            "landmark_ids": list(points),
            **dict(zip(names, edges.arguments(3, row, row), strict=True)),
            **{
                f"landmark_{name}": value
                for name, value in zip(names, observations.arguments(2, row, spot), strict=True)
            },
        }

    def defined(
        self, identity: int, where: dict[int, int], number: int, kind: str = "pose"
    ) -> None:
        if identity in where:
            return
        if identity in self.poses.lines or identity in self.points.lines:
            raise self.error(f"vertex {identity} is no {kind}, as this edge needs", number)
        kind = "vertex" if kind == "pose" else kind
        raise self.error(f"edge to {kind} {identity}, which is not defined", number)

    def check_information(self, edges: _Edges) -> None:
        if not edges.pairs:
            return
        information = np.array(edges.information)
        scale = np.abs(information).max(axis=(1, 2))
        smallest = np.linalg.eigvalsh(information)[:, 0]
        bad = np.flatnonzero(~(smallest >= -1e-9 * scale))
        if bad.size:
            raise self.error(
                "expected a positive semi-definite information matrix, "
                f"smallest eigenvalue is {smallest[bad[0]]:.3g}",
                edges.lines[bad[0]],
            )

    def scans(self) -> Scans | None:
        if not self.scan_numbers:
            return None
        numbers = np.array(list(self.scan_numbers.values()))
        _, start, _, resolution, max_range = numbers[0, :5]
        n_beams = numbers.shape[1] - _LASER_HEADER - 4
        return Scans(
            rows=np.array(list(self.scan_numbers)),
            ranges=numbers[:, _LASER_HEADER:-4],
            angles=start + resolution * np.arange(n_beams),
            max_range=float(max_range),
            odometry=numbers[:, -4:-1],
            timestamps=numbers[:, -1],
            lines=tuple(self.scan_lines),
        )


def parse(text: str, name: str = "text") -> dict[str, Any]:
    """Arguments of `PoseGraph` of a g2o or TORO text; `name` begins every error message.

    Raises
    ------
    ValueError
        With the number of the offending line.
    """
    parser = _Parser(name)
    for parser.number, line in enumerate(text.split("\n"), start=1):
        parser.line(line)
    return parser.finish()


def read(path: str | Path) -> dict[str, Any]:
    """Arguments of `PoseGraph` of a file; a ``.gz`` or ``.zip`` is opened on the way.

    Raises
    ------
    ValueError
        If the file is damaged; the message names the line, or the archive.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    data = read_bytes(path, _is_graph)
    # A byte that is no text survives as a surrogate, and the line that holds it is refused.
    return parse(data.decode("utf-8-sig", errors="surrogateescape"), path.name)


def _is_graph(member: str) -> bool:
    return member.endswith((".g2o", ".toro", ".graph")) and not member.startswith("__MACOSX")


def write(path: str | Path, graph: Any) -> None:
    """Write a `PoseGraph` as g2o text; every number is written so that it reads back exactly."""
    scans, names, points = graph.scans, graph.ids.tolist(), graph.landmark_ids.tolist()
    scan_of = {} if scans is None else dict(zip(scans.rows.tolist(), scans.lines, strict=True))
    with Path(path).open("w", encoding="utf-8", errors="surrogateescape", newline="\n") as file:
        for row, (name, pose) in enumerate(zip(names, graph.poses.tolist(), strict=True)):
            file.write(f"VERTEX_SE2 {name} {_numbers(pose)}\n")
            if row in scan_of:
                file.write(scan_of[row] + "\n")
        for name, point in zip(points, graph.landmarks.tolist(), strict=True):
            file.write(f"VERTEX_XY {name} {_numbers(point)}\n")
        for row in graph.fixed if graph.fixed != (0,) else ():
            file.write(f"FIX {names[row]}\n")
        for tag, ends, kind in (("EDGE_SE2", names, ""), ("EDGE_SE2_XY", points, "landmark_")):
            parts = ("edges", "measurements", "information")
            for (i, j), z, Omega in zip(*(getattr(graph, kind + p) for p in parts), strict=True):
                upper = Omega[np.triu_indices(len(z))]  # row by row
                file.write(f"{tag} {names[i]} {ends[j]} {_numbers([*z, *upper])}\n")


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
