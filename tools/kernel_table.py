"""What each compiled kernel saves: its calls in a chapter, timed beside those of its plain twin.

`tools/performance.py kernels` makes the table. A chapter's lesson and second pages are run as they
are; on the way the calls of every kernel are counted, and some, evenly spread, are kept. When a
notebook has ended, the kept calls are made again by the kernel and by its twin, in turn.
"""

from __future__ import annotations

import copy
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab import kernels

ROOT = Path(__file__).resolve().parents[1]
MOST = 24  # calls kept of each kernel and notebook; at least half as many are made again
ROUNDS, SECONDS = 5, 8.0  # each call so often, unless a kernel's calls take longer than this

Call = tuple[tuple[Any, ...], dict[str, Any]]


@dataclass
class Calls:
    """Number of calls of one kernel, and every `stride`-th of them."""

    n: int = 0
    stride: int = 1
    kept: list[Call] = field(default_factory=list)

    def add(self, call: Call) -> None:
        """Count a call, and keep a copy of it if its turn has come."""
        if self.n % self.stride == 0:
            self.kept.append(copy.deepcopy(call))
        self.n += 1
        if len(self.kept) > MOST:
            self.kept, self.stride = self.kept[::2], 2 * self.stride


class Recorder:
    """Counts and keeps the calls of kernels in this process, from now on."""

    def __init__(self) -> None:
        self.calls: dict[str, Calls] = {}
        self.kernel_of = kernels.kernel_of
        kernels.kernel_of = self.counted  # type: ignore[assignment]

    def counted(self, name: str) -> Callable[..., Any]:
        """Return what notes a call and then makes it."""
        return partial(self.call, name)

    def call(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Note a call, then make it."""
        self.calls.setdefault(name, Calls()).add((args, kwargs))
        return self.kernel_of(name)(*args, **kwargs)

    def write(self, path: str) -> None:
        """Time what was kept and write, by kernel: calls, mean seconds of twin and kernel."""
        kernels.kernel_of = self.kernel_of
        found = {}
        for name, calls in self.calls.items():
            twin, kernel = timed(kernels.TWINS[name], self.kernel_of(name), calls.kept)
            sizes = [KERNELS[name][1](*args) for args, _ in calls.kept]
            found[name] = {"calls": calls.n, "twin": twin, "kernel": kernel, "sizes": sizes}
        Path(path).write_text(json.dumps(found))


def timed(
    twin: Callable[..., Any], kernel: Callable[..., Any], calls: list[Call]
) -> tuple[float, float]:
    """Mean CPU seconds of both over the calls; of each call the shortest of some rounds."""
    served, end = kernels.numba_serves, time.perf_counter() + SECONDS
    best = []
    for call in calls:
        once(kernel, call)  # compiled, and its code in the cache
    for n in range(ROUNDS):
        if n and time.perf_counter() > end:
            break
        for k, call in enumerate(calls):
            kernels.numba_serves = lambda: False  # type: ignore[assignment]
            slow = once(twin, call)  # with plain code within
            kernels.numba_serves = served
            fast = once(kernel, call)
            if n == 0:
                best.append((slow, fast))
            best[k] = min(best[k][0], slow), min(best[k][1], fast)
    slow, fast = (sum(some) / len(best) for some in zip(*best, strict=True))
    return slow, fast


def once(function: Callable[..., Any], call: Call) -> float:
    """CPU seconds of one call, on arguments of its own: some are written to."""
    args, kwargs = copy.deepcopy(call)
    begin = time.thread_time_ns()
    function(*args, **kwargs)
    return 1e-9 * (time.thread_time_ns() - begin)


# By kernel: what its calls get, how many of each, and where they are counted: in a chapter, or in
# the runs that a table of tools/lesson_tables.py stores for one.
Sizes = Callable[..., tuple[int, ...]]
KERNELS: dict[str, tuple[str, Sizes, tuple[str, ...]]] = {
    "boxes.search": ("a cubic, {} before it", lambda *a: (len(a[3]),), ("17",)),
    "cast.cast_grid": ("{} beams", lambda *a: (len(a[1]),), ("19",)),
    "clearance.grid_clearance": ("points: {}", lambda *a: (len(a[2]),), ("18",)),
    "collide.hits_grid": ("{} motions", lambda *a: (len(a[5]),), ("18",)),
    "correlative.search": (
        "{} points, {} angles, {} shifts",
        lambda *a: (a[1].shape[1], len(a[1]), (2 * a[2] + 1) ** 2),
        ("14",),
    ),
    "cubic.arc_length_table": ("a cubic", lambda *a: (), ("17",)),
    "cubic.fit": ("{} points", lambda *a: (len(a[1]),), ("17",)),
    "cubic.parameter_at": ("a cubic, a length", lambda *a: (), ("17",)),
    "field.gauss_newton": ("{} points", lambda *a: (len(a[3]),), ("14",)),
    "field.splat": ("{} points", lambda *a: (len(a[1]),), ("14",)),
    "floor.mark_free": (
        "{} beams, {} x {} cells",
        lambda *a: (len(a[5]), *a[0].shape),
        ("18", "20"),
    ),
    "floor.mark_walls": ("{} beams", lambda *a: (len(a[5]),), ("18", "18b rooms")),
    "floor.unknown_area": (
        "{} places, {} rays",
        lambda *a: (len(a[1]), a[3]),
        ("18", "18b rooms"),
    ),
    "floor.wavefront": ("{} x {} cells", lambda *a: a[0].shape, ("20",)),
    "gamma.gather": (
        "{} particles, {} points",
        lambda *a: (len(a[2]), len(a[0])),
        ("15", "15 grounds"),
    ),
    "grid_fast.refine": ("{} particles, {} points", lambda *a: (len(a[5]), len(a[4])), ("15",)),
    "grid_fast.draw": ("{} particles, {} beams", lambda *a: a[6].shape[:2], ("15",)),
    "grid_fast.penetrate": (
        "{} particles, {} beams",
        lambda *a: a[5].shape[:2],
        ("15d clouds",),
    ),
    "grid_fast.touched": ("{} particles, {} beams", lambda *a: a[3].shape[:2], ("15",)),
    "icp.align": ("{} points on {}", lambda *a: (len(a[2]), len(a[0])), ("14",)),
    "march.march": ("{} rays", lambda *a: (len(a[3]),), ("15",)),
    "occupancy.insert_scan": ("{} beams", lambda *a: (len(a[2]),), ("08",)),
    "spline.nearest": ("{} places", lambda *a: (len(a[4]),), ("17",)),
    "spline.points_at": ("{} lengths", lambda *a: (len(a[3]),), ("17",)),
}

COLUMNS = [
    "kernel",
    "factor",
    "saved (s)",
    "chapter",
    "twin (ms)",
    "kernel (ms)",
    "calls",
    "input",
]
WORDS = (0, 3, 7)  # columns that are words, not numbers


def rows() -> list[tuple[object, ...]]:
    """Rows of the performance page, by the names of the kernels."""
    pairs = [(name, place) for name, (*_, places) in KERNELS.items() for place in places]
    found = {place: measured(place) for place in sorted({place for _, place in pairs})}
    return [row(name, place, found[place][name]) for name, place in pairs]


def row(name: str, place: str, calls: list[dict[str, Any]]) -> tuple[object, ...]:
    """Give the row of a kernel: its calls in each notebook, taken together."""
    n = sum(some["calls"] for some in calls)
    twin, kernel = (
        sum(some["calls"] * some[of] for some in calls) / n for of in ("twin", "kernel")
    )
    sizes = zip(*(size for some in calls for size in some["sizes"]), strict=True)
    given = KERNELS[name][0].format(*(round(median(some)) for some in sizes))
    where = place if place.isdigit() else f"{place}, stored"
    saves = f"{twin / kernel:.1f}", f"{n * (twin - kernel):.1f}"
    return name, *saves, where, 1e3 * twin, 1e3 * kernel, n, given


def measured(place: str) -> dict[str, list[dict[str, Any]]]:
    """Run what a place names; by kernel what `Recorder.write` says of each notebook."""
    paths = sorted((ROOT / "notebooks").glob(f"{place}*.ipynb")) if place.isdigit() else [None]
    found: dict[str, list[dict[str, Any]]] = {}
    for path in paths:
        print(f"    {path.relative_to(ROOT) if path else place}", flush=True)
        for name, calls in (recorded(path) if path else recorded(None, place)).items():
            found.setdefault(name, []).append(calls)
    return found


RECORD = """import sys
sys.path.insert(0, {root!r})
from tools.kernel_table import Recorder
_recorder = Recorder()"""
STORED = """import sys
sys.path.insert(0, {root!r})
from tools.lesson_tables import TABLES, one, page
_names = list(page({table!r})[TABLES[{table!r}].names])"""
RUNS = (
    "for _name in _names:\n    for _seed in TABLES[{table!r}].seeds: one({table!r}, _name, _seed)"
)


def recorded(notebook: Path | None, table: str = "") -> dict[str, Any]:
    """Run a copy of a notebook, or all runs of a stored table; what `Recorder.write` says."""
    import nbformat

    from tools.notebooks import run

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calls.json"
        facts = {"root": str(ROOT), "table": table}
        before, record, runs, write = (
            nbformat.v4.new_code_cell(text.format(**facts))
            for text in (STORED, RECORD, RUNS, f"_recorder.write({str(path)!r})")
        )
        if notebook is None:
            copied = nbformat.v4.new_notebook(cells=[before, record, runs, write])
        else:
            copied = nbformat.read(notebook, as_version=4)
            copied.cells = [record, *copied.cells, write]
        run(copied, notebook.parent if notebook else ROOT)
        found: dict[str, Any] = json.loads(path.read_text())
        return found
