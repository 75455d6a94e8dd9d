"""Build the book with warnings as errors.

Notebooks run through jupyter-cache, which keys on their cells only. So the cache is dropped when
anything else that they depend on has changed: the lock file, the library, or Python itself.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "_build"
CACHE = BUILD / ".jupyter_cache"
STAMP = BUILD / "cache-key.txt"


def cache_key(root: Path = ROOT) -> str:
    """Hash of everything outside the notebooks that their outputs depend on."""
    digest = hashlib.sha256(sys.version.encode())
    sources = [p for p in (root / "slamlab").rglob("*") if p.suffix in {".py", ".js", ".css"}]
    for path in [root / "requirements.lock", *sorted(sources)]:
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def drop_stale_cache() -> None:
    """Remove the notebook cache, and the pages made from it, if its key has changed."""
    key = cache_key()
    if STAMP.exists() and STAMP.read_text() == key:
        return
    if CACHE.exists():
        print("The library or its dependencies changed: every notebook runs again.", flush=True)
    for folder in (CACHE, BUILD / "html", BUILD / "jupyter_execute"):
        shutil.rmtree(folder, ignore_errors=True)
    BUILD.mkdir(exist_ok=True)
    STAMP.write_text(key)


def main() -> int:
    """Build, and say where the book is."""
    drop_stale_cache()
    begin = time.perf_counter()
    command = [Path(sys.executable).with_name("jupyter-book"), "build", ".", "-W", "-n"]
    status = subprocess.run([*command, "--keep-going"], cwd=ROOT).returncode
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
