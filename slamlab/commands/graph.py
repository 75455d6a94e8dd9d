"""Optimise a pose graph (g2o or TORO file) and report what came of it.

From the file's own poses and, where that is not certified to be the best, from a guess that needs
no start; the better of both counts. With -o the optimised graph, a picture and a page are written
into a folder.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from slamlab._files import about
from slamlab.commands import _page
from slamlab.commands._results import results
from slamlab.slam import PoseGraph
from slamlab.slam.least_squares import KERNEL_WIDTHS
from slamlab.slam.pose_graph import Result

FILES = ("optimised.g2o", "graph.png")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("file", type=Path, help="g2o or TORO file, plain, .gz or .zip")
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="write results here")
    parser.add_argument(
        "--kernel",
        choices=["none", "huber", "dcs"],
        default="none",
        help="weigh down edges that fit badly; widths {:g}, {:g} and {:g}".format(*KERNEL_WIDTHS),
    )


def run(options: argparse.Namespace) -> None:
    """Read, optimise, report; write the results if a folder is named."""
    # Numbers of astronomic size end in a sentence.
    with np.errstate(all="ignore"), about(options.file.name):
        _run(options)


def _run(options: argparse.Namespace) -> None:
    graph = PoseGraph.read_g2o(options.file)
    if options.output is None:
        _optimise(options, graph, None)
        return
    with results(options.output, FILES) as folder:  # made now, not after the work
        _optimise(options, graph, folder)
    print(f"{'written to':24s} {options.output}")


def _optimise(options: argparse.Namespace, graph: PoseGraph, folder: Path | None) -> None:
    before = time.perf_counter()
    result, start = best_of_two(graph, None if options.kernel == "none" else options.kernel)
    rows = report(graph, result, start, time.perf_counter() - before)
    for name, value in rows:
        print(f"{name:24s} {value}")
    if folder is not None:
        write(folder, options.file.name, graph, result, rows)


def best_of_two(graph: PoseGraph, kernel: str | None) -> tuple[Result, str]:
    """Least cost from the file's poses and from the initial guess, and which of both it was."""
    own = graph.optimize(kernel=kernel, kernel_width=KERNEL_WIDTHS)
    if own.converged and own.certified:
        return own, "the file's own"
    other = graph.chordal_initialisation().optimize(kernel=kernel, kernel_width=KERNEL_WIDTHS)
    if other.history[-1] < own.history[-1]:
        return other, "initial guess"
    return own, "the file's own"


def report(graph: PoseGraph, result: Result, start: str, seconds: float) -> list[tuple[str, str]]:
    """List names and values of what came of it."""
    try:
        proof = f"no poses reach a chi2 below {result.certificate.bound:.6g}"
    except ValueError as error:  # numbers too far apart for a bound
        proof = f"no bound: {error}"
    n, k = len(graph.poses), len(graph.landmarks)
    measured = 3 * len(graph.edges) + 2 * len(graph.landmark_edges)
    rows = [
        ("poses", f"{n}"),
        ("edges", f"{len(graph.edges)}, {graph.closures.sum()} of them closures"),
        ("chi2 before", f"{graph.chi2():.6g}"),
        ("chi2 after", f"{result.chi2:.6g}"),
        ("degrees of freedom", f"{measured - 3 * (n - len(graph.fixed)) - 2 * k}"),
        ("start", start),
        ("converged", f"{'yes' if result.converged else 'no'} ({result.message})"),
        ("certified", f"{'yes' if result.certified else 'not proved'} ({proof})"),
        ("closures rejected", f"{result.n_rejected}"),
        ("seconds", f"{seconds:.2f}"),
    ]
    if k:
        rows.insert(1, ("landmarks", f"{k}, seen {len(graph.landmark_edges)} times"))
    return rows


def write(
    folder: Path, name: str, graph: PoseGraph, result: Result, rows: list[tuple[str, str]]
) -> None:
    """Write the graph, its picture and the page."""
    graph.with_poses(result.poses, result.landmarks).write_g2o(folder / "optimised.g2o")
    png = drawing(graph, result)
    (folder / "graph.png").write_bytes(png)
    alt = "Poses of the graph joined to a path, before (dashed) and after (solid)."
    text = _page.page(
        name,
        _page.table(rows),
        _page.picture(png, alt),
        _page.paragraph("The edges that fit worst, from which pose to which, and their chi2:"),
        _page.table(worst(graph, result)),
    )
    (folder / "index.html").write_text(text, encoding="utf-8", errors="replace")


def worst(graph: PoseGraph, result: Result, count: int = 10) -> list[tuple[str, str]]:
    """List the edges of the largest chi2, with the names of their poses."""
    e = graph.residuals(result.poses)
    chi2 = np.einsum("ka,kab,kb->k", e, graph.information, e)
    first = np.argsort(-chi2, kind="stable")[:count]
    names = graph.ids[graph.edges[first]]
    return [(f"{i} to {j}", f"{x:.4g}") for (i, j), x in zip(names, chi2[first], strict=True)]


def drawing(graph: PoseGraph, result: Result) -> bytes:
    """Draw the poses before and after."""
    from matplotlib.figure import Figure

    from slamlab import plots

    figure = Figure(figsize=(7, 6), layout="constrained")
    ax = figure.add_subplot()
    plots.path(ax, graph.poses, "dead_reckoning", label="before")
    plots.path(ax, result.poses, "estimate", label="after")
    if len(result.landmarks):
        plots.landmarks(ax, result.landmarks, estimated=True, label="landmarks")
    plots.floor(ax)
    ax.legend()
    return _page.png_of(figure)
