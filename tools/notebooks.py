"""Run and slim the course's notebooks.

python tools/notebooks.py run PATH...    execute in place, then slim
python tools/notebooks.py slim PATH...   drop images, widget views and state, keep text outputs

Git keeps text outputs only: nbval compares them, the book draws the figures anew.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

KEPT = ("text/plain", "text/markdown", "text/latex")


def slim(notebook: nbformat.NotebookNode) -> None:
    """Drop in place what is drawn anew when the book is built."""
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        }
    )
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code, start=1):
        cell.metadata.pop("execution", None)
        # nbval takes a cell with outputs and no number for one that was never run.
        cell.execution_count = number
        for output in cell.outputs:
            if "data" in output:
                output.data = {k: v for k, v in output.data.items() if k in KEPT}
                output.metadata = {}
            if "execution_count" in output:
                output.execution_count = number


def run(notebook: nbformat.NotebookNode, folder: Path) -> None:
    """Execute in place with the kernel of this environment."""
    NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["run", "slim"])
    parser.add_argument("paths", nargs="+", type=Path)
    arguments = parser.parse_args()
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
