"""From sources to normal equations, wherever the sources are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any, Literal, cast

import numpy as np

from fit.normal._equations import NormalEquations
from fit.normal._moments import Moments
from fit.normal._templates import Template, template_fields
from fit.normal.sums import design_matrix_limit, sum_by_design_matrix, sum_by_moments
from vsh.basis import harmonics
from vsh.field import Field, SourcesWithErrors
from vsh.io.parts import Parts
from vsh.models.covariance import Covariance, as_covariance
from vsh.modes import Modes
from vsh.scalars import ScalarField, modes_for
from vsh.tools.arguments import choice
from vsh.tools.errors import FieldError, ModesError
from vsh.tools.printing import log_calls
from vsh.tools.types import FloatArray

#: A normal matrix beyond this is refused. [bytes]
MEMORY = 8 * 2**30


@log_calls("normal equations")
def normal_equations(
    field: Field | ScalarField | Parts | Iterable[Field],
    modes: Modes | int,
    *,
    method: Literal["auto", "design-matrix", "compressed"] = "auto",
    threads: int | None = None,
    covariance: Covariance | FloatArray | None = None,
    templates: Sequence[Template] = (),
) -> NormalEquations:
    """Sum a field, a catalogue in parts, or a stream of fields into normal equations.

    Parameters
    ----------
    field : Field, ScalarField, Parts or iterable of Fields
        The sources. Parts are summed on the machine that holds them; only their moments, or at degree 1 their normal
        equations, are transferred.
    modes : Modes, or the degree lmax
        What to fit; ScalarModes of a ScalarField.
    method : {"auto", "design-matrix", "compressed"}
        "design-matrix" sums the design matrix, exact to rounding; "compressed" sums the moments of
        the weights and is as good to 1e-12, in a time that hardly grows with the degree.
        "auto" takes what was measured to be faster (docs/large_catalogues.md).
    threads : int, optional
        Number of threads of the moments (default: one per core). The sum is always taken in the order of the
        sources, so the result does not depend on the number of threads.
    covariance : Covariance or (2n, 2n) array, optional
        Covariance of the motions of a field, all east components first, in place of the errors that the field has; for
        at most 10 000 sources (`vsh.models.covariance`). [(µas/yr)²]
    templates : sequence of fit.background.Template
        Maps of what may cause systematics, cut to the degree of the fit; `fit.background.shared` gives them amplitudes
        whose variance is estimated. All normal equations that are added have the same.

    Raises
    ------
    FieldError
        If a stream of fields holds none.
    FrameError
        If the fields of a stream stand in different frames.
    ParameterError
        If the covariance is of other sources, or too large; if a template is constant, or twice the same.
    CovarianceError
        If it is not positive definite.

    Examples
    --------
    The whole is the sum of its parts:

    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 100)), rng.normal(size=(2, 100)), np.ones((2, 100)))
    >>> whole = normal_equations(field, Modes(2))
    >>> np.allclose(whole.matrix, normal_equations([field[:30], field[30:]], Modes(2)).matrix)
    True
    """
    choice("method", method, ("auto", "design-matrix", "compressed"))
    if templates:
        equations = normal_equations(field, modes, method=method, threads=threads, covariance=covariance)
        return replace(equations, templates=template_fields(templates, equations.modes, equations.frame or "icrs"))
    if isinstance(field, (str, PathLike)):
        raise FieldError(f"{field} is a path: read it first, with vsh.io.catalogue.read_field or parts")
    if not isinstance(field, SourcesWithErrors | Parts) and covariance is None:
        return _sum_field_stream(field, partial(normal_equations, modes=modes, method=method, threads=threads))
    field_in_memory = field.in_memory if isinstance(field, Parts) else None
    sources = cast(Any, field if field_in_memory is None else field_in_memory)
    modes = modes_for(sources, modes)
    if len(modes) ** 2 * 8 > MEMORY:
        raise ModesError(
            f"degree {modes.lmax} has {len(modes)} coefficients, whose normal matrix takes "
            f"{len(modes) ** 2 * 8 / 2**30:.0f} GiB: lower lmax"
        )
    if covariance is not None:
        return _sum_whitened_equations(sources, modes, as_covariance(covariance, sources))
    if isinstance(sources, Parts):
        if modes.lmax == 1 or method == "design-matrix":
            sum_part = partial(normal_equations, modes=modes, method=method)
            return sources.sum(sum_part, roles=(), words="normal equations")
        return sources.sum(partial(Moments.of, lmax=modes.lmax), roles=(), words="normal equations").normal_equations()
    if method == "compressed" or (method == "auto" and len(sources) > design_matrix_limit(modes)):
        sums = sum_by_moments(sources, modes, threads)
    else:
        sums = sum_by_design_matrix(sources, modes)
    return NormalEquations(
        modes, *sums, sources.components * len(sources), sources.frame, sources.notes, unit=sources.unit
    )


def _sum_whitened_equations(field, modes, covariance):
    """Sum the equations of n sources, whitened by their dense covariance: 2n independent rows of unit weight."""
    n = len(field)
    rows = covariance.whiten(harmonics(field.lon, field.lat, modes).reshape(len(modes), 2 * n))
    motion = covariance.whiten(field.motion.ravel())
    return NormalEquations(modes, rows @ rows.T, rows @ motion, float(motion @ motion), 2 * n, field.frame, field.notes)


def _sum_field_stream(fields, sum_field):
    if isinstance(fields, np.ndarray) or not hasattr(fields, "__iter__"):
        raise FieldError(f"a Field, a ScalarField, or a stream of them, is expected, not {type(fields).__name__}")
    total: Any = sum(map(sum_field, fields))
    if isinstance(total, int):
        raise FieldError("the stream of fields is empty: there are no sources to use")
    return total
