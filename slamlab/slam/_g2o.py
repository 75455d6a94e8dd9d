"""Pose graphs as text: the g2o and TORO formats, and the lidar scans that ride along.

Format: Grisetti et al. 2011 (g2o), Grisetti et al. 2007 (TORO), CARMEN for ROBOTLASER1.
`slamlab.slam.graph` calls `read` and `write`; chapter 00 starts from such a file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np

from slamlab._checks import Array, cut
from slamlab._files import read_bytes

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


@dataclass
class Links:
    """Edges of one kind, by vertex id, and in which line of the file each stands."""

    pairs: list[tuple[int, int]] = field(default_factory=list)
    measurements: list[list[float]] = field(default_factory=list)
    information: list[list[list[float]]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


@dataclass
class Content:
    """What one file holds: vertices in the order of the file; `observations` are of points."""

    ids: list[int] = field(default_factory=list)
    poses: list[list[float]] = field(default_factory=list)
    edges: Links = field(default_factory=Links)
    fixed: list[int] = field(default_factory=list)
    scans: Scans | None = None
    point_ids: list[int] = field(default_factory=list)
    points: list[list[float]] = field(default_factory=list)
    observations: Links = field(default_factory=Links)


class _Parser:
    """Reads line by line; remembers the line number for every complaint."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.number = 0
        self.content = content = Content()
        # The line in which each of them is defined.
        self.poses: dict[int, int] = {}
        self.points: dict[int, int] = {}
        self.fix_lines: list[int] = []
        self.scan_rows: list[int] = []
        self.scan_numbers: list[list[float]] = []
        self.scan_lines: list[str] = []
        self.tags: dict[str, Callable[[list[str]], None]] = {
            "VERTEX_SE2": self.vertex,
            "VERTEX2": self.vertex,
            "EDGE_SE2": lambda words: self.edge(words, content.edges, _G2O_ORDER),
            "EDGE2": lambda words: self.edge(words, content.edges, _TORO_ORDER),
            "VERTEX_XY": self.point,
            "EDGE_SE2_XY": lambda words: self.edge(words, content.observations, _POINT_ORDER),
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

    def vertex(self, words: list[str]) -> None:
        self.words_expected(words, 5)
        self.content.ids.append(self.new_vertex(words[1], self.poses))
        self.content.poses.append(self.floats(words[2:]))

    def new_vertex(self, word: str, lines: dict[int, int]) -> int:
        identity = self.whole(word)
        first = self.poses.get(identity, self.points.get(identity))
        if first is not None:
            raise self.error(f"vertex {identity} was already defined in line {first}")
        lines[identity] = self.number
        return identity

    def point(self, words: list[str]) -> None:
        self.words_expected(words, 4)
        self.content.point_ids.append(self.new_vertex(words[1], self.points))
        self.content.points.append(self.floats(words[2:]))

    def edge(self, words: list[str], links: Links, order: tuple[tuple[int, int], ...]) -> None:
        size = 1 + max(order)[0]
        self.words_expected(words, 3 + size + len(order))
        i, j = self.whole(words[1]), self.whole(words[2])
        if i == j and links is self.content.edges:
            raise self.error(f"edge joins vertex {i} with itself")
        numbers = self.floats(words[3:])
        information = [[0.0] * size for _ in range(size)]
        for (row, column), number in zip(order, numbers[size:], strict=True):
            information[row][column] = information[column][row] = number
        links.pairs.append((i, j))
        links.measurements.append(numbers[:size])
        links.information.append(information)
        links.lines.append(self.number)

    def fix(self, words: list[str]) -> None:
        if len(words) < 2:
            raise self.error("FIX: expected at least one vertex id")
        for word in words[1:]:
            self.content.fixed.append(self.whole(word))
            self.fix_lines.append(self.number)

    def scan(self, words: list[str]) -> None:
        if not self.content.ids:
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
        if self.scan_numbers and numbers[:_LASER_HEADER] != self.scan_numbers[0][:_LASER_HEADER]:
            raise self.error("ROBOTLASER1: expected the same lidar as in the scans before")
        row = len(self.content.ids) - 1
        if self.scan_rows and self.scan_rows[-1] == row:
            raise self.error(f"ROBOTLASER1: second scan of vertex {self.content.ids[row]}")
        self.scan_rows.append(row)
        tail = after - 1
        self.scan_numbers.append(
            numbers[: _LASER_HEADER + n_beams] + numbers[tail : tail + 3] + [numbers[tail + 11]]
        )

    def finish(self) -> Content:
        content = self.content
        if not content.ids:
            raise self.error("the file ends without a vertex")
        edges, observations = content.edges, content.observations
        if not edges.pairs and not observations.pairs:
            raise self.error("the file ends without an edge")
        for (i, j), number in zip(edges.pairs, edges.lines, strict=True):
            self.defined(i, self.poses, number)
            self.defined(j, self.poses, number)
        for (i, j), number in zip(observations.pairs, observations.lines, strict=True):
            self.defined(i, self.poses, number)
            self.defined(j, self.points, number, "landmark")
        for identity, number in zip(content.fixed, self.fix_lines, strict=True):
            if identity not in self.poses:
                raise self.error(f"FIX {identity}: the vertex is not defined", number)
        reached = {identity for pair in edges.pairs + observations.pairs for identity in pair}
        for identity, number in (self.poses | self.points).items():
            if identity not in reached:
                raise self.error(f"no edge reaches vertex {identity} (truncated file?)", number)
        self.check_information(edges)
        self.check_information(observations)
        content.scans = self.scans()
        return content

    def defined(
        self, identity: int, where: dict[int, int], number: int, kind: str = "pose"
    ) -> None:
        if identity in where:
            return
        if identity in self.poses or identity in self.points:
            raise self.error(f"vertex {identity} is no {kind}, as this edge needs", number)
        kind = "vertex" if kind == "pose" else kind
        raise self.error(f"edge to {kind} {identity}, which is not defined", number)

    def check_information(self, links: Links) -> None:
        if not links.pairs:
            return
        information = np.array(links.information)
        scale = np.abs(information).max(axis=(1, 2))
        smallest = np.linalg.eigvalsh(information)[:, 0]
        bad = np.flatnonzero(~(smallest >= -1e-9 * scale))
        if bad.size:
            raise self.error(
                "expected a positive semi-definite information matrix, "
                f"smallest eigenvalue is {smallest[bad[0]]:.3g}",
                links.lines[bad[0]],
            )

    def scans(self) -> Scans | None:
        if not self.scan_rows:
            return None
        numbers = np.array(self.scan_numbers)
        _, start, _, resolution, max_range = numbers[0, :5]
        n_beams = numbers.shape[1] - _LASER_HEADER - 4
        return Scans(
            rows=np.array(self.scan_rows),
            ranges=numbers[:, _LASER_HEADER:-4],
            angles=start + resolution * np.arange(n_beams),
            max_range=float(max_range),
            odometry=numbers[:, -4:-1],
            timestamps=numbers[:, -1],
            lines=tuple(self.scan_lines),
        )


def parse(text: str, name: str = "text") -> Content:
    """Content of a g2o or TORO text; `name` begins every error message.

    Raises
    ------
    ValueError
        With the number of the offending line.
    """
    parser = _Parser(name)
    for parser.number, line in enumerate(text.split("\n"), start=1):
        parser.line(line)
    return parser.finish()


def read(path: str | Path) -> Content:
    """Content of a file; a ``.gz`` or ``.zip`` is opened on the way.

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


def write(path: str | Path, content: Content) -> None:
    """Write `content` as g2o text; every number is written so that it reads back exactly."""
    scans = content.scans
    scan_of = {} if scans is None else dict(zip(scans.rows.tolist(), scans.lines, strict=True))
    with Path(path).open("w", encoding="utf-8", errors="surrogateescape", newline="\n") as file:
        for row, (identity, pose) in enumerate(zip(content.ids, content.poses, strict=True)):
            file.write(f"VERTEX_SE2 {identity} {_numbers(pose)}\n")
            if row in scan_of:
                file.write(scan_of[row] + "\n")
        for identity, point in zip(content.point_ids, content.points, strict=True):
            file.write(f"VERTEX_XY {identity} {_numbers(point)}\n")
        for identity in content.fixed:
            file.write(f"FIX {identity}\n")
        for tag, links in ("EDGE_SE2", content.edges), ("EDGE_SE2_XY", content.observations):
            each = zip(links.pairs, links.measurements, links.information, strict=True)
            for (i, j), z, information in each:
                upper = [number for k, row in enumerate(information) for number in row[k:]]
                file.write(f"{tag} {i} {j} {_numbers([*z, *upper])}\n")


def _numbers(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
