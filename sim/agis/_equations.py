"""The normal equations of sources and attitude, the attitude eliminated.

An observation of source i at time t, under the position angle ψ, is

    along = m·δu − n·ε(t),   across = n·δu + m·ε(t),   m = p sin ψ + q cos ψ,   n = −p cos ψ + q sin ψ,

with δu = p (Δα* + µ_α* t) + q (Δδ + µ_δ t) + ϖ f and the attitude's error ε(t) a spline along the axes of the sky
(Lindegren et al. 2012, A&A 538, A78, linearised). The normal equations [S C; Cᵀ A] have blocks of five rows for each
source in S, and a band of twelve in A. A is factored once; what is left for the sources is (S − C A⁻¹ Cᵀ) x = g_s − C A⁻¹ g_a.
"""

from __future__ import annotations

import re

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from sim.agis._globals import GlobalMotion
from sim.agis.passes import Scans, check_memory, make_passes, smooth, system_memory
from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray
from vsh.errors import DegeneracyError
from vsh.units import JULIAN_YEAR

#: A source is solved if it has more transits than parameters, and its block is no worse conditioned.
_LEAST = 1e-6


class Equations(InNotebook):
    """S, A factored, and what both do to vectors; those of sources are (n, 5, K).

    Parameters
    ----------
    scans : Scans
        The transits.
    prior : float or None
        To which the attitude's coefficients are known from elsewhere. [µas]
    smoothing : float
        To which their second differences are taken to vanish. [µas]
    motion : GlobalMotion or None
        A field that the motions of some sources follow.
    threads : int or None
        One a core if None.
    compiled : bool or None
        By numba, or by the sparse design matrix; whichever there is if None.
    """

    def __init__(
        self, scans: Scans, prior: float | None, smoothing: float, motion: GlobalMotion | None,
        threads: int | None, compiled: bool | None,
    ) -> None:  # fmt: skip
        self.scans, self.prior, self.smoothing, self.motion = scans, prior, smoothing, motion
        self.coefficients = scans.intervals + 3
        self._check_data()
        check_memory(system_memory(scans.n_sources, self.coefficients, 1), "the normal equations",
                     "take fewer sources, or knots farther apart")  # fmt: skip
        self.passes, blocks, band, self.solved = self._determined(threads, compiled)
        self._check_numbers()
        blocks[~self.solved] = np.eye(5)
        self.formal = _inverse(blocks)
        self.blocks = blocks
        if motion is not None:
            motion.check(scans.n_sources, self.solved)
            self._tighter = blocks.copy()
            self._tighter[:, [3, 4], [3, 4]] += motion.weights[:, None]
            self.start = _inverse(self._tighter)
            self._low_rank = motion.reduced(self.formal)
        else:
            self._tighter, self.start = blocks, self.formal
        smooth(band, 1 / smoothing**2)
        if prior is not None:
            band[0] += 1 / prior**2
        self.factor = self._factored(band)

    def apply(self, x: FloatArray) -> FloatArray:
        """(S − C A⁻¹ Cᵀ) x, with what holds global motions."""
        if x.ndim == 2:
            return self.apply(x[..., None])[..., 0]
        out = self._tighter @ x - self.passes.to_sources(self.attitude_of(self.passes.to_attitude(x)))
        if self.motion is not None:
            out[:, 3:] -= self.motion.pull(x)
        return out

    def attitude_of(self, right: FloatArray) -> FloatArray:
        """A⁻¹ of a right-hand side (coefficients, 3[, K])."""
        # A copy, which is overwritten: for one right-hand side the order of its axes is the same.
        flat = np.array(right.reshape(3 * self.coefficients, -1), order="F")
        return cho_solve_banded((self.factor, True), flat, overwrite_b=True, check_finite=False).reshape(right.shape)

    def reduce(self, of_sources: FloatArray, of_attitude: FloatArray) -> FloatArray:
        """g_s − C A⁻¹ g_a, (n, 5)."""
        return of_sources - self.passes.to_sources(self.attitude_of(of_attitude)[..., None])[..., 0]

    def precondition(self, r: FloatArray) -> FloatArray:
        """Each source solved for itself, with what holds global motions."""
        z = self.start @ r
        if self.motion is not None:
            g = self.motion.design
            low = np.linalg.solve(
                self._low_rank, np.einsum("mik,mir->kr", g, self.motion.weights[:, None, None] * z[:, 3:])
            )
            pulled = np.zeros_like(z)
            pulled[:, 3:] = self.motion.weights[:, None, None] * np.einsum("mik,kr->mir", g, low)
            z += self.start @ pulled
        return z

    def null_space(self) -> FloatArray:
        """The six motions that no observation sees, (6, n, 5): ε₀ along x, y, z, then ω."""
        # Of the directions as the observations have them, in single precision.
        sa, ca, sd, cd = self.scans.directions.astype(float)
        p, q = np.stack([-sa, ca, np.zeros_like(sa)]), np.stack([-sd * ca, -sd * sa, cd])
        out = np.zeros((6, self.scans.n_sources, 5))
        # ε × r has the components ε·q east and −ε·p north.
        out[:3, :, 0], out[:3, :, 1] = q, -p
        out[3:, :, 3], out[3:, :, 4] = q, -p
        return out

    @property
    def defect(self) -> int:
        """Of how many motions of `null_space` the observations know nothing: six, three where motions are held, or none."""
        if self.prior is not None:
            return 0
        return 6 if self.motion is None or self.motion.spins else 3

    def without_null_space(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters less the rotation that fits them best, the blocks S as weights; and that rotation."""
        if not self.defect:
            return x, np.zeros((0, x.shape[-1]))
        basis, weighted, normal = self.rotations()
        rotation = np.linalg.solve(normal, np.einsum("kni,nir->kr", weighted, x))
        return x - np.einsum("kr,kni->nir", rotation, basis), rotation

    def rotations(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The null space of the sources that are solved; times the blocks S; and the product of the two."""
        basis = self.null_space()[: self.defect]
        basis[:, ~self.solved] = 0
        weighted = np.einsum("nij,knj->kni", self.blocks, basis)
        return basis, weighted, np.einsum("kni,lni->kl", weighted, basis)

    def _check_data(self):
        scans = self.scans
        if self.prior is None and not (scans.weights[1] > 0).any():
            raise DegeneracyError(
                "no across-scan data: along the scan alone coefficient 0 of the attitude, and every other, is determined about "
                "one axis of three. Give sigma_across, or a prior, to which the attitude is known from elsewhere"
            )

    def _check_numbers(self):
        """Raise DegeneracyError if the solved sources have fewer observations than there are unknowns."""
        scans, n = self.scans, int(self.solved.sum())
        observed = np.sum((scans.counts * (1 + (scans.weights[1] > 0)))[self.solved])
        left, unknown = observed - 5 * n, 3 * self.coefficients
        if self.prior is None and left < unknown:
            longer = f"knots of {3 * scans.years * JULIAN_YEAR / left:.0f} s or more, " if left > 0 else ""
            raise DegeneracyError(
                f"too few sources for the knots: {observed:.0f} observations of {n} sources for {5 * n + unknown} unknowns "
                f"({scans.intervals} intervals). Take {longer}more sources, sim.agis.scaled, or a prior"
            )

    def _determined(self, threads, compiled):
        """Passes, blocks and band of the sources that have transits enough."""
        scans = self.scans
        solved = scans.counts > 5
        passes = make_passes(scans, solved, threads, compiled)
        blocks, band = passes.blocks()
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", blocks), 1e-300))
        good = np.linalg.eigvalsh(blocks / (scale[:, :, None] * scale[:, None]))[:, 0] > _LEAST
        if (solved & ~good).any():
            solved &= good
            passes = make_passes(scans, solved, threads, compiled)
            blocks, band = passes.blocks()
        if not solved.any():
            raise DegeneracyError(
                f"none of {scans.n_sources} sources has transits enough for five parameters in {scans.years:g} years"
            )
        return passes, blocks, band, solved

    def _factored(self, band):
        try:
            return cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        except LinAlgError as error:
            digits = re.search(r"\d+", str(error))
            coefficient = (int(digits[0]) - 1) // 3 if digits else 0
            day = coefficient * self.scans.spacing * 365.25
            raise DegeneracyError(
                f"the attitude is not determined at its coefficient {coefficient} of {self.coefficients} (day {day:.2f}): "
                "lower the smoothing, take more sources, or a prior"
            ) from None


def _inverse(blocks):
    scale = 1 / np.sqrt(np.einsum("nii->ni", blocks))
    scale = scale[:, :, None] * scale[:, None]
    return np.linalg.inv(blocks * scale) * scale
