"""How far a solution follows templates, degree by degree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fit.normal import TemplateField
from fit.results.solution import Solution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Section
from vsh.models.covariance import ScalarSpectrum, Spectrum
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray, Table

#: More errors than this are marked.
_MARKED_ERRORS = 3.0


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CrossPowers(Result):
    """Projection of a solution of motions or of numbers on each template, separately for each degree.

    Attributes
    ----------
    templates : tuple of str
        The template of each row.
    degrees : (n,) array
        The degree of each row.
    values : (n,) array
        What follows the template's part of this degree, rms over the sky; negative where it is against it. [`unit`]
    errors : (n,) array
        Standard errors of `values`, from the covariance of the solution. [`unit`]
    errors_with_floor : (n,) array
        Standard errors that include the systematic errors, if a spectrum of these was given: the scatter of `values`
        for a template that is not a cause of the motions. [`unit`]
    unit : str
        That of the solution.
    """

    templates: tuple[str, ...]
    degrees: FloatArray
    values: FloatArray
    errors: FloatArray
    errors_with_floor: FloatArray
    unit: str = "µas/yr"

    def __repr__(self) -> str:
        return f"<CrossPowers: {len(set(self.templates))} templates, degrees to {int(max(self.degrees))}>"

    def _sections(self, long):
        is_significant = (np.abs(self.values) > _MARKED_ERRORS * self.errors_with_floor) & (self.degrees > 1)
        rows = zip(self.templates, self.degrees, is_significant, strict=True)
        marked = ", ".join(f"{name} (l = {l:.0f})" for name, l, is_marked in rows if is_marked)
        is_of_motions = self.unit == "µas/yr"
        dipoles = "spin and acceleration themselves" if is_of_motions else "the dipole itself"
        remarks = [
            f"More than three errors with the floor: {marked or 'none'}. Degree 1 contains {dipoles} and is not judged."
        ]
        title = f"{'Motions' if is_of_motions else 'Values'} along each template, by degree (rms)"
        return (Section(title, (), self.to_table(), remarks=remarks),)

    def to_table(self) -> Table:
        """A row for each template and degree as an astropy Table."""
        value_columns = {"value": self.values, "error": self.errors, "error_with_floor": self.errors_with_floor}
        columns = {"template": list(self.templates), "degree": self.degrees.astype(int)} | value_columns
        return tables.table_of(columns, {}, dict.fromkeys(value_columns, self.unit))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The projections in units of their errors on matplotlib axes."""
        from fit.background._plot import plot_cross_powers

        return plot_cross_powers(self, ax=ax)


def cross_powers(
    solution: Solution, templates: Sequence[TemplateField], spectrum: Spectrum | ScalarSpectrum | None = None
) -> CrossPowers:
    """Project a solution on templates, degree by degree.

    Parameters
    ----------
    solution : Solution
        Fitted to the degree of the templates, without them.
    templates : sequence of TemplateField
        `normal.templates` of the normal equations it was solved from.
    spectrum : Spectrum or ScalarSpectrum, optional
        Spectrum of the systematic errors, such as `Floor.spectrum`: power that does not depend on the template.

    Raises
    ------
    ParameterError
        If there are no templates, or they are cut to another degree.

    Notes
    -----
    Each value is Σ t_k c_k over the modes of a degree, divided by the norm of the template in this degree. Nguyen &
    Murray (2026) take cross-powers of Gaia's quasar motions with maps of scans, densities and stars in this sense.
    """
    modes = solution.modes
    if not templates or any(len(template.values) != len(modes) for template in templates):
        raise ParameterError("cross-powers need templates cut to the degree of the solution: those of normal.templates")
    total_covariance = np.array(solution.covariance)
    if spectrum is not None:
        total_covariance[np.diag_indices(len(modes))] += spectrum.variances(modes)
    names, degrees, projections = [], [], []
    for template in templates:
        weight = template.values * modes.norm2
        for l in range(1, modes.lmax + 1):
            degree_weight = np.where(modes.degrees == l, weight, 0.0)
            norm = np.sqrt(4 * np.pi * degree_weight @ template.values)
            if norm > 1e-6:
                names.append(template.name)
                degrees.append(float(l))
                projections.append(degree_weight / norm)
    projection = np.array(projections)
    return CrossPowers(
        templates=tuple(names),
        degrees=np.array(degrees),
        values=projection @ solution.values,
        errors=np.sqrt(np.einsum("nk,kl,nl->n", projection, solution.covariance, projection)),
        errors_with_floor=np.sqrt(np.einsum("nk,kl,nl->n", projection, total_covariance, projection)),
        unit=solution.unit,
    )
