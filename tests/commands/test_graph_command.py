"""``python -m slamlab graph``: what it reports and what it writes."""

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.datasets.synthetic import manhattan_graph
from slamlab.slam import PoseGraph


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "town.g2o"
    manhattan_graph(60, 90, np.random.default_rng(1)).graph.write_g2o(path)
    return path


def test_it_reports_and_writes_the_optimised_graph(file, tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert main(["graph", str(file), "-o", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()[2:4]
    said = dict(line.split()[1:] for line in lines)
    best = PoseGraph.read_g2o(file).optimize()
    assert float(said["after"]) == pytest.approx(best.chi2, rel=1e-5)
    assert best.chi2 < float(said["before"])
    assert np.array_equal(PoseGraph.read_g2o(folder / "optimised.g2o").poses, best.poses)
    assert (folder / "graph.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / "index.html").read_text()
    assert "town.g2o" in page
    assert "http" not in page
