"""Pictures of executed notebooks, made small for the book: what the eye does not see is left out.

A figure has few colours: 256 of them in a palette take a third of the bytes. A point of a drawing
needs no millionth of a pixel.
"""

from __future__ import annotations

import base64
import io
import re

import nbformat
import numpy as np
from PIL import Image

NUMBERS = re.compile(r'(\b(?:d|x|y|x1|x2|y1|y2|points)="|translate\()([^")]*)')
METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)


def small_png(data: bytes, allowed: float = 0.5) -> bytes:
    """Return the picture with a palette, if its mean error is below `allowed` of 255 steps."""
    picture = Image.open(io.BytesIO(data))
    if picture.mode == "RGBA":
        if picture.getchannel("A").getextrema()[0] < 255:
            return data
        picture = picture.convert("RGB")
    if picture.mode != "RGB":
        return data
    for kmeans in (0, 1):  # means of colours take several times as long: for many shades only
        few = picture.quantize(256, kmeans=kmeans, dither=Image.Dither.NONE)
        error = np.abs(np.asarray(few.convert("RGB"), int) - np.asarray(picture, int)).mean()
        if error < 0.5 * allowed:
            break
    file = io.BytesIO()
    few.save(file, "png", optimize=True)
    worth = error < allowed and len(file.getvalue()) < len(data)
    return file.getvalue() if worth else data


def small_svg(text: str) -> str:
    """Return the drawing with hundredths of a point, without blanks and notes of its maker."""

    def rounded(match: re.Match[str]) -> str:
        return match[1] + re.sub(r"(\.\d\d)\d+", r"\1", match[2]).replace("\n", "")

    text = NUMBERS.sub(rounded, METADATA.sub("", text))
    return re.sub(r"\n\s*", "\n", text)


def make_small(notebook: nbformat.NotebookNode) -> None:
    """Replace the pictures of an executed notebook by smaller ones."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                small = small_png(base64.b64decode(data["image/png"]))
                data["image/png"] = base64.b64encode(small).decode()
            if "image/svg+xml" in data:
                data["image/svg+xml"] = small_svg(data["image/svg+xml"])
