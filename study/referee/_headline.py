"""The acceleration with every error that is known of: what the first line says."""

from dataclasses import dataclass

from fit.background import Floor
from fit.methods import Recommended
from fit.solution import Solution
from study.referee._quasars import Quasars
from vsh.tools.notebook import InNotebook
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class Headline(InNotebook):
    """The recommended fit of all sources, the same as that of `vsh-fit`.

    Attributes
    ----------
    fit : Recommended
    verdict : str
        The result to quote, in one sentence.
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
        """Probability of as large an acceleration by chance."""
        return self.fit.acceleration.p_value

    @property
    def p_spin(self) -> float:
        """Probability of as large a spin by chance."""
        return self.fit.spin.p_value

    @property
    def acceleration(self) -> Vector:
        """The acceleration, with systematic errors. [µas/yr]"""
        return self.solution.acceleration


def headline(quasars: Quasars) -> Headline:
    """Give the recommended fit of all quasars, and its answer in one sentence."""
    return Headline(quasars.recommended, quasars.recommended.answer.sentence)
