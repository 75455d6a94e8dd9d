"""Measure the library beside its peers and write the tables of the performance page.

python tools/performance.py

Every tests/benchmarks/test_*_speed.py has `rows()`: what was measured, ms of ours, ms of the peer,
their ratio, and perhaps more. The tables are a record of one machine and are kept in git.
"""

from __future__ import annotations

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
}


def main() -> int:
    """Measure, and write the page."""
    if any(os.environ.get(name) != value for name, value in THREADS.items()):
        # BLAS reads the number of its threads once, when NumPy is loaded.
        command = [sys.executable, __file__, *sys.argv[1:]]
        return subprocess.run(command, env={**os.environ, **THREADS}, check=False).returncode
    sys.path.insert(0, str(BENCHMARKS))
    parts = ["# Tables", machine()]
    for path in sorted(BENCHMARKS.glob("test_*_speed.py")):
        print(f"measuring {path.name} ...", flush=True)
        module = importlib.import_module(path.stem)
        parts.append(table(path.stem, module.rows(), module))
    # The page that includes this one has the title; the headings below it stay.
    PAGE.write_text("\n\n".join(parts[1:]) + "\n")
    print(f"written: {PAGE.relative_to(ROOT)}")
    return 0


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
    """One section with a table; columns beyond the ratio by TABLES or by the module's COLUMNS."""
    title, more, text = TABLES.get(name, (name, [], ""))
    columns = getattr(module, "COLUMNS", None) or HEAD + more
    width = max((len(row) for row in rows), default=len(columns))
    columns = (list(columns) + [""] * width)[:width]
    lines = [f"## {title}", ""] + ([text, ""] if text else [])
    lines += ["| " + " | ".join(columns) + " |", "|---" + "|---:" * (width - 1) + "|"]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4f}" if value >= 1000 else f"{value:.3g}"
    return str(value).replace("|", "/")


if __name__ == "__main__":
    sys.exit(main())
