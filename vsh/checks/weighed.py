"""Values and their errors: weights, χ², sums over the components of each source."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar, Self, cast

import numpy as np

from vsh.checks.frozen import Frozen
from vsh.checks.notes import merge_notes
from vsh.checks.types import FloatArray
from vsh.errors import FieldError, FrameError


class Weighed(Frozen):
    """What a noun with values and errors knows of their weights; each source has `components` of them.

    Attributes
    ----------
    components : int
        Two of a motion, one of a scalar.
    data : (components, n) array
        The values.
    weights : (3, n) or (1, n) array
        The inverse covariance of each source: a, b, c of [[a, c], [c, b]], or a alone.
    frame : str
        Of the axes.
    notes : tuple of str
        What a reader of any result should know.
    """

    components: ClassVar[int]
    frame: str
    notes: tuple[str, ...]

    @property
    def data(self) -> FloatArray:
        """The values of each source, (components, n)."""
        raise NotImplementedError

    @property
    def weights(self) -> FloatArray:
        """The inverse covariance of each source, (3, n) or (1, n)."""
        raise NotImplementedError

    def __getitem__(self, keep: Any) -> Self:
        """The sources picked by a mask, a slice or indices."""
        if isinstance(keep, (int, np.integer)):
            keep = [keep]
        if isinstance(keep, str):
            raise FieldError(f"sources are picked by a mask, a slice or indices; the column is field.{keep}")
        own = ((each.name, getattr(self, each.name)) for each in fields(cast(Any, self)))
        return self._with(**{name: value[..., keep] for name, value in own if isinstance(value, np.ndarray)})

    def check_frame(self, frame: str) -> None:
        """Raise FrameError unless the sources are in a frame."""
        if self.frame != frame:
            raise FrameError(f'the fit is in {frame}, the field in {self.frame}: use .to_frame("{frame}")')

    def add_note(self, *notes: str) -> Self:
        """The same with more that its reader should know."""
        return self._with(notes=merge_notes((*self.notes, *notes)))

    def _with(self, **changes: Any) -> Self:
        """The same with other attributes."""
        raise NotImplementedError

    def inner(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """xᵀ C⁻¹ y of each source, (n,), for two sets of values."""
        return np.sum(x * weighed(self.weights, y), axis=0)

    @property
    def chi2(self) -> FloatArray:
        """µᵀ C⁻¹ µ of each source: the χ² of its value against none, (n,)."""
        return self.inner(self.data, self.data)

    @property
    def information(self) -> FloatArray:
        """The trace of each source's inverse covariance, (n,): its weight in sums over all components. [(yr/µas)²]"""
        return self.weights[: self.components].sum(0)


def weighed(weights: FloatArray, values: FloatArray) -> FloatArray:
    """W x of each source.

    Examples
    --------
    >>> weighed(np.array([[2.0], [3.0], [0.5]]), np.array([[1.0], [2.0]])).ravel()
    array([3. , 6.5])
    """
    if len(weights) == 1:
        return weights * values
    a, b, c = weights
    x, y = values[..., 0, :], values[..., 1, :]
    return np.stack([a * x + c * y, c * x + b * y], axis=-2)
