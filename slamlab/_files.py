"""Archives at the door: read a npz of numbers, whatever the file may hold.

Floor 0 of the house; `Log.load`, `SignatureMap.load` and `PathMemory.load` use it.
"""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["read_npz"]

_BROKEN = (
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


def read_npz(path: str | Path, max_bytes: int = 2**30) -> dict[str, NDArray[Any]]:
    """Arrays of a npz archive by name; nothing that would run code (pickle) is read.

    Parameters
    ----------
    path : str or Path
    max_bytes : int, default 2**30
        An archive that says it unpacks to more is refused before anything is unpacked.

    Raises
    ------
    ValueError
        If the file is no such archive, is damaged, or too large.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > max_bytes:
            raise ValueError(f"unpacks to {size} bytes, more than {max_bytes}")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except _BROKEN as error:
        reason = str(error)[:200] or type(error).__name__
        raise ValueError(f"{path}: expected a npz archive of arrays ({reason})") from error
