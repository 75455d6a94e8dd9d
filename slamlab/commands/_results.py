"""A folder of results that is whole or untouched: written beside, moved in when all is there.

What an earlier run left there and this one does not make is taken away, so that one folder never
holds two runs. The page of a run names its files; nothing else is ever removed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

PAGE = "index.html"
_NAMED = re.compile(r'<meta name="slamlab-files" content="([^"]*)">')


@contextmanager
def results(folder: Path, ours: Sequence[str]) -> Iterator[Path]:
    """Give an empty folder to write into; at the end its files go to `folder`, the page last.

    Parameters
    ----------
    folder : Path
        Made if it is not there, and taken away again if nothing comes of it.
    ours : sequence of str
        Names of files that a run may make, besides the page: only these are ever removed.

    Raises
    ------
    OSError
        If something cannot be written; the message names the folder.
    """
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".unfinished-", dir=folder) as name:
            beside = Path(name)
            yield beside
            made = sorted(file.name for file in beside.iterdir())
            page = beside / PAGE
            if page.exists():
                _name_files(page, made)
            for old in sorted(_files_of(folder) & set(ours) - set(made)):
                (folder / old).unlink(missing_ok=True)
            for file in sorted(made, key=lambda file: file == PAGE):
                os.replace(beside / file, folder / file)
    except OSError as error:
        if error.filename is not None and not str(error.filename).startswith(str(folder)):
            raise
        reason = error.strerror or str(error)
        raise OSError(f"{folder}: the results cannot be written ({reason})") from error
    finally:
        for made_by_us in new:
            with suppress(OSError):  # not empty, as a rule
                made_by_us.rmdir()


def _name_files(page: Path, made: Sequence[str]) -> None:
    """Write the names of the files into the head of the page."""
    text = page.read_text(encoding="utf-8")
    meta = f'<meta name="slamlab-files" content="{" ".join(made)}">'
    page.write_text(text.replace("<head>", f"<head>{meta}", 1), encoding="utf-8")


def _files_of(folder: Path) -> set[str]:
    """Names of the files that the page in this folder calls its own."""
    try:
        text = (folder / PAGE).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    found = _NAMED.search(text)
    return set(found[1].split()) if found else set()
