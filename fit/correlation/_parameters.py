"""Names for what a sky may or may not tell apart: coefficients, and the components of spin and acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from vsh.checks.arguments import positive
from vsh.checks.frozen import Frozen
from vsh.checks.types import ArrayLike, FloatArray
from vsh.coefficients import FIRST_DEGREE
from vsh.errors import ModesError, ParameterError
from vsh.field import Field
from vsh.modes import KINDS, Modes, as_modes
from vsh.parts import Parts

#: What stands for the six components of spin and acceleration.
FRAME: Literal["spin+acceleration"] = "spin+acceleration"
FRAME_NAMES = tuple(f"{vector}_{axis}" for vector in ("omega", "a") for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """Linear functions of coefficients.

    Attributes
    ----------
    names : tuple of str
    modes : Modes
        Of the fit they are read off.
    rows : (k, p) array
        Parameter = row · coefficients.
    """

    names: tuple[str, ...]
    modes: Modes
    rows: FloatArray

    def __len__(self) -> int:
        return len(self.names)

    def covariance(self, covariance: FloatArray) -> FloatArray:
        """Their covariance (k, k) from that of the coefficients."""
        return self.rows @ covariance @ self.rows.T


def parameters_of(what: Modes | int | str) -> Parameters:
    """All parameters of a kind."""
    if isinstance(what, str):
        if what != FRAME:
            raise ParameterError(f"parameters are {FRAME!r}, a degree or Modes, not {what!r}")
        return named(FRAME_NAMES, 1)
    modes = as_modes(what)
    return Parameters(tuple(map(str, modes)), modes, np.eye(len(modes)))


def named(names: Sequence[str], what: Modes | int | str) -> Parameters:
    """Some parameters of a fit by name: coefficients, "t(1,0)" say, or omega_x … a_z."""
    if isinstance(what, str):
        if what != FRAME:
            raise ParameterError(f"parameters are of {FRAME!r}, a degree or Modes, not {what!r}")
        what = 1
    modes = as_modes(what)
    known = {str(mode): row for mode, row in zip(modes, np.eye(len(modes)), strict=True)}
    inverse = np.linalg.inv(FIRST_DEGREE)
    for kind, vector in zip(KINDS, ("omega", "a"), strict=True):
        for axis, row in zip("xyz", inverse, strict=True):
            full = np.zeros(len(modes))
            full[modes.slice_of(kind, 1)] = row
            known[f"{vector}_{axis}"] = full
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ParameterError(
            f"no parameter is called {', '.join(unknown)}; there are {', '.join(FRAME_NAMES)}, {', '.join(map(str, modes))}"
        )
    return Parameters(tuple(names), modes, np.stack([known[name] for name in names]))


def check_lower(fitted: Modes, unmodelled: Modes) -> None:
    """Raise ModesError unless the second degree is the higher one."""
    if not unmodelled.lmax > fitted.lmax:
        raise ModesError(f"what is not fitted must lie above degree {fitted.lmax}: {unmodelled.lmax} does not")


def without_motions(sources: Any, sigma: ArrayLike | None = None) -> Field | Parts:
    """Sources whose positions and errors are enough, as a Field or as Parts.

    Parameters
    ----------
    sources : Field, Parts, Population, or anything with lon and lat [rad], and perhaps sigma, rho, frame
        The sources.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own; one number for parts. [µas/yr]

    Raises
    ------
    FieldError
        If the sources have no positions, or no errors and none are given.
    """
    if not isinstance(sources, Parts):
        return Field.without_motions(sources, sigma)
    return sources if sigma is None else sources.map(partial(Field.without_motions, sigma=positive("sigma", sigma)))
