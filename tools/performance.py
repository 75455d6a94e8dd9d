"""Measure the library beside its peers and write the tables of the performance page.

python tools/performance.py              all tables
python tools/performance.py kernels      this one alone; the others stay as they are

Every tests/benchmarks/test_*_speed.py has `rows()`: what was measured, ms of ours, ms of the peer,
their ratio, and perhaps more; tools/kernel_table.py has it, too. The tables are a record of one
machine and are kept in git.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS = ROOT / "tests" / "benchmarks"
PAGE = ROOT / "book" / "performance_tables.md"
VERSIONS = ["numpy", "scipy", "gtsam", "filterpy", "joblib"]
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

HEAD = ["what", "slamlab (ms)", "peer (ms)", "ratio"]
# Title, names of the columns after the ratio, and one sentence, by file.
TABLES = {
    "test_association_speed": (
        "Data association",
        ["promised ratio"],
        "The peer of the joint search is the time promised; that of the nearest neighbour inverts "
        "one matrix for every pair of a measurement and a landmark.",
    ),
    "test_graph_speed": (
        "Pose graphs beside gtsam",
        ["chi2 of slamlab", "chi2 of gtsam"],
        "`PoseGraph.optimize` and gtsam's Gauss-Newton, both from the same start until a step "
        "lowers the cost by less than 1e-12 of it. gtsam's own `optimize` ends where a step "
        "raises the cost, as the first on Intel does; here it goes on. Each cost is in its "
        "program's metric, and the two differ in the second order of an edge's error. Building "
        "gtsam's graph is not counted.",
    ),
    "test_ekf_speed": (
        "EKF-SLAM beside the textbook's dense matrices",
        ["promised ratio"],
        "The textbook writes F and H as full matrices and forms K S K^T. The bare update is "
        "P - B B^T of rank 20 and nothing else, in place, by BLAS. In the last three rows the "
        "second column is a smaller map.",
    ),
    "test_fast_speed": (
        "FastSLAM beside a loop over the particles",
        ["promised"],
        "The peer keeps one Python object a particle and one small matrix at a time. In the last "
        "two rows the second column is a smaller map.",
    ),
    "test_kalman_speed": ("Kalman filters", [], ""),
    "test_signature_speed": (
        "Localization by signatures",
        ["promised ratio"],
        "The peer of the map casts the same beams and builds no tree; the peer of the lookup "
        "aligns the scan with all places.",
    ),
    "test_lidar_speed": (
        "Lidar beams beside a plain compiled traversal",
        ["promised (ratio or time)"],
        "The peer walks every beam from grid line to grid line, compiled by numba like ours, "
        "which jumps over empty cells. P5's walk is in plain Python. In the last three rows the "
        "second column is a limit, not a measurement.",
    ),
    "test_particle_speed": (
        "Particle filter beside bare NumPy",
        ["promised ratio"],
        "The peer is the same arithmetic written down in NumPy without any check of its input.",
    ),
    "test_path_speed": (
        "Path memory beside P3's Table 1",
        ["promised ratio"],
        "The peer's milliseconds are those that P3 printed, on a computer of its own; the last "
        "row compares the memory with itself. A cycle is `add` and a search after each point.",
    ),
    "tools.kernel_table": (
        "Kernels and their plain twins",
        [],
        "A chapter's lesson and second pages are run as they are, and every call of a kernel is "
        "counted; at most 24 of a page, evenly spread, are then made again by the kernel and by "
        "its twin, in turn. A time is the mean of these calls, weighted by the calls of each "
        "page, and of a call the shortest of up to five rounds; an input is the median. A twin "
        "has no compiled code within; it is the function above which its system's file has "
        '`@compiled("boxes.search")`, say. What is saved is the number of calls times the '
        "difference of the two times. *Stored* are the runs that `tools/lesson_tables.py` makes "
        "for a chapter, which then only shows them.",
    ),
}


# What measures each table, by the name that the command takes.
MODULES = {
    path.stem.removeprefix("test_").removesuffix("_speed"): path.stem
    for path in sorted(BENCHMARKS.glob("test_*_speed.py"))
} | {"kernels": "tools.kernel_table"}


def main() -> int:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="TABLE", help=", ".join(MODULES))
    names = parser.parse_args().names
    if unknown := set(names).difference(MODULES):
        parser.error(f"expected some of {', '.join(MODULES)}, got {', '.join(sorted(unknown))}")
    if any(os.environ.get(name) != value for name, value in THREADS.items()):
        # BLAS reads the number of its threads once, when NumPy is loaded.
        command = [sys.executable, __file__, *sys.argv[1:]]
        return subprocess.run(command, env={**os.environ, **THREADS}, check=False).returncode
    sys.path[:0] = [str(BENCHMARKS), str(ROOT)]
    # The page that includes this one has the title; the headings below it stay.
    page = PAGE.read_text().rstrip("\n").split("\n\n## ") if names else [machine()]
    for name in names or MODULES:
        print(f"measuring {name} ...", flush=True)
        module = importlib.import_module(MODULES[name])
        page = with_section(page, table(MODULES[name], module.rows(), module))
    PAGE.write_text("\n\n## ".join(page) + "\n")
    print(f"written: {PAGE.relative_to(ROOT)}")
    return 0


def with_section(page: list[str], section: str) -> list[str]:
    """Put a section in the place of the one with its title, or at the end.

    A page is its first paragraph, `machine()`, and its sections from their titles on.
    """
    title, _, rest = section.partition("\n\n")
    if machine() != page[0]:  # it is not of the same day, machine or versions
        section = f"{title}\n\n{machine()}\n\n{rest}"
    there = [number for number, one in enumerate(page) if one.startswith(f"{title}\n")]
    at = there[0] if there else len(page)
    return [*page[:at], section, *page[at + 1 :]]


def machine() -> str:
    """One paragraph: when, processor, cores, versions."""
    versions = ", ".join(f"{name} {version(name)}" for name in ["slamlab-course", *VERSIONS])
    return (
        f"Measured on {datetime.now(UTC):%d %B %Y}: {processor()}, {os.cpu_count()} cores, "
        f"{platform.system()}, Python {platform.python_version()}, {versions}; one BLAS thread."
    )


def version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def processor() -> str:
    """Name of the processor as the system tells it."""
    info = Path("/proc/cpuinfo")
    for line in info.read_text().splitlines() if info.is_file() else []:
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def table(name: str, rows: list[tuple], module: object) -> str:
    """Title and table; columns beyond the ratio by TABLES or by the module's COLUMNS."""
    title, more, text = TABLES.get(name, (name, [], ""))
    columns = getattr(module, "COLUMNS", None) or HEAD + more
    width = max((len(row) for row in rows), default=len(columns))
    columns = (list(columns) + [""] * width)[:width]
    words = getattr(module, "WORDS", (0,))  # columns that are words, not numbers
    lines = [title, ""] + ([text, ""] if text else [])
    lines += ["| " + " | ".join(columns) + " |"]
    lines += ["".join("|---" if n in words else "|---:" for n in range(width)) + "|"]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4f}" if value >= 1000 else f"{value:.3g}"
    return str(value).replace("|", "/")


if __name__ == "__main__":
    sys.exit(main())
