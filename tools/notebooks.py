"""Run, compare and slim the course's notebooks.

python tools/notebooks.py run PATH...     execute in place, then slim
python tools/notebooks.py slim PATH...    drop images, widget views and state, keep text outputs
python tools/notebooks.py check PATH...   execute a copy and compare its text with what is stored
                                          (--setting plain: as on a machine without AVX; haswell:
                                          with AVX2, and with memory full of large numbers)
python tools/notebooks.py warm            compile all loops for a setting, once

Git keeps text outputs only: they are compared, the book draws the figures anew.
"""

from __future__ import annotations

import argparse
import difflib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.kernels import LocalAsyncKernelManager, find_fonts

ROOT = Path(__file__).resolve().parents[1]
KEPT = ("text/plain", "text/markdown", "text/latex")
# All that a notebook says of itself, so that opening it changes nothing; no version of Python.
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {
        "codemirror_mode": {"name": "ipython", "version": 3},
        "file_extension": ".py",
        "mimetype": "text/x-python",
        "name": "python",
        "nbconvert_exporter": "python",
        "pygments_lexer": "ipython3",
    },
}
# A RuntimeWarning would only be a line on stderr; as an error it tells where it came from.
STRICT = {"PYTHONWARNINGS": "error::RuntimeWarning"}
# What decides the last bits of a sum: OpenBLAS' kernels, numpy's vector units, numba's target.
SETTINGS = {
    "own": STRICT,
    # AVX2 without AVX-512; and memory that nobody wrote holds 1.4e306, not zeros by good luck.
    "haswell": STRICT
    | {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CACHE_DIR": str(ROOT / "_build" / "numba-haswell"),
        "MALLOC_PERTURB_": "128",
    },
    "plain": STRICT
    | {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_OPT": "1",  # compiles in three quarters of the time, and runs no slower
        "NUMBA_CACHE_DIR": str(ROOT / "_build" / "numba-plain"),
    },
}


def slim(notebook: nbformat.NotebookNode) -> None:
    """Drop in place what is drawn anew when the book is built."""
    notebook.metadata = nbformat.from_dict(METADATA)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code, start=1):
        cell.metadata.pop("execution", None)
        # nbval takes a cell with outputs and no number for one that was never run.
        cell.execution_count = number
        cell.outputs = _joined(cell.outputs)
        for output in cell.outputs:
            if "data" in output:
                output.data = {k: v for k, v in output.data.items() if k in KEPT}
                output.metadata = {}
            if "execution_count" in output:
                output.execution_count = number


def _joined(outputs: list[nbformat.NotebookNode]) -> list[nbformat.NotebookNode]:
    """Join neighbouring pieces of one stream: where it was cut is chance."""
    joined: list[nbformat.NotebookNode] = []
    for output in outputs:
        if joined and output.get("name", "") == joined[-1].get("name") and "text" in output:
            joined[-1].text += output.text
        else:
            joined.append(output)
    return joined


def client(notebook: nbformat.NotebookNode, folder: Path, **options: Any) -> NotebookClient:
    """Return what executes a notebook in place, with the kernel of this environment."""
    return NotebookClient(
        notebook,
        record_timing=False,
        kernel_name="python3",
        kernel_manager_class=LocalAsyncKernelManager,
        resources={"metadata": {"path": str(folder)}},
        **{"timeout": 600} | options,
    )


def run(notebook: nbformat.NotebookNode, folder: Path) -> None:
    """Execute in place."""
    client(notebook, folder).execute()


@dataclass(frozen=True)
class Executed:
    """A notebook after its run: what it was, what it took, and what stopped it, if anything."""

    path: Path
    notebook: nbformat.NotebookNode
    seconds: float
    error: str = ""


def _run_file(path: Path) -> Executed:
    notebook = nbformat.read(path, as_version=4)
    begin = time.perf_counter()
    error = ""
    try:
        run(notebook, path.parent)
    except (CellExecutionError, DeadKernelError, TimeoutError) as exception:
        error = str(exception)
    return Executed(path, notebook, time.perf_counter() - begin, error)


def n_cores() -> int:
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def run_all(
    paths: list[Path], setting: str = "own", jobs: int | None = None
) -> Iterator[Executed]:
    """Execute copies of notebooks on all cores, in the order given; yield them as they end.

    The work is done in the kernels. While one starts or ends, one more has work for its core.
    """
    find_fonts()
    os.environ.update(SETTINGS[setting])
    with ThreadPoolExecutor((jobs or n_cores()) + 1) as pool:
        for future in as_completed([pool.submit(_run_file, path) for path in paths]):
            yield future.result()


def texts(cell: nbformat.NotebookNode) -> list[str]:
    """Lines of text that a cell gave: its streams, joined, and its text data."""
    streams: dict[str, str] = {}
    found = []
    for output in cell.outputs:
        if output.output_type == "stream":
            streams[output.name] = streams.get(output.name, "") + output.text
        elif output.output_type == "error":
            found += [f"{output.ename}: {output.evalue}"]
        else:
            found += [output.data[kind] for kind in KEPT if kind in output.data]
    return "\n".join([*streams.values(), *found]).splitlines()


def differences(stored: nbformat.NotebookNode, fresh: nbformat.NotebookNode) -> list[str]:
    """Give a paragraph for each cell whose text differs: its number, lines stored, lines new."""
    found = []
    code = [[c for c in nb.cells if c.cell_type == "code"] for nb in (stored, fresh)]
    for number, (old, new) in enumerate(zip(*code, strict=True), start=1):
        lines = list(difflib.unified_diff(texts(old), texts(new), lineterm="", n=0))
        if lines:
            changed = [line for line in lines[2:] if not line.startswith("@@")]
            found.append("\n".join([f"cell [{number}]", *(f"    {line}" for line in changed)]))
    return found


def check(paths: list[Path], setting: str) -> int:
    """Execute copies, say of each how long it took and where its text differs; 1 if any does."""
    failed = 0
    for done in run_all(paths, setting):
        found = [done.error] if done.error else []
        found += differences(nbformat.read(done.path, as_version=4), done.notebook)
        print(f"{done.seconds:6.1f} s  {done.path}", *found, sep="\n", flush=True)
        failed |= bool(found)
    return int(failed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["run", "slim", "check", "warm"])
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--setting", choices=SETTINGS, default="own", help="for check and warm")
    arguments = parser.parse_args()
    if arguments.command == "warm":
        os.environ.update(SETTINGS[arguments.setting])
        return subprocess.call([sys.executable, "-m", "slamlab", "warm"])
    if not arguments.paths:
        parser.error("expected at least one notebook")
    if arguments.command == "check":
        return check(arguments.paths, arguments.setting)
    for path in arguments.paths:
        notebook = nbformat.read(path, as_version=4)
        begin = time.perf_counter()
        if arguments.command == "run":
            run(notebook, path.parent)
        slim(notebook)
        nbformat.write(notebook, path)
        print(f"{arguments.command} {path}: {time.perf_counter() - begin:.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
