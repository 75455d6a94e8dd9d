"""Pictures of the book are made small, and none loses what an eye would see."""

import io

import numpy as np
import pytest
from PIL import Image

from tools.pictures import small_png, small_svg


def png(pixels):
    """Return an array of shape (rows, columns, 3 or 4) as the bytes of a picture."""
    file = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(file, "png")
    return file.getvalue()


def pixels_of(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), int)


def shades(spread):
    """Return pixels of reds spread wide and greens spread little: more than a palette holds."""
    draws = np.random.default_rng(0).normal(size=(200, 300, 2))
    return np.clip(128 + draws @ [[spread, 0, 0], [0, 3, 0]], 0, 255).astype(int)


def test_a_figure_of_few_colours_stays_as_it_was():
    rng = np.random.default_rng(0)
    figure = rng.integers(0, 256, (200, 3))[rng.integers(0, 200, (200, 300))]
    small = small_png(png(figure))
    assert Image.open(io.BytesIO(small)).mode == "P"
    np.testing.assert_array_equal(pixels_of(small), figure)


@pytest.mark.parametrize(("spread", "means"), [(20, False), (40, True)])
def test_many_shades_keep_within_half_a_step(spread, means):
    few = Image.fromarray(shades(spread).astype(np.uint8)).quantize(256, dither=0)
    without = np.abs(np.asarray(few.convert("RGB"), int) - shades(spread)).mean()
    assert (without > 0.5) == means, "without means of colours it would be too far off"
    small = small_png(png(shades(spread)))
    assert Image.open(io.BytesIO(small)).mode == "P"
    assert np.abs(pixels_of(small) - shades(spread)).mean() < 0.5


def test_what_a_palette_would_spoil_is_returned_as_it_came():
    noise = np.random.default_rng(0).integers(0, 256, (100, 100, 3))
    assert small_png(png(noise)) == png(noise)
    glass = np.full((50, 50, 4), 128)
    assert small_png(png(glass)) == png(glass)


def test_a_drawing_keeps_hundredths_of_a_point():
    drawing = (
        '<metadata>\n by me\n</metadata><path d="M 1.23456 7\n L 2.5 -0.999"/>\n  <g x="3.14159"/>'
    )
    assert small_svg(drawing) == '<path d="M 1.23 7 L 2.5 -0.99"/>\n<g x="3.14"/>'
