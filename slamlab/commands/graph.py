"""Optimise a pose graph (g2o or TORO file) and report what came of it.

With -o the optimised graph, a picture and a page are written into a folder.
"""

from __future__ import annotations

import argparse
import time
from io import BytesIO
from pathlib import Path

from slamlab.commands import _page
from slamlab.slam import PoseGraph, Result


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("file", type=Path, help="g2o or TORO file, plain, .gz or .zip")
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="write results here")
    parser.add_argument(
        "--kernel", choices=["none", "huber", "dcs"], default="none", help="robust kernel"
    )


def run(options: argparse.Namespace) -> None:
    """Read, optimise, report; write the results if a folder is named."""
    graph = PoseGraph.read_g2o(options.file)
    start = time.perf_counter()
    result = graph.optimize(kernel=None if options.kernel == "none" else options.kernel)
    rows = report(graph, result, time.perf_counter() - start)
    for name, value in rows:
        print(f"{name:24s} {value}")
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        graph.with_poses(result.poses).write_g2o(options.output / "optimised.g2o")
        png = drawing(graph, result)
        (options.output / "graph.png").write_bytes(png)
        alt = "The poses of the graph as a path: before (dashed) and after (solid)."
        text = _page.page(options.file.name, _page.table(rows), _page.picture(png, alt))
        (options.output / "index.html").write_text(text, encoding="utf-8")
        print(f"{'written to':24s} {options.output}")


def report(graph: PoseGraph, result: Result, seconds: float) -> list[tuple[str, str]]:
    """List names and values of what came of it."""
    return [
        ("poses", f"{len(graph.poses)}"),
        ("edges", f"{len(graph.edges)}"),
        ("chi2 before", f"{graph.chi2():.6g}"),
        ("chi2 after", f"{result.chi2:.6g}"),
        ("converged", f"{'yes' if result.converged else 'no'} ({result.message})"),
        ("seconds", f"{seconds:.2f}"),
    ]


def drawing(graph: PoseGraph, result: Result) -> bytes:
    """Draw the poses before and after."""
    from matplotlib.figure import Figure

    from slamlab import plots

    figure = Figure(figsize=(7, 6), layout="constrained")
    ax = figure.add_subplot()
    plots.path(ax, graph.poses, "dead_reckoning", label="before")
    plots.path(ax, result.poses, "estimate", label="after")
    plots.floor(ax)
    ax.legend()
    data = BytesIO()
    figure.savefig(data, format="png", dpi=150)
    return data.getvalue()
