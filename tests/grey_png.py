"""Grey PNG files, as arrays of the pixels' rows."""

import numpy
from PIL import Image


def read_png(path):
    """Of 8 or 16 bits."""
    with Image.open(path) as image:
        return numpy.array(image)


def write_png(path, rows):
    """Of 16 bits."""
    Image.fromarray(numpy.array(rows, numpy.uint16)).save(path)
