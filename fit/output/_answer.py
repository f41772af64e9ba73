"""The result to quote, in four labelled lines: the same in text, page, LaTeX, JSON and Python."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from fit.output._rows import amplitude, place
from fit.quality import ONE_SIDE, SEEN, ErrorSource, hint_of, printed_p_value, solution_of
from vsh.io.tables import three_digits
from vsh.tools.arguments import explained
from vsh.tools.notes import codes_of
from vsh.tools.printing import labelled
from vsh.vector import GAIA_EDR3, Vector

#: How the errors of a fit are named.
_NAMES = {
    ErrorSource.CATALOGUE: "least squares, formal errors",
    ErrorSource.SCALED: "least squares, errors scaled by √(χ²/dof)",
    ErrorSource.FLOWS: "least squares, formal errors and those of flows",
    ErrorSource.EXCESS_NOISE: "excess noise, errors from the residuals",
    ErrorSource.RESIDUALS: "robust fit, errors from the residuals",
    ErrorSource.BOOTSTRAP: "errors from the bootstrap",
    ErrorSource.JACKKNIFE: "errors from the jackknife",
    ErrorSource.JOINT: "joint fit",
}
#: By how much residuals exceed errors where a unit is wrong rather than an error.
_WRONG = 30.0


@dataclass(frozen=True)
class Answer:
    """What a fit says of acceleration and spin.

    Attributes
    ----------
    lines : tuple of (str, str)
        Labels with their text: acceleration, spin, the distance from Gaia EDR3's acceleration, and what the errors
        are, which comes first where it is not the fit to quote. None where the fit is not of proper motions.

    Examples
    --------
    >>> answer = Answer((("acceleration", "not detected"), ("spin", "not detected")))
    >>> print(answer)
    acceleration   not detected
    spin           not detected
    >>> answer.sentence
    'acceleration not detected; spin not detected'
    """

    lines: tuple[tuple[str, str], ...] = ()

    def __str__(self) -> str:
        return labelled(self.lines)

    @property
    def sentence(self) -> str:
        """All lines as one."""
        return "; ".join(f"{label} {text}" for label, text in self.lines)


@explained
def answer_of(solution: Any) -> Answer:
    """What a fit says of acceleration and spin, with the errors of its own table.

    Parameters
    ----------
    solution : Solution
        A fit of proper motions; of anything else the answer has no lines.
    """
    solution = solution_of(solution, "answer")
    if solution.unit != "µas/yr" or not np.isfinite([*solution.covariance.diagonal(), *solution.values]).all():
        return Answer()
    factor = error_factor(solution)
    if factor > _WRONG:
        words = f"no result: residuals are {factor:.3g} times the errors. Are both in the units that were assumed?"
        return Answer((("acceleration", words),))
    if solution.covariance_dof < 3:
        words = f"no result: {solution.covariance_dof + 1:.0f} replicates are too few for the errors of a vector"
        return Answer((("acceleration", words),))
    errors = ("errors" if solution.is_recommended else "this fit", _errors(solution))
    lines = [
        ("acceleration", words_of(solution.acceleration)),
        ("spin", words_of(solution.spin)),
        ("Gaia EDR3", _distance(solution.acceleration)),
    ]
    return Answer((*lines, errors) if solution.is_recommended else (errors, *lines))


def error_factor(solution: Any) -> float:
    """By how much residuals exceed the errors of the catalogue; 1 where χ² does not contradict those."""
    return max(solution.quality.factor, 1.0) if solution.error_source == ErrorSource.CATALOGUE else 1.0


def words_of(vector: Vector) -> str:
    """Size, place and p-value of a vector; an upper limit where it is not detected."""
    p = printed_p_value(vector.p_value)
    if vector.p_value < SEEN:
        return f"{amplitude(vector)} {vector.unit} towards {place(vector)}, p = {p}"
    limit = f"< {three_digits(vector.amplitude_limit())} {vector.unit} (95 %)"
    hint = f" ({hint})" if (hint := hint_of(vector.p_value)) else ""
    return f"not detected: {limit}, p = {p}{hint}"


def _distance(acceleration: Vector) -> str:
    """How far an acceleration is from that of Gaia EDR3, in standard deviations of both together."""
    gaia = GAIA_EDR3.to_frame(acceleration.frame)
    whole = acceleration.covariance + gaia.covariance
    dof = acceleration.dof * (np.trace(whole) / np.trace(acceleration.covariance)) ** 2  # Satterthwaite (1946)
    away = replace(acceleration, value=acceleration.value - gaia.value, covariance=whole, dof=float(dof))
    p = away.p_value
    hint = ": is it the instrument? (docs/instrument.md)" if p < SEEN else ""
    size = f"{gaia.amplitude:.2f} ± {gaia.amplitude_error:.2f} {gaia.unit}"
    return f"{abs(ndtri(max(p, 1e-300) / 2)):.1f} σ from its acceleration of {size} (p = {printed_p_value(p)}){hint}"


def _errors(solution: Any) -> str:
    """What the errors are, what they leave out, and what to be careful of."""
    words = f"{_NAMES[ErrorSource(solution.error_source)]}, degree {solution.modes.lmax}"
    if solution.error_source == ErrorSource.SCALED and not solution.includes_floor:
        words += f", {solution.quality.factor:.3g} times the formal errors"
    if solution.floor is not None and solution.includes_floor:
        floor = solution.floor
        words += f", systematic floor of ± {floor.acceleration_error:.2g} (spin ± {floor.spin_error:.2g}) included"
    elif solution.includes_floor:
        words += ", systematic errors included"
    elif solution.is_recommended:
        words += "; the systematic floor is not known" + (" below degree 3" if solution.modes.lmax < 3 else "")
    if (factor := error_factor(solution)) > 1:
        words += f"; residuals are {factor:.3g} times as large"
    if solution.modes.lmax > 1 and not solution.includes_floor and ONE_SIDE in codes_of(solution.notes):
        words += "; one side of the sky has no sources, and degree 1 depends on the degrees above it"
    if not solution.is_recommended:
        words += "; to quote: fit.recommended (vsh-fit without --method)"
    return words
