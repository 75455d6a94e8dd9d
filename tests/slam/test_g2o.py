"""g2o and TORO files: read, written, and refused with the number of the line."""

import gzip
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slamlab.slam import PoseGraph

RTB = Path(pytest.importorskip("rtbdata").__file__).parent / "data"
SCAN = (
    "ROBOTLASER1 0 -1.570796 3.141593 1.570796 50.0 0.1 0 3 1.5 2.5 51.0 0 "
    "1 2 0.5 1 2 0.5 0 0 0 0 0 {time} iB21 0.5"
)
LINES = [
    "# a comment",
    "VERTEX_SE2 3 0 0 0",
    SCAN.format(time=100.25),
    "VERTEX_SE2 7 1.1 0 0.1",
    SCAN.format(time=101.5),
    "VERTEX_SE2 5 2.1 0.2 -0.1",
    "",
    "FIX 7",
    "EDGE_SE2 3 7 1 0.5 0.25 10 1 2 20 3 30",
    "EDGE_SE2 7 5 1 0 0 10 0 0 10 0 1e1",
    "EDGE_SE2 5 3 -2 0 0 10 0 0 10 0 10",
]


def read(tmp_path, text, name="graph.g2o"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogateescape"))
    return PoseGraph.read_g2o(path)


def read_lines(tmp_path, lines):
    return read(tmp_path, "\n".join(lines) + "\n")


def same(one, other):
    names = ("ids", "poses", "edges", "measurements", "information", "fixed")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def test_every_field_lands_where_it_belongs(tmp_path):
    graph = read_lines(tmp_path, LINES)
    assert graph.ids.tolist() == [3, 7, 5]
    assert graph.poses.tolist() == [[0, 0, 0], [1.1, 0, 0.1], [2.1, 0.2, -0.1]]
    assert graph.edges.tolist() == [[0, 1], [1, 2], [2, 0]]
    assert graph.measurements[0].tolist() == [1, 0.5, 0.25]
    assert graph.information[0].tolist() == [[10, 1, 2], [1, 20, 3], [2, 3, 30]]
    assert graph.fixed == (1,)
    scans = graph.scans
    assert scans.rows.tolist() == [0, 1]
    assert scans.ranges.tolist() == [[1.5, 2.5, 51.0]] * 2
    assert np.allclose(scans.angles, [-np.pi / 2, 0, np.pi / 2], atol=1e-5)
    assert scans.max_range == 50.0
    assert scans.odometry.tolist() == [[1, 2, 0.5]] * 2
    assert scans.timestamps.tolist() == [100.25, 101.5]


SEEN = [*LINES, "VERTEX_XY 9 2 1", "EDGE_SE2_XY 3 9 2 1 5 1 6", "EDGE_SE2_XY 5 9 0 1 5 0 6"]


def test_landmarks_are_read_and_written(tmp_path):
    graph = read_lines(tmp_path, SEEN)
    assert graph.landmark_ids.tolist() == [9]
    assert graph.landmarks.tolist() == [[2, 1]]
    assert graph.landmark_edges.tolist() == [[0, 0], [2, 0]]
    assert graph.landmark_measurements.tolist() == [[2, 1], [0, 1]]
    assert graph.landmark_information[0].tolist() == [[5, 1], [1, 6]]
    graph.write_g2o(tmp_path / "copy.g2o")
    copy = PoseGraph.read_g2o(tmp_path / "copy.g2o")
    assert same(graph, copy)
    for name in ("landmarks", "landmark_edges", "landmark_measurements", "landmark_information"):
        assert np.array_equal(getattr(graph, name), getattr(copy, name))
    assert copy.chi2() == graph.chi2() != read_lines(tmp_path, LINES).chi2()


@pytest.mark.parametrize(
    ("number", "line", "message"),
    [
        (11, "VERTEX_XY 7 2 1", "line 12: vertex 7 was already defined in line 4"),
        (11, "VERTEX_XY 9 2", "line 12: VERTEX_XY: expected 3 fields, got 2"),
        (12, "EDGE_SE2_XY 3 8 2 1 5 1 6", "line 13: edge to landmark 8, which is not defined"),
        (12, "EDGE_SE2_XY 3 7 2 1 5 1 6", "line 13: vertex 7 is no landmark, as this edge needs"),
        (12, "EDGE_SE2_XY 9 9 2 1 5 1 6", "line 13: vertex 9 is no pose"),
        (12, "EDGE_SE2_XY 3 9 2 1 1 5 1", "line 13: expected a positive semi-definite"),
        (13, "EDGE_SE2 3 9 1 0 0 1 0 0 1 0 1", "line 14: vertex 9 is no pose"),
    ],
)
def test_a_bad_landmark_line_is_named(tmp_path, number, line, message):
    with pytest.raises(ValueError, match=message):
        read_lines(tmp_path, [*SEEN[:number], line, *SEEN[number + 1 :]])


def test_a_landmark_that_nothing_sees_is_refused(tmp_path):
    with pytest.raises(ValueError, match="line 12: no edge reaches vertex 9"):
        read_lines(tmp_path, SEEN[:12])


def test_toro_has_its_own_order_of_information(tmp_path):
    # EDGE2 i j x y theta I_xx I_xy I_yy I_tt I_xt I_yt
    lines = ["VERTEX2 0 0 0 0", "VERTEX2 1 1 0 0", "EDGE2 0 1 1 0 0 10 1 2 30 0.5 1.5"]
    toro = read_lines(tmp_path, lines)
    assert toro.information[0].tolist() == [[10, 1, 0.5], [1, 2, 1.5], [0.5, 1.5, 30]]
    as_g2o = read_lines(tmp_path, [lines[0], lines[1], "EDGE_SE2" + lines[2][5:]])
    assert as_g2o.information[0].tolist() == [[10, 1, 2], [1, 30, 0.5], [2, 0.5, 1.5]]


def test_lines_may_interleave_in_any_order(tmp_path):
    rng = np.random.default_rng(0)
    right = read_lines(tmp_path, LINES).optimize()
    units = [[line] for line in LINES if not line.startswith(("VERTEX", "ROBOT", "#"))]
    units += [LINES[1:3], LINES[3:5], LINES[5:6]]  # a scan stays with its vertex
    for _ in range(20):
        graph = read_lines(tmp_path, sum((units[k] for k in rng.permutation(len(units))), []))
        assert (len(graph.poses), len(graph.edges), len(graph.scans.rows)) == (3, 3, 2)
        assert graph.ids[graph.fixed[0]] == 7
        assert graph.optimize().chi2 == pytest.approx(right.chi2, rel=1e-9)


@pytest.mark.parametrize("name", ["killian-small.toro", "killian.g2o.zip"])
def test_real_files_come_back_as_they_were_read(tmp_path, name):
    graph = PoseGraph.read_g2o(RTB / name)
    graph.write_g2o(tmp_path / "copy.g2o")
    copy = PoseGraph.read_g2o(tmp_path / "copy.g2o")
    assert same(graph, copy)
    assert (graph.scans is None) == (copy.scans is None)
    if graph.scans is not None:
        assert graph.scans.lines == copy.scans.lines
        assert np.array_equal(graph.scans.ranges, copy.scans.ranges)


def test_killian_court_brings_its_scans():
    graph = PoseGraph.read_g2o(RTB / "killian.g2o.zip")
    assert (len(graph.poses), len(graph.edges)) == (3873, 4987)
    scans = graph.scans
    assert scans.ranges.shape == (3873, 180)
    assert np.array_equal(scans.rows, np.arange(3873))
    assert scans.max_range == 50.0
    assert np.rad2deg(scans.angles[[0, -1]]).round(1).tolist() == [-90.0, 89.0]
    assert np.allclose(scans.odometry[0], graph.poses[0], atol=1e-4)
    assert (np.diff(scans.timestamps) > 0).mean() > 0.99


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_written_graphs_read_back_to_the_last_bit(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    edges = [(k, int(rng.integers(0, k))) for k in range(1, n)]
    root = rng.normal(size=(n - 1, 3, 3)) * 10.0 ** rng.integers(-3, 4)
    graph = PoseGraph(
        rng.normal(size=(n, 3)) * 1e5,
        edges,
        rng.normal(size=(n - 1, 3)) / 3,
        root @ np.swapaxes(root, 1, 2),
        ids=rng.permutation(10**6)[:n],
        fixed=rng.permutation(n)[: int(rng.integers(1, n + 1))].tolist(),
    )
    path = tmp_path_factory.mktemp("g2o") / "graph.g2o"
    graph.write_g2o(path)
    assert same(graph, PoseGraph.read_g2o(path))


def test_archives_are_opened(tmp_path):
    text = "\n".join(LINES).encode()
    plain = read(tmp_path, text)
    assert same(plain, read(tmp_path, gzip.compress(text), "graph.g2o.gz"))
    path = tmp_path / "graph.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("__MACOSX/._graph.g2o", b"Mac OS X")
        archive.writestr("graph.g2o", text)
    assert same(plain, PoseGraph.read_g2o(path))
    assert same(plain, read(tmp_path, b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n")))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("second.g2o", text)
    with pytest.raises(ValueError, match="expected one file to read"):
        PoseGraph.read_g2o(path)
    with pytest.raises(FileNotFoundError):
        PoseGraph.read_g2o(tmp_path / "nowhere.g2o")


CASES = {
    "line 2: VERTEX_SE2: expected 4 fields, got 3": (1, "VERTEX_SE2 3 0 0"),
    "line 2: expected one of VERTEX_SE2, .*, got 'VERTEX_SE3'": (1, "VERTEX_SE3 3 0 0"),
    "line 2: expected a vertex id .* got '-3'": (1, "VERTEX_SE2 -3 0 0 0"),
    "line 2: expected a vertex id .* got '1.5'": (1, "VERTEX_SE2 1.5 0 0 0"),
    "line 2: expected a vertex id below": (1, "VERTEX_SE2 1111111111111111111 0 0 0"),
    "line 2: expected numbers, .*'abc'": (1, "VERTEX_SE2 3 0 abc 0"),
    "line 2: expected plain decimal": (1, "VERTEX_SE2 3 0 1_0 0"),
    "line 2: expected finite numbers": (1, "VERTEX_SE2 3 0 nan 0"),
    "line 4: vertex 3 was already defined in line 2": (3, "VERTEX_SE2 3 1.1 0 0.1"),
    "line 8: FIX 8: the vertex is not defined": (7, "FIX 8"),
    "line 8: FIX: expected at least one": (7, "FIX"),
    "line 9: edge to vertex 4, which is not defined": (
        8,
        "EDGE_SE2 3 4 1 0 0 10 0 0 10 0 10",
    ),
    "line 9: edge joins vertex 3 with itself": (8, "EDGE_SE2 3 3 1 0 0 10 0 0 10 0 10"),
    "line 9: EDGE_SE2: expected 11 fields, got 10": (8, "EDGE_SE2 3 7 1 0 0 10 0 0 10 0"),
    "line 9: expected finite numbers": (8, "EDGE_SE2 3 7 1 0 0 10 0 0 1e999 0 1"),
    "line 9: expected a positive semi-definite information": (
        8,
        "EDGE_SE2 3 7 1 0 0 10 99 0 10 0 10",
    ),
    "line 1: ROBOTLASER1: expected a vertex before": (0, SCAN.format(time=1)),
    "line 5: ROBOTLASER1: expected the same lidar": (
        4,
        SCAN.format(time=1).replace(" 3 1.5", " 2"),
    ),
    "line 7: no edge reaches vertex 9": (6, "VERTEX_SE2 9 0 0 0"),
    "line 4: ROBOTLASER1: second scan of vertex 3": (3, SCAN.format(time=1)),
    "line 5: ROBOTLASER1: truncated header": (4, "ROBOTLASER1 0 1 2"),
    "line 5: ROBOTLASER1: expected 3 ranges": (4, " ".join(SCAN.split()[:11])),
    "line 5: ROBOTLASER1: expected 26 fields, got 20": (4, " ".join(SCAN.split()[:21])),
}


@pytest.mark.parametrize("message", CASES)
def test_a_bad_line_is_named_by_its_number(tmp_path, message):
    number, line = CASES[message]
    with pytest.raises(ValueError, match=re.compile(f"graph.g2o: {message}")):
        read_lines(tmp_path, [*LINES[:number], line, *LINES[number + 1 :]])


def test_a_file_without_a_graph_is_refused(tmp_path):
    for text in ("", "\n\n", "# nothing\n"):
        with pytest.raises(ValueError, match=r"line \d+: the file ends without a vertex"):
            read(tmp_path, text)
    with pytest.raises(ValueError, match="line 7: the file ends without an edge"):
        read_lines(tmp_path, LINES[:6])
    with pytest.raises(ValueError, match="line 1"):
        read(tmp_path, bytes(range(256)) * 4)


def test_a_graph_cut_off_among_its_edges_is_refused(tmp_path):
    lines = (RTB / "killian-small.toro").read_text().splitlines()
    n = sum(line.startswith("VERTEX2") for line in lines)
    for kept in (n + 1, n + 100, n + 1500):
        with pytest.raises(ValueError, match=r"line \d+: no edge reaches vertex"):
            read_lines(tmp_path, lines[:kept])


# Fuzz: a damaged file is refused with its line, or the graph is what its lines say.

TOKENS = ["nan", "inf", "1e999", "1_0", "0x1F", "٣", "-", "FIX", "EDGE2", "VERTEX2", "7", "1e300"]
TOKENS += ["-1e300", "99999999999999999999", "\udcff", "#", "1e-320", "-0", "3.0", "\x00", "\x0b"]


@st.composite
def damaged(draw):
    """LINES after one to three injuries: cut, shuffled, doubled, overwritten, or noise."""
    lines = list(LINES)
    if draw(st.booleans()):
        lines = [*lines[:8], *(line.replace("_SE2", "2") for line in lines[8:])]
    text = "\n".join(lines) + "\n"
    for _ in range(draw(st.integers(1, 3))):
        lines = text.split("\n")
        row = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from("cut drop double shuffle word noise join".split()))
        if kind == "cut":
            text = text[: draw(st.integers(0, len(text)))]
        elif kind == "drop":
            text = "\n".join(lines[:row] + lines[row + 1 :])
        elif kind == "double":
            text = "\n".join([*lines, lines[row]])
        elif kind == "shuffle":
            text = "\n".join(draw(st.permutations(lines)))
        elif kind == "word":
            words = lines[row].split(" ")
            words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(TOKENS))
            text = "\n".join([*lines[:row], " ".join(words), *lines[row + 1 :]])
        elif kind == "noise":
            at = draw(st.integers(0, len(text)))
            noise = draw(st.binary(min_size=1, max_size=4)).decode("utf-8", "surrogateescape")
            text = text[:at] + noise + text[at + draw(st.integers(0, 4)) :]
        else:
            text = "\n".join([*lines[:row], " ".join(lines[row : row + 2]), *lines[row + 2 :]])
    return text


def by_plain_reading(text):
    """What the lines say, by the shortest reader that can be written; no checks."""
    lines = [line.split() for line in text.split("\n")]
    lines = [words for words in lines if words and not words[0].startswith("#")]
    vertices = [
        [int(w[1]), *map(float, w[2:])] for w in lines if w[0] in ("VERTEX_SE2", "VERTEX2")
    ]
    edges = [[*map(float, w[1:])] for w in lines if w[0] in ("EDGE_SE2", "EDGE2")]
    toro = [w[0] == "EDGE2" for w in lines if w[0] in ("EDGE_SE2", "EDGE2")]
    scans = [w[9 : 9 + int(w[8])] for w in lines if w[0] == "ROBOTLASER1"]
    fixed = {int(word) for w in lines if w[0] == "FIX" for word in w[1:]}
    known = len(vertices) + len(edges) + len(scans) + sum(w[0] == "FIX" for w in lines)
    return known == len(lines), vertices, edges, toro, scans, fixed


def read_or_refused(tmp_path, text, name):
    """Return the graph and "", or None and the message; any other exception is a failure."""
    try:
        return read(tmp_path, text, name), ""
    except ValueError as error:
        return None, str(error)


def says_the_same(graph, text):
    complete, vertices, edges, toro, scans, fixed = by_plain_reading(text)
    if (len(graph.poses), len(graph.edges)) != (len(vertices), len(edges)):
        return False
    ids = graph.ids
    read_vertices = np.column_stack([ids, graph.poses])
    upper = [0, 1, 2, 4, 5, 8]
    order = np.array([[0, 1, 3, 5, 2, 4] if t else range(6) for t in toro])
    flat = graph.information.reshape(-1, 9)[:, upper]
    read_edges = np.column_stack(
        [ids[graph.edges], graph.measurements, np.take_along_axis(flat, order, 1)]
    )
    return (
        complete
        and np.array_equal(read_vertices, vertices)
        and np.array_equal(read_edges, edges)
        and np.array_equal(
            [] if graph.scans is None else graph.scans.ranges, np.array(scans, dtype=float)
        )
        and {int(ids[row]) for row in graph.fixed} == (fixed or {int(ids[0])})
    )


OUTCOMES = {"refused": 0, "read": 0}


@settings(
    derandomize=True,
    deadline=None,
    max_examples=2500,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(damaged())
def test_a_damaged_file_is_refused_by_line_or_read_faithfully(tmp_path, text):
    graph, message = read_or_refused(tmp_path, text, "graph.g2o")
    OUTCOMES["read" if graph else "refused"] += 1
    if graph:
        assert says_the_same(graph, text)
    else:
        number = re.match(r"graph\.g2o: line (\d+): ", message)
        assert number
        assert 1 <= int(number[1]) <= text.count("\n") + 1


def test_the_fuzz_met_both_outcomes_often():
    if not sum(OUTCOMES.values()):
        pytest.skip("the fuzz ran in another process")
    assert OUTCOMES["refused"] > 500
    assert OUTCOMES["read"] > 100
    assert sum(OUTCOMES.values()) >= 2000


def test_the_fuzz_sees_a_reader_that_drops_edges(tmp_path):
    text = "\n".join(LINES)
    graph = read(tmp_path, text)
    assert says_the_same(graph, text)
    partial = PoseGraph(
        graph.poses, graph.edges[:2], graph.measurements[:2], graph.information[:2], graph.ids
    )
    assert not says_the_same(partial, text)


@settings(
    derandomize=True,
    deadline=None,
    max_examples=300,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_a_damaged_archive_is_refused(tmp_path, data):
    text = "\n".join(LINES).encode()
    path = tmp_path / "graph.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("graph.g2o", text)
    whole = data.draw(st.sampled_from([path.read_bytes(), gzip.compress(text, mtime=0)]))
    bad = bytearray(whole[: data.draw(st.integers(1, len(whole)))])
    bad[data.draw(st.integers(0, len(bad) - 1))] ^= data.draw(st.integers(0, 255))
    graph, message = read_or_refused(tmp_path, bytes(bad), "bad.bin")
    if graph:
        assert says_the_same(graph, text.decode())
    else:
        assert "bad.bin: " in message
