"""The acceleration with every error that is known of: what the first line says."""

from dataclasses import dataclass

from fit.background import Floor
from fit.recommended import Recommended
from fit.solution import Solution
from study.referee._quasars import Quasars
from vsh.tools.notebook import InNotebook
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class Headline(InNotebook):
    """The recommended fit of all sources, the same as that of `vsh-fit --recommended`.

    Attributes
    ----------
    fit : Recommended
    verdict : str
        In words.
    """

    fit: Recommended
    verdict: str

    @property
    def solution(self) -> Solution:
        """The solution, with the systematic floor in its errors where there is one."""
        return self.fit.solution

    @property
    def floor(self) -> Floor | None:
        """The systematic floor, or None where the sources do not determine one."""
        return self.fit.floor

    @property
    def p_acceleration(self) -> float:
        """Probability of as large an acceleration by chance, the mean over the posterior of the floor."""
        return self.fit.p_values[0]

    @property
    def p_spin(self) -> float:
        """Probability of as large a spin by chance, the mean over the posterior of the floor."""
        return self.fit.p_values[1]

    @property
    def acceleration(self) -> Vector:
        """The acceleration, with systematic errors. [µas/yr]"""
        return self.solution.acceleration


def headline(quasars: Quasars) -> Headline:
    """Give the recommended fit of all quasars, and its verdict in words."""
    return Headline(quasars.recommended, quasars.recommended.verdict.removeprefix("verdict: "))
