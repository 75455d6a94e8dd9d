"""Build the book: run its notebooks on all cores, compare what they say, write the pages.

python tools/build_book.py                                build; name the cells whose text is new
python tools/build_book.py --setting plain --strict       as on a machine without AVX; a cell whose
                                                          text differs from git's fails the build
                           --no-pages                     stop before the pages are written

Executed notebooks are kept by jupyter-cache, which keys on their cells only. So the cache is
dropped when anything else that they depend on has changed: the lock file, the library, or Python.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import nbformat
import yaml
from jupyter_cache import get_cache
from jupyter_cache.base import CacheBundleIn, JupyterCacheAbstract

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.notebooks import SETTINGS, differences, n_cores, run_all
from tools.pictures import make_small

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "_build"
CACHE = BUILD / ".jupyter_cache"
STAMP = BUILD / "cache-key.json"
SECONDS = BUILD / "seconds.json"


def cache_key(root: Path = ROOT) -> str:
    """Hash of everything outside the notebooks that their outputs depend on."""
    digest = hashlib.sha256(sys.version.encode())
    sources = [p for p in (root / "slamlab").rglob("*") if p.is_file() and p.suffix != ".pyc"]
    sources = [p for p in sources if "__pycache__" not in p.parts]
    sources += (root / "tools").glob("pictures.py")
    for path in [root / "requirements.lock", *sorted(sources)]:
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def read_json(path: Path) -> dict:
    """Return what a file of ours holds, or nothing."""
    return json.loads(path.read_text()) if path.exists() else {}


def drop_stale_cache(setting: str) -> None:
    """Remove the executed notebooks, and the pages made from them, if they count no more.

    Outputs of the plain setting serve a reader as well as those of this machine; but who asks
    for the plain setting wants to see it run.
    """
    stamp, key = read_json(STAMP), cache_key()
    fits = setting in ("own", stamp.get("setting"))
    if stamp.get("key") == key and fits:
        return
    if CACHE.exists():
        why = "The library or its dependencies changed" if fits else "Another setting"
        print(f"{why}: every notebook runs again.", flush=True)
    for folder in (CACHE, BUILD / "html", BUILD / ".doctrees", BUILD / "jupyter_execute"):
        shutil.rmtree(folder, ignore_errors=True)
    BUILD.mkdir(exist_ok=True)
    STAMP.write_text(json.dumps({"key": key, "setting": setting}))


def book_notebooks(root: Path = ROOT) -> list[Path]:
    """Return the notebooks of the table of contents."""

    def files(node: object) -> list[str]:
        if isinstance(node, dict):
            own = [node[key] for key in ("root", "file") if key in node]
            return own + [name for value in node.values() for name in files(value)]
        return [name for item in node for name in files(item)] if isinstance(node, list) else []

    names = files(yaml.safe_load((root / "_toc.yml").read_text()))
    paths = [root / f"{name}.ipynb" for name in names]
    return [path for path in paths if path.exists()]


def is_cached(cache: JupyterCacheAbstract, path: Path) -> bool:
    """Whether the cells of a notebook have been run."""
    try:
        cache.match_cache_notebook(nbformat.read(path, as_version=4))
    except KeyError:
        return False
    return True


def remaining(names: set[str], seconds: dict[str, float], jobs: int) -> str:
    """Words for how much is left: a time, if that of each notebook is known."""
    known = [seconds[name] for name in names if name in seconds]
    if not names or len(known) < len(names):
        return f"{len(names)} left"
    return f"{len(names)} left, about {max(sum(known) / jobs, max(known)):.0f} s"


def execute(cache: JupyterCacheAbstract, setting: str) -> bool:
    """Run on all cores what is not in the cache, a line for each; say whether all went well."""
    seconds, ended_well = read_json(SECONDS), True
    paths = {
        str(path.relative_to(ROOT)): path
        for path in book_notebooks()
        if not is_cached(cache, path)
    }
    # The longest first, so that no core waits for it in the end; else the labs and chapters.
    small = ("exercises", "solutions")
    guess = {name: 0.0 if path.parent.name in small else 1e9 for name, path in paths.items()}
    order = sorted(paths, key=lambda name: -seconds.get(name, guess[name]))
    todo, jobs = set(order), max(1, min(n_cores(), len(order)))
    if order:
        print(f"{jobs} cores, notebooks: {remaining(todo, seconds, jobs)}", flush=True)
    for done in run_all([paths[name] for name in order], setting, jobs):
        name = str(done.path.relative_to(ROOT))
        todo.remove(name)
        seconds[name] = round(done.seconds, 1)
        if done.error:
            ended_well = False
            print(f"\n{name} failed:\n{done.error}", flush=True)
            continue
        make_small(done.notebook)
        took = {"execution_seconds": done.seconds}
        bundle = CacheBundleIn(done.notebook, str(done.path), data=took)
        cache.cache_notebook_bundle(bundle, check_validity=False, overwrite=True)
        left = remaining(todo, seconds, jobs)
        print(f"{done.seconds:6.1f} s  {name:58s} {left}", flush=True)
    SECONDS.write_text(json.dumps(seconds, indent=0, sort_keys=True))
    return ended_well


def compare(cache: JupyterCacheAbstract) -> list[str]:
    """Name each cell whose text is not what git holds."""
    found = []
    for path in book_notebooks():
        stored, name = nbformat.read(path, as_version=4), path.relative_to(ROOT)
        if not is_cached(cache, path):
            found.append(f"{name} was changed while notebooks ran: build again")
            continue
        _, fresh = cache.merge_match_into_notebook(stored)
        found += [f"{name}, {paragraph}" for paragraph in differences(stored, fresh)]
    return found


def write_pages() -> int:
    """Let Jupyter Book write the pages from the cache, with warnings as errors."""
    command = [Path(sys.executable).with_name("jupyter-book"), "build", ".", "-W", "-n"]
    done = subprocess.run(
        [*command, "--keep-going", "-q"], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    if done.returncode:
        print(done.stdout)
        # A page that was read is not read again, and its warning would not come again.
        shutil.rmtree(BUILD / ".doctrees", ignore_errors=True)
    trim(BUILD / "html")
    return done.returncode


ICON = re.compile(
    r"""(?:"([\w-]+)"|(\w+)):\[\d+,\d+,\[[^][]*\],"\w+",(?:"[^"]*"|\["[^"]*","[^"]*"\])\],?"""
)


def trim(html: Path) -> None:
    """Drop what no reader opens: maps of scripts, translations, old fonts, icons of no page."""
    static = html / "_static"
    shutil.rmtree(static / "locales", ignore_errors=True)
    unused = [*static.rglob("*.map"), *(html / "_sources").rglob("*.md")]
    unused += [font for font in static.rglob("*.ttf") if font.with_suffix(".woff2").exists()]
    for path in unused:
        path.unlink()
    scripts = [path for path in static.rglob("*.js") if path.name != "fontawesome.js"]
    texts = [path.read_text(encoding="utf-8") for path in [*html.rglob("*.html"), *scripts]]
    # A style sheet inside a script names each icon that there is, behind a dot.
    used = {name for text in texts for name in re.findall(r"(?<!\.)\bfa-([\w-]+)", text)}
    icons = static / "scripts" / "fontawesome.js"
    if icons.exists():
        known = icons.read_text(encoding="utf-8")
        kept = ICON.sub(lambda entry: entry[0] if (entry[1] or entry[2]) in used else "", known)
        icons.write_text(kept, encoding="utf-8")


def main() -> int:
    """Build, and say where the book is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--setting", choices=SETTINGS, default="own")
    parser.add_argument("--strict", action="store_true", help="fail if the text of a cell differs")
    parser.add_argument("--no-pages", action="store_true", help="run and compare only")
    arguments = parser.parse_args()
    drop_stale_cache(arguments.setting)
    os.environ["SLAMLAB_VECTOR"] = "1"  # pages get drawings where they are small
    begin = time.perf_counter()
    cache = get_cache(CACHE)
    if not execute(cache, arguments.setting):
        return 1
    found = compare(cache)
    if found:
        print("\nThe text of these cells is not what the notebook holds:", *found, sep="\n")
        if arguments.strict:
            return 1
    print(f"Notebooks done after {time.perf_counter() - begin:.0f} s.", flush=True)
    if arguments.no_pages:
        return 0
    status = write_pages()
    minutes = (time.perf_counter() - begin) / 60
    if status:
        print(f"\nThe book did not build ({minutes:.1f} minutes); the warnings above say why.")
        return status
    page = (BUILD / "html" / "index.html").relative_to(ROOT)
    print(f"\nThe book is built ({minutes:.1f} minutes). Open {page} in a browser, or serve it:")
    print(f"  {os.path.relpath(sys.executable, ROOT)} -m http.server --directory _build/html 8000")
    return 0


if __name__ == "__main__":
    sys.exit(main())
