"""Check what `make dist` built: its contents, and that it works where nothing else is installed.

python tools/check_distribution.py dist                contents; then, in an empty environment
                                                       elsewhere, the README's lines, help, map
                                   dist --no-install   contents only
                                   --tag v1.0.0        the tag names the version of this project
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
# What stays in the checkout: of no use without it.
CHECKOUT_ONLY = re.compile(r"\.|MANIFEST\.in$")
DRIVE = """
from slamlab.datasets import killian
killian().log[:20].save("drive.npz")
"""


def tracked(root: Path = ROOT) -> set[str]:
    """Return the names of the files that git knows."""
    words = ["git", "ls-files", "-z", "--cached"]
    listed = subprocess.run(words, cwd=root, capture_output=True, text=True, check=True).stdout
    return {name for name in listed.split("\0") if name and (root / name).exists()}


def wheel_troubles(names: set[str], files: set[str]) -> list[str]:
    """Say what a wheel lacks or has too much, by the names inside and the files of the project."""
    wanted = {name for name in files if name.startswith("slamlab/")}
    inside = {name for name in names if not name.partition("/")[0].endswith(".dist-info")}
    found = [f"the wheel lacks {name}" for name in sorted(wanted - inside)]
    found += [f"the wheel has {name} too" for name in sorted(inside - wanted)]
    licences = {name.rpartition("/licenses/")[2] for name in names if "/licenses/" in name}
    lacking = {"LICENSE", "LICENSE-text"} - licences
    return found + [f"the wheel lacks the licence {name}" for name in sorted(lacking)]


def sdist_troubles(names: set[str], files: set[str]) -> list[str]:
    """Say what a source archive lacks or has too much."""
    inside = {name.partition("/")[2] for name in names} - {""}
    wanted = {name for name in files if not CHECKOUT_ONLY.match(name)}
    folders = {parent.as_posix() for name in wanted for parent in Path(name).parents}
    made = re.compile(r"PKG-INFO|setup\.cfg|slamlab_course\.egg-info(/|$)|MANIFEST\.in|\.")
    found = [f"the source archive lacks {name}" for name in sorted(wanted - inside)]
    extra = sorted(name for name in inside - wanted - folders if not made.match(name))
    return found + [f"the source archive has {name} too" for name in extra]


def archives(folder: Path) -> tuple[Path, Path]:
    """Return the one wheel and the one source archive of this version."""
    found = sorted(path.name for path in folder.iterdir())
    wheel = f"slamlab_course-{VERSION}-py3-none-any.whl"
    sdist = f"slamlab_course-{VERSION}.tar.gz"
    if found != sorted([wheel, sdist]):
        raise SystemExit(f"{folder}: expected {wheel} and {sdist}, got {', '.join(found)}")
    return folder / wheel, folder / sdist


def contents(folder: Path) -> list[str]:
    """Compare what is in both archives with what git knows."""
    wheel, sdist = archives(folder)
    with zipfile.ZipFile(wheel) as file:
        names = {name for name in file.namelist() if not name.endswith("/")}
    files = tracked()
    found = wheel_troubles(names, files)
    with tarfile.open(sdist) as file:
        found += sdist_troubles(set(file.getnames()), files)
    sizes = f"{wheel.stat().st_size / 1e6:.1f} MB, {sdist.stat().st_size / 1e6:.1f} MB"
    print(f"{len(names)} files in the wheel; wheel and source archive {sizes}")
    return found


def try_out(wheel: Path) -> None:
    """Install a wheel into an empty environment, away from the checkout, and use it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "env", with_pip=True)
        python = folder / "env" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

        def run(*words: str) -> str:
            command = [str(python), *words]
            done = subprocess.run(command, cwd=folder, env=clean, capture_output=True, text=True)
            if done.returncode:
                raise SystemExit(f"{' '.join(words)[:80]}:\n{done.stdout}{done.stderr}")
            return done.stdout

        run("-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(wheel))
        where = run("-c", "import slamlab; print(slamlab.__file__)")
        if not Path(where.strip()).resolve().is_relative_to(folder.resolve()):
            raise SystemExit(f"slamlab was imported from {where}")
        said = run("-m", "slamlab", "--version").strip()
        if said != f"slamlab {VERSION}":
            raise SystemExit(f"--version: expected slamlab {VERSION}, got {said}")
        for block in re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S):
            print(run("-c", block), end="")
        if "map" not in run("-m", "slamlab", "--help"):
            raise SystemExit("--help: expected it to name map")
        run("-c", DRIVE)
        run("-m", "slamlab", "map", "drive.npz", "-o", "out")
        made = sorted(path.name for path in (folder / "out").iterdir())
        if not {"map.yaml", "map.pgm", "trajectory.tum", "index.html"} <= set(made):
            raise SystemExit(f"map: expected a map, a path and a report, got {', '.join(made)}")
        print(f"installed alone, {said}: the README's lines, help and map work")


def main(argv: list[str] | None = None) -> int:
    """Check; print what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "dist")
    parser.add_argument("--no-install", action="store_true")
    parser.add_argument("--tag", help="compare a release's tag with the version, and stop")
    options = parser.parse_args(argv)
    if options.tag is not None:
        if options.tag != f"v{VERSION}":
            print(f"tag: expected v{VERSION}, got {options.tag or 'none'}")
            return 1
        return 0
    found = contents(options.folder.resolve())
    if found:
        print(*found, sep="\n")
        return 1
    if not options.no_install:
        try_out(archives(options.folder.resolve())[0])
    return 0


if __name__ == "__main__":
    sys.exit(main())
