"""Files of other people at the door: nothing is unpacked without a limit, whatever they hold.

Everything that reads a log, a graph, a map or an archive of ours comes through here.
"""

from __future__ import annotations

import gzip
import io
import lzma
import os
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["about", "read_bytes", "read_npz"]

MOST_BYTES = 2**28
# Arrays that somebody measured do not shrink to a hundredth: an archive may unpack to this much.
_USUAL_BYTES, _RATIO = 2**27, 100

_BROKEN = (
    lzma.LZMAError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)


@contextmanager
def about(name: str) -> Iterator[None]:
    """Whatever cannot be done inside is said with the name of the file."""
    try:
        yield
    except (ValueError, MemoryError) as error:
        if name in str(error):
            raise
        raise ValueError(f"{name}: {str(error) or type(error).__name__}") from error


def read_npz(
    path: str | os.PathLike[str], max_bytes: int = 2**30, what: str = "npz archive of arrays"
) -> dict[str, NDArray[Any]]:
    """Arrays of a npz archive by name; nothing that would run code (pickle) is read.

    Parameters
    ----------
    path : str or Path
    max_bytes : int, default 2**30
        An archive that says it unpacks to more, or to more than 128 MB and a hundred times its
        size, is refused before anything is unpacked.
    what : str
        What was expected, for the message.

    Raises
    ------
    ValueError
        If the file is no such archive, is damaged, or too large.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    path.stat()  # a file that is not there is no damaged one
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > max_bytes:
            raise ValueError(f"unpacks to {size} bytes, more than {max_bytes}")
        packed = path.stat().st_size
        if size > max(_USUAL_BYTES, _RATIO * packed):
            raise ValueError(f"unpacks to {size} bytes, {size / packed:.0f} times what it has")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (*_BROKEN, OSError) as error:
        reason = str(error)[:200] or type(error).__name__
        raise ValueError(f"{path}: expected a {what} ({reason})") from error


def read_bytes(
    path: str | os.PathLike[str],
    wanted: Callable[[str], bool] = lambda name: True,
    max_bytes: int = MOST_BYTES,
) -> bytes:
    """Content of a file; a gzip, or the one wanted member of a zip, is opened on the way.

    Parameters
    ----------
    path : str or Path
    wanted : callable, optional
        ``wanted(name) -> bool`` says which member of a zip is meant.
    max_bytes : int, default 2**28
        More than this is not unpacked.

    Raises
    ------
    ValueError
        If the archive is damaged, has no or several wanted members, or unpacks to too much.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    data = path.read_bytes()
    try:
        if data[:2] == b"\x1f\x8b":
            with gzip.open(io.BytesIO(data)) as file:
                return _at_most(file, max_bytes)
        if data[:2] == b"PK":
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                members = [name for name in archive.namelist() if wanted(name)]
                if len(members) != 1:
                    raise ValueError(f"expected one file to read in it, got {members!r:.200}")
                with archive.open(members[0]) as member:
                    return _at_most(member, max_bytes)
    except (*_BROKEN, OSError) as error:
        raise ValueError(f"{path}: cannot unpack the archive: {str(error)[:200]}") from error
    return data


def _at_most(file: Any, max_bytes: int) -> bytes:
    data: bytes = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise ValueError(f"it unpacks to more than {max_bytes} bytes")
    return data
