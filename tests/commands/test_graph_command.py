"""``python -m slamlab graph``: what it reports and writes, and that damage ends in a sentence."""

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.datasets.synthetic import manhattan_graph
from slamlab.slam import PoseGraph


def said(capsys):
    lines = capsys.readouterr().out.splitlines()
    return {line[:24].strip(): line[25:] for line in lines}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "town.g2o"
    manhattan_graph(60, 90, np.random.default_rng(1)).graph.write_g2o(path)
    return path


def test_it_reports_and_writes_the_optimised_graph(file, tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert main(["graph", str(file), "-o", str(folder)]) == 0
    told = said(capsys)
    best = PoseGraph.read_g2o(file).optimize()
    assert float(told["chi2 after"]) == pytest.approx(best.chi2, rel=1e-5)
    assert best.chi2 < float(told["chi2 before"])
    assert told["edges"] == "90, 31 of them closures"
    assert told["degrees of freedom"] == "93"
    assert told["start"] == "the file's own"
    assert told["converged"] == "yes (converged)"
    assert told["certified"].startswith("yes (no poses reach a chi2 below ")
    assert np.array_equal(PoseGraph.read_g2o(folder / "optimised.g2o").poses, best.poses)
    assert (folder / "graph.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / "index.html").read_text()
    assert "town.g2o" in page
    assert page.count("<tr>") == len(told) - 1 + 10  # all but "written to", and ten edges
    assert "http" not in page


def test_a_poor_start_is_told_from_the_best(tmp_path, capsys):
    graph = manhattan_graph(
        300, 420, np.random.default_rng(0), sigma_position=0.1, sigma_heading=0.1
    ).graph
    graph.write_g2o(tmp_path / "hard.g2o")
    assert main(["graph", str(tmp_path / "hard.g2o")]) == 0
    told = said(capsys)
    assert told["start"] == "initial guess"
    assert float(told["chi2 after"]) < 0.6 * graph.optimize().chi2
    assert told["certified"].startswith("yes")


def test_landmarks_are_counted_and_drawn(tmp_path, capsys):
    (tmp_path / "seen.g2o").write_text(
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 5 1 1\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
        "EDGE_SE2_XY 0 5 1 1 1 0 1\nEDGE_SE2_XY 1 5 0.1 1 1 0 1\n"
    )
    assert main(["graph", str(tmp_path / "seen.g2o"), "-o", str(tmp_path / "out")]) == 0
    told = said(capsys)
    assert told["landmarks"] == "1, seen 2 times"
    assert told["degrees of freedom"] == "2"
    assert len(PoseGraph.read_g2o(tmp_path / "out" / "optimised.g2o").landmarks) == 1


def test_a_kernel_says_what_it_rejected(file, capsys):
    text = file.read_text() + "EDGE_SE2 3 40 0 0 0 400 0 0 400 0 10000\n"
    file.write_text(text)
    assert main(["graph", str(file), "--kernel", "dcs"]) == 0
    assert said(capsys)["closures rejected"] == "1"


def test_weights_too_far_apart_for_a_bound_leave_the_result(tmp_path, capsys):
    file = tmp_path / "ring.g2o"
    lines = [f"VERTEX_SE2 {k} {x} {y} 0" for k, (x, y) in enumerate([(0, 0), (1, 0), (1, 1)])]
    for i, j, dx, dy, first in ((0, 1, 1, 0, 400), (1, 2, 0, 1, "1e-320"), (0, 2, 1, 1.1, 400)):
        lines.append(f"EDGE_SE2 {i} {j} {dx} {dy} 0 {first} 0 0 400 0 10000")
    file.write_text("\n".join(lines) + "\n")
    assert main(["graph", str(file)]) == 0
    told = said(capsys)
    assert told["converged"].startswith("yes")
    assert float(told["chi2 after"]) < float(told["chi2 before"])
    assert "Eigenvalues" not in told["certified"]
