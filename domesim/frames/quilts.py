"""Quilts: many views of one moment as tiles of one picture, as displays without glasses take them.

The name says the layout, by Looking Glass's convention: ``show_qs8x6a0.75.png`` has 8 columns and 6
rows of views that are shown 0.75 times as wide as high. The first view is the leftmost camera's; it
is at the bottom left, the next is right of it, and the last is at the top right. Views have whole
pixels: what the picture's width and height leave over is on the right and on top, and is nobody's.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

_LAYOUT = re.compile(r"_qs(\d{1,3})x(\d{1,3})a\d+")


@final
@dataclass(frozen=True)
class Quilt:
    """Layout of a quilt.

    Parameters
    ----------
    across, down
        Columns and rows of views.
    size
        (row, col) pixels of the picture.
    """

    across: int
    down: int
    size: tuple[int, int]

    @property
    def view(self) -> tuple[int, int]:
        """(row, col) pixels of a view."""
        return self.size[0] // self.down, self.size[1] // self.across

    def __str__(self) -> str:
        """As a person reads it: ``a quilt of 8 x 6 views``."""
        return f"a quilt of {self.across} x {self.down} views"

    def taken_apart(self, picture: NDArray[Any]) -> list[NDArray[Any]]:
        """Takes a picture's views out, the leftmost camera's first.

        Parameters
        ----------
        picture
            (row, col, ...) of `size`.

        Returns
        -------
        views
            (row, col, ...) each.
        """
        rows, cols = self.view
        below = [self.size[0] - rows * down for down in range(1, self.down + 1)]
        places = [(top, cols * across) for top in below for across in range(self.across)]
        return [picture[top : top + rows, left : left + cols] for top, left in places]

    def put_together(self, views: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Makes a picture of views; what is nobody's repeats the pixels beside it.

        Parameters
        ----------
        views
            As `taken_apart` returns them.

        Returns
        -------
        picture
            (row, col, ...) of `size`.
        """
        rows, cols = self.view
        whole = np.empty((*self.size, *views[0].shape[2:]), views[0].dtype)
        for place, view in zip(self.taken_apart(whole), views, strict=True):
            place[...] = view
        top, right = self.size[0] - rows * self.down, cols * self.across
        whole[:top, :right] = whole[top, :right]
        whole[:, right:] = whole[:, right - 1 : right]
        return whole


def layout_in(path: Path) -> tuple[int, int] | None:
    """Columns and rows of views that a file's name states; None if it states none."""
    found = _LAYOUT.search(path.name)
    return None if found is None else (int(found[1]), int(found[2]))
