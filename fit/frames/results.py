"""The interface of all results on frames: pairs of catalogues, their vectors, the result to quote, and a table."""

from typing import Any

from fit.results.output import words_of
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Answer
from vsh.tools.types import Table
from vsh.vector import Vector

__all__ = ["FrameResult"]


class FrameResult(Result):
    """A result on the frames of catalogues: two of them, a chain of several, or a link at all magnitudes.

    Examples
    --------
    >>> import numpy as np
    >>> from fit.frames.compare import compare_catalogues
    >>> from vsh import Coefficients, Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 300), np.arcsin(rng.uniform(-1, 1, 300))
    >>> spins = [Coefficients.from_vectors((0, 0, z)).at(lon, lat) for z in (5, 0)]
    >>> noise, errors, names = rng.normal(size=(2, 300)), np.ones((2, 300)), np.arange(300).astype(str)
    >>> one, two = (Field(lon, lat, spin + noise, errors, name=names) for spin in spins)
    >>> comparison, _ = compare_catalogues(one, two, 1, labels=("one", "two"))
    >>> comparison.pairs
    (('one', 'two'),)
    >>> (comparison.vectors()["rotation"].value.round() + 0).tolist()
    [0.0, 0.0, 5.0]
    """

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The catalogues that are compared: each with the one that is subtracted."""
        raise NotImplementedError

    def vectors(self, one: str | None = None, two: str | None = None) -> dict[str, Vector]:
        """Rotation and glide (orientation and spin of a link) of a pair, by name.

        Parameters
        ----------
        one, two : str, optional
            The catalogue, and the one that is subtracted; the first of the `pairs` unless given.
        """
        raise NotImplementedError

    @property
    def answer(self) -> Answer:
        """The result to quote: the vectors of each pair."""
        several = len(self.pairs) > 1
        lines = [
            (f"{catalogue} − {reference}: {name}" if several else name, words_of(vector))
            for catalogue, reference in self.pairs
            for name, vector in self.vectors(catalogue, reference).items()
        ]
        return Answer(tuple(lines))

    @property
    def verdict(self) -> str:
        """The result to quote, as one sentence."""
        return self.answer.sentence

    def frames_table(self) -> Table:
        """The vectors of all pairs with their errors and p-values, as an astropy Table, a row each."""
        rows = [
            (catalogue, reference, name, vector)
            for catalogue, reference in self.pairs
            for name, vector in self.vectors(catalogue, reference).items()
        ]
        columns: dict[str, Any] = {
            "catalogue": [row[0] for row in rows],
            "less": [row[1] for row in rows],
            "vector": [row[2] for row in rows],
            "unit": [row[3].unit.replace("µ", "u") for row in rows],
        }
        for k, axis in enumerate("xyz"):
            columns[axis] = [row[3].value[k] for row in rows]
            columns[f"{axis}_error"] = [row[3].sigma[k] for row in rows]
        columns["p_value"] = [row[3].p_value for row in rows]
        return tables.table_of(columns)
