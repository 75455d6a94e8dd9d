"""Intervals of Gamma-SLAM's likelihood, one assumption broken at a time: chapter 15b's trial.

python tools/rough_ground.py       (some minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/15b_other_maps.ipynb: it shows them, this runs them.
Writes slamlab/datasets/data/rough_ground.json, which `slamlab.datasets.stored_runs` reads.
"""

import ast
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import ROOT, Trial, main

PAGE = ROOT / "notebooks" / "15b_other_maps.ipynb"
DEFINES = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.ClassDef)


def of_page():
    """Give the page's functions and its constants (in capitals); nothing else of it is run."""
    cells = json.loads(PAGE.read_text(encoding="utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    names = {}
    kept = [
        node
        for node in ast.parse(code).body
        if isinstance(node, DEFINES)
        or isinstance(node, ast.Assign)
        and any(isinstance(n, ast.Name) and n.id.isupper() for n in ast.walk(node.targets[0]))
    ]
    exec(compile(ast.Module(kept, []), str(PAGE), "exec"), names)
    return names


page = of_page()


def one(what, name, seed):
    """Ten pictures of a drive: how many 95 % intervals hold the true place."""
    lines, held = page["WORLDS"][name](seed), page["held"]
    powers = {f"power {power}": held(power * lines) for power in page["POWERS"]}
    places = {f"of {n}": page["by_particles"](lines, n, seed) for n in page["PLACES"]}
    counts = {"held": held(lines), "smoothed": held(page["smooth"](lines))} | powers | places
    return {key: int(n) for key, n in counts.items()}


TRIAL = Trial(
    "rough_ground",
    {("pictures", name): range(1, 21) for name in page["WORLDS"]},
    one,
    sample=(
        ("pictures", "... of these, only mixed roughness", 3),
        ("pictures", "the ground, camera leans", 4),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
