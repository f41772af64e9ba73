"""The interface of all results on frames: pairs of catalogues, their vectors, and the result to quote."""

from fit.results.output import words_of
from fit.results.storage import Result
from vsh.io.sections import Answer
from vsh.tools.notes import doubts_of
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

    notes: tuple[str, ...]

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
        has_several = len(self.pairs) > 1
        lines = doubts_of(self.notes) + [
            (f"{catalogue} − {reference}: {name}" if has_several else name, words_of(vector))
            for catalogue, reference in self.pairs
            for name, vector in self.vectors(catalogue, reference).items()
        ]
        return Answer(tuple(lines))

    @property
    def verdict(self) -> str:
        """The result to quote, as one sentence."""
        return self.answer.sentence
