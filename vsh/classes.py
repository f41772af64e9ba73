"""Classes of sources: between edges of a column, parts of as many sources, halves of the sky, conditions on a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from vsh.field import Field
from vsh.io.parts import Parts
from vsh.sky.frames import check_frame, rotation_matrix, title_of
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, EmptyFieldError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Classes(InNotebook):
    """Classes that sources are divided into: fitted each by itself, or together with their common systematic errors.

    Attributes
    ----------
    labels : tuple of str
        What they are called.
    masks : (k, n) array, or None
        Which of n sources are in each; None where conditions or a frame tell it of any.
    conditions : tuple of str
        The rows of each in a table, as `where` of the readers has them.
    frame : str
        Its northern and southern half of the sky are the classes.

    Examples
    --------
    >>> magnitude = np.array([17.2, 18.0, 18.4, 20.1])
    >>> classes = Classes.by_edges("G", (18, 19), magnitude)
    >>> classes.labels
    ('G < 18', '18 ≤ G < 19', 'G ≥ 19')
    >>> [int(mask.sum()) for _, mask in classes]
    [1, 2, 1]
    >>> Classes.by_edges("phot_g_mean_mag", (18,)).conditions
    ('phot_g_mean_mag < 18', 'phot_g_mean_mag >= 18')
    """

    labels: tuple[str, ...]
    masks: BoolArray | None = None
    conditions: tuple[str, ...] = ()
    frame: str = ""

    def __len__(self) -> int:
        return len(self.labels)

    def __iter__(self) -> Iterator[tuple[str, BoolArray]]:
        return zip(self.labels, self._get_masks())

    def _get_masks(self) -> BoolArray:
        if self.masks is None:
            raise ParameterError("these classes have no masks: .of(field) gives those of halves, values others")
        return self.masks

    @classmethod
    def by_edges(
        cls,
        name: str,
        edges: Sequence[float] | FloatArray,
        values: ArrayLike | None = None,
        *,
        closed: str = "left",
        ends: bool = True,
    ) -> Classes:
        """Classes between edges, below the first and beyond the last.

        Parameters
        ----------
        name : str
            What the values are called; of a column, where they are not given.
        edges : sequence of float
            Rising.
        values : (n,) array, optional
            One for each source; those that are nan are in no class. Without them the classes are conditions.
        closed : {"left", "right"}
            Which edge belongs to a class.
        ends : bool
            Whether what is below the first edge and beyond the last are classes, too.

        Raises
        ------
        ParameterError
            If there is no edge, or they do not rise.
        """
        if not len(edges) or not (np.diff(edges) > 0).all():
            raise ParameterError(f"edges of classes are numbers that rise, not {edges!r}")
        upper_sign, greater_sign = ("<", ">=") if closed == "left" else ("<=", ">")
        lower_sign = "<=" if closed == "left" else "<"

        def format_intervals(texts):
            inner = [f"{lower} {lower_sign} {name} {upper_sign} {upper}" for lower, upper in pairwise(texts)]
            interval_texts = (f"{name} {upper_sign} {texts[0]}", *inner, f"{name} {greater_sign} {texts[-1]}")
            return interval_texts if ends else interval_texts[1:-1]

        edge_texts = [_format_fully(edge) for edge in edges]
        tolerance = 1e-3 * min(np.diff(edges), default=0.0)
        rounded_texts = [[f"{edge:.{digits}g}" for digits in (4, 7, 10)] for edge in edges]
        short = [
            text if len(text) <= 8 else next((t for t in candidates if abs(float(t) - edge) <= tolerance), text)
            for text, candidates, edge in zip(edge_texts, rounded_texts, edges, strict=True)
        ]
        conditions = format_intervals(edge_texts)
        labels = format_intervals(short if len({*short}) == len(short) else edge_texts)  # quantiles have sixteen digits
        labels = tuple(label.replace("<=", "≤").replace(">=", "≥") for label in labels)
        if values is None:
            return cls(labels, conditions=conditions)
        numbers = np.asarray(values, float)
        class_indices = np.where(
            np.isnan(numbers), -1, np.searchsorted(edges, numbers, "right" if closed == "left" else "left")
        )
        return cls(labels, class_indices == np.arange(len(labels))[:, None] + (not ends))

    @classmethod
    def by_parts(cls, name: str, values: ArrayLike, k: int) -> Classes:
        """Classes of about as many sources each.

        Parameters
        ----------
        name : str
            What the values are called.
        values : (n,) array
            One for each source; those that are nan are in no class.
        k : int
            How many; as many as there are values where these are fewer.

        Raises
        ------
        DegeneracyError
            If all sources have the same value.
        """
        numbers = np.asarray(values, float)
        distinct = np.unique(numbers[np.isfinite(numbers)])
        if len(distinct) < 2:
            raise DegeneracyError(f"{name} is the same for all sources")
        if len(distinct) <= k:
            return cls(tuple(f"{name} = {_format_fully(value)}" for value in distinct), numbers == distinct[:, None])
        quantiles = np.unique(np.nanquantile(numbers, np.arange(1, k) / k))
        quantiles = quantiles[quantiles > distinct[0]] if quantiles[-1] > distinct[0] else distinct[1:2]
        largest_gap = np.diff(quantiles, prepend=distinct[0], append=distinct[-1]).max()
        for digits in (4, 6, 8, 17):  # as few as leave the classes what they are
            edges = [float(f"{edge:.{digits}g}") for edge in quantiles]
            if np.abs(edges - quantiles).max() < 0.05 * largest_gap and (np.diff(edges, prepend=distinct[0]) > 0).all():
                break
        return cls.by_edges(name, edges, numbers)

    @classmethod
    def by_halves(cls, frame: str) -> Classes:
        """The two halves of the sky beside the equator of a `frame`: "icrs", "galactic", "ecliptic"."""
        check_frame(frame)
        return cls((f"northern {title_of(frame)} half", f"southern {title_of(frame)} half"), frame=frame)

    @classmethod
    def from_text(cls, text: str) -> Classes:
        """Classes as `vsh-fit --classes` takes them.

        Parameters
        ----------
        text : str
            COLUMN:EDGE,EDGE; conditions between semicolons; or halves:FRAME.

        Raises
        ------
        ParameterError
            If the text is in none of these forms.
        """
        if ";" in text:
            conditions = tuple(condition.strip() for condition in text.split(";") if condition.strip())
            return cls(conditions, conditions=conditions)
        name, _, remainder = text.rpartition(":")
        if name.strip() == "halves":
            return cls.by_halves(remainder.strip())
        if name.strip():
            with suppress(ValueError):  # no number, or edges that do not rise
                return cls.by_edges(name.strip(), [float(edge) for edge in remainder.split(",")])
        raise ParameterError(
            "classes are COLUMN:EDGE,EDGE with edges that rise, conditions between semicolons, or halves:FRAME, not "
            f"{text!r}"
        )

    def of(self, field: Field) -> Classes:
        """Halves of the sky as masks of the sources of a `field`; other classes as they are."""
        if not self.frame:
            return self
        is_northern = (rotation_matrix(field.frame, self.frame) @ triad(field.lon, field.lat)[2])[2] >= 0
        return replace(self, masks=np.array([is_northern, ~is_northern]), frame="")

    def within(self, mask: BoolArray) -> Classes:
        """Restrict the classes to the sources of a `mask`, (n,)."""
        return replace(self, masks=self._get_masks() & mask)

    def of_at_least(self, n: int) -> Classes:
        """Select the classes that have `n` sources or more."""
        is_large = self._get_masks().sum(1) >= n
        return replace(self, labels=tuple(np.array(self.labels)[is_large].tolist()), masks=self._get_masks()[is_large])

    def split(self, sources: Field | Parts) -> list[Field] | list[Parts]:
        """The sources of each class, in memory or in parts; by masks in memory alone.

        Parameters
        ----------
        sources : Field or Parts
            All of them.

        Raises
        ------
        ParameterError
            If parts are to be split other than by halves of the sky.
        """
        if isinstance(sources, Parts):
            if not self.frame:
                raise ParameterError("only halves of the sky split a catalogue in parts: others take .map or --where")
            return [sources.map(partial(_select_class, classes=self, class_index=i)) for i in range(len(self))]
        return [sources[mask] for _, mask in self.of(sources)]


def _format_fully(number):
    """Text of a number with all of its digits."""
    return f"{number:g}" if float(f"{number:g}") == number else repr(float(number))


def _select_class(field, classes, class_index):
    """The sources of class i in one part."""
    selected = field[classes.of(field).masks[class_index]]
    if not len(selected):
        raise EmptyFieldError(f"this part of the catalogue has no source in the {classes.labels[class_index]}")
    return selected
