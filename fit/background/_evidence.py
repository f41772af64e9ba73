"""Evidence in closed form: which degrees a catalogue needs, and whether a dipole changes with redshift.

With coefficients c ~ N(0, D) and K = I + D^½ N D^½, z = D^½ b, the evidence relative to that of no coefficients is

    ln Z = ½ zᵀ K⁻¹ z − ½ ln|K|.

No sampler is needed. ln Z depends on the power that is assumed a priori, the less power the less is lost by a degree
that is not there: print it with the result, or marginalise it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.special import logsumexp

from fit.background._likelihood import equations_of, fitted_degrees, parts_of, places
from fit.normal import NormalEquations
from fit.results.solution import HarmonicSolution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Section
from vsh.models.covariance import Spectrum
from vsh.tools.arguments import a, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray, Table

#: Amplitudes of a grid that is uniform in its logarithm, a decade.
_A_DECADE = 20


def evidence(
    normal: NormalEquations | HarmonicSolution | Sequence[NormalEquations],
    spectrum: Spectrum,
    degrees: Iterable[int] | None = None,
    *,
    amplitudes: tuple[float, float] | None = None,
    varying: Spectrum | None = None,
    noise_scale: float = 1.0,
) -> float:
    """ln of the evidence for coefficients of some degrees, relative to none at all.

    Parameters
    ----------
    normal : NormalEquations, Solution, or sequence of NormalEquations
        What was summed or fitted; of several bins of redshift, say.
    spectrum : Spectrum
        The power a priori, such as `10 * Spectrum.power_law(0)`: 10 (µas/yr)² in each kind and degree.
    degrees : iterable of int, optional
        Which are there; all that were fitted unless given. Other coefficients are zero.
    amplitudes : (float, float), optional
        Marginalise a factor on the spectrum between these two, uniform in its logarithm a priori.
    varying : Spectrum, optional
        Let each of the normal equations have coefficients of its own, with this power a priori.
    noise_scale : float
        Factor on the catalogue's errors, √(χ²/dof) say.

    Raises
    ------
    ModesError
        If a degree is not fitted.
    ParameterError
        If a spectrum is negative, or the amplitudes are not two rising numbers above zero.

    Examples
    --------
    A sky with nothing on it is better described by nothing:

    >>> from fit import normal_equations
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1.5, (2, 500)), rng.normal(size=(2, 500)), np.ones((2, 500)))
    >>> bool(evidence(normal_equations(field, 3), 10 * Spectrum.power_law(0), [1, 2, 3]) < 0)
    True
    """
    several = isinstance(normal, Sequence) and not isinstance(normal, (str, bytes))
    groups = [_select_degrees(equations, degrees) for equations in (normal if several else [normal])]  # type: ignore[union-attr]
    if not groups:
        raise ParameterError("evidence needs normal equations, one at least")
    a(Spectrum)("spectrum", spectrum)
    tau = positive("noise_scale", noise_scale) ** 2
    matrices, sides = (
        [equations.matrix / tau for equations, _ in groups],
        [equations.rhs / tau for equations, _ in groups],
    )
    modes, indices = groups[0][0].modes, groups[0][1]
    if any(equations.modes != modes for equations, _ in groups):
        raise ParameterError("the normal equations go to different degrees: fit all of them to one")
    variances = spectrum.variances(modes)[indices]
    matrix, rhs, varying_variances = sum(matrices), sum(sides), np.zeros(0)
    if varying is not None:
        a(Spectrum)("varying", varying)
        across = np.concatenate(matrices, axis=1)
        matrix = np.block([[matrix, across], [across.T, block_diag(*matrices)]])
        rhs = np.concatenate([rhs, *sides])
        varying_variances = np.tile(varying.variances(modes)[indices], len(groups))
    if amplitudes is None:
        return _log_evidence(matrix, rhs, np.concatenate([variances, varying_variances]))
    factors = _grid(amplitudes)
    evidences = [
        _log_evidence(matrix, rhs, np.concatenate([factor * variances, varying_variances])) for factor in factors
    ]
    return float(logsumexp(evidences) - np.log(len(evidences)))


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Evidences of some models.

    Attributes
    ----------
    names : tuple of str
    log_evidence : (n,) array
        ln Z of each, all relative to the same.
    """

    names: tuple[str, ...]
    log_evidence: FloatArray

    def __repr__(self) -> str:
        return f"<Comparison: {self.best} is best of {len(self.names)}>"

    @property
    def best(self) -> str:
        """The model with the largest evidence."""
        return self.names[int(np.argmax(self.log_evidence))]

    @property
    def probability(self) -> FloatArray:
        """The probability of each model, where all are equally likely a priori, (n,)."""
        return np.exp(self.log_evidence - logsumexp(self.log_evidence))

    def _sections(self, long):
        order = np.argsort(-self.log_evidence, kind="stable").tolist()
        remarks = [
            "Probabilities are of these models alone, all equally likely a priori; ln Z depends on the assumed power."
        ]
        return (Section("Models by their evidence", (), self.to_table(), rows=order, remarks=remarks),)

    def to_table(self) -> Table:
        """A row for each model as an astropy Table."""
        columns: dict[str, Any] = {
            "model": list(self.names),
            "log_evidence": self.log_evidence,
            "probability": self.probability,
        }
        return tables.table_of(columns)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The evidences on matplotlib axes."""
        from fit.background._plot import plot_comparison

        return plot_comparison(self, ax=ax)


def compare_models(models: Mapping[str, Any]) -> Comparison:
    """Compare models by their evidence.

    Parameters
    ----------
    models : dict of str to float, or to a tuple
        ln Z by name, or what `evidence` takes: (normal, spectrum, degrees), perhaps with a dict of its options. All
        must be of the same data.

    Raises
    ------
    ParameterError
        If there is no model, or one is neither.

    Examples
    --------
    >>> compare_models({"nothing": 0.0, "a quadrupole": 3.0}).probability.round(3)
    array([0.047, 0.953])
    """
    if not isinstance(models, Mapping) or not models:
        raise ParameterError("compare takes a dict of models by name, one at least")
    evidences = []
    for name, model in models.items():
        if isinstance(model, tuple) and 2 <= len(model) <= 4:
            *arguments, options = model if isinstance(model[-1], dict) else (*model, {})
            model = evidence(*arguments, **options)
        evidences.append(number(f"the evidence of {name!r}", model))
    return Comparison(tuple(map(str, models)), np.array(evidences))


def _select_degrees(normal, degrees):
    """Normal equations of some degrees alone, and where they stand among all."""
    equations = equations_of(normal)
    modes = equations.modes
    request = range(1, modes.lmax + 1) if degrees is None else degrees
    indices = places(modes, fitted_degrees(modes, request))
    return replace(equations, matrix=equations.matrix[np.ix_(indices, indices)], rhs=equations.rhs[indices]), indices


def _log_evidence(matrix, rhs, variances):
    logdet, gain = parts_of(matrix, rhs, variances)
    return (gain - logdet) / 2


def _grid(amplitudes):
    try:
        lower, upper = (positive("an amplitude", amplitude) for amplitude in amplitudes)
    except (TypeError, ValueError):
        lower = upper = 0.0
    if not 0 < lower < upper:
        raise ParameterError(f"amplitudes are the lowest and the highest, above zero, not {amplitudes!r}")
    return np.geomspace(lower, upper, max(2, int(np.ceil(_A_DECADE * np.log10(upper / lower))) + 1))
