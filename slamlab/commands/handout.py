"""Put the exercise notebooks of some chapters into a folder: no outputs, no solutions.

The notebooks come from a checkout of the project, where they stand beside the library.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("chapters", nargs="+", help="two digits each, as 02 05")
    parser.add_argument("--to", type=Path, required=True, metavar="FOLDER")


def run(options: argparse.Namespace) -> None:
    """Copy the notebooks, emptied, with a page that says how to begin."""
    source = Path(__file__).resolve().parents[2] / "notebooks" / "exercises"
    if not source.is_dir():
        raise ValueError(f"handout: expected a checkout with its notebooks, found no {source}")
    found = {path.name[:2]: path for path in sorted(source.glob("*.ipynb"))}
    missing = [chapter for chapter in options.chapters if chapter not in found]
    if missing:
        raise ValueError(f"chapters: expected some of {', '.join(found)}, got {missing[0]}")
    files = {options.to / "README.md": README}
    for chapter in options.chapters:
        notebook = emptied(json.loads(found[chapter].read_text(encoding="utf-8")))
        text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
        files[options.to / found[chapter].name] = text
    for file, text in files.items():
        if file.exists() and file.read_text(encoding="utf-8", errors="replace") != text:
            raise ValueError(
                f"to: expected a folder without {file.name}, or with the same one, since it may "
                f"hold somebody's work; {file} differs"
            )
    options.to.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        file.write_text(text, encoding="utf-8")
        print(file)


README = """# Exercises

1. `pip install 'slamlab-course[lab]'`, once; the data that the exercises need comes with it.
2. `jupyter lab` in this folder; open a notebook and replace each `...` by your own lines.
3. Run the check below each exercise as often as you like. It says what it tried and what came.
4. Hand in the notebook under your own name.
"""


def emptied(notebook: dict) -> dict:
    """Take out outputs, and every mention of the solutions."""
    for cell in notebook["cells"]:
        cell.get("metadata", {}).pop("execution", None)
        if cell["cell_type"] == "code":
            cell["outputs"], cell["execution_count"] = [], None
        else:
            text = re.sub(r"[^\n.]*\(\.\./solutions/[^)]*\)[^\n]*", "", "".join(cell["source"]))
            text = re.sub(r"\[([^\]]*)\]\(\.\./[^)]*\)", r"\1", text)
            cell["source"] = text.rstrip().splitlines(keepends=True)
    return notebook
