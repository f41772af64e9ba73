"""The normal equations of any number of sources from a few thousand moments of their weights.

A source's inverse covariance [[a, c], [c, b]] enters N in products of two harmonics, which
are trigonometric polynomials of degree 2L in α and in δ. So N needs of the catalogue no
more than the Fourier moments of a, b and c to that degree,

    F(M, n) = Σ w e^{−i(Mα + nδ)},   |M|, |n| ≤ 2L,

and b those of the weighted motions to degree L. The moments are the only sums over sources.

Longitude by longitude they are put back on 2L + 1 rings of latitude: the rings of a grid
of 4L + 2 points around a whole meridian, of which the far half, where both e_α and e_δ
have turned over, falls on the near one at α + π. On the rings N is a product of small
matrices, one for each pair of orders, since Σ w cos mα cos m'α and its like are moments of
M = m ± m'.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.basis import scalar_harmonics, toroidal_harmonics
from vsh.checks.types import ComplexArray, FloatArray
from vsh.checks.weighed import weighed
from vsh.modes import Mode, Modes, ScalarModes
from vsh.system.parallel import map_blocks

#: Sources in a block.
BLOCK = 2**16


def compressed_sums(field: Any, modes: Modes, threads: int | None = None) -> tuple[FloatArray, FloatArray, float]:
    """N, b and Σ yᵀ C⁻¹ y of a field: what `fit.normal_equations` adds up, at any degree."""
    weights, motions, chi2_null = fourier_sums(field, modes.lmax, threads)
    rings = rings_of(modes)
    return rings.matrix(weights), rings.rhs(motions), chi2_null


def rings_of(modes: Modes) -> Rings:
    """The rings on which moments for these modes are put back."""
    return (ScalarRings if isinstance(modes, ScalarModes) else Rings)(modes.lmax)


def fourier_sums(field: Any, lmax: int, threads: int | None = None) -> tuple[ComplexArray, ComplexArray, float]:
    """All that a fit to degree L needs of the sources: sums over them, which add."""
    parts = map_blocks(lambda part: _moments(field[part], lmax), len(field), BLOCK, threads, "normal equations")
    weights: Any = 0
    motions: Any = 0
    chi2_null = 0.0
    for w, z, chi2 in parts:
        weights, motions, chi2_null = weights + w, motions + z, chi2_null + float(chi2)
    return weights, motions, chi2_null


def _moments(field, lmax):
    """Fourier moments of a, b, c for 0 ≤ M ≤ 2L, of the motions for 0 ≤ M ≤ L; and χ²."""
    from vsh.transform import fourier_moments

    weights = field.weights
    motions = weighed(weights, field.data)
    chi2 = np.vdot(motions, field.data)
    # Two real fields travel as one complex one.
    columns = np.concatenate([weights, motions])
    pairs = [(0, 1), (2, None), (3, 4)] if len(weights) == 3 else [(0, 1)]
    packed = np.zeros((len(pairs), len(field)), complex)
    for row, (real, imaginary) in zip(packed, pairs, strict=True):
        row.real = columns[real]
        if imaginary is not None:
            row.imag = columns[imaginary]
    f = fourier_moments(field.lon, field.lat, packed, 2 * lmax)
    mirrored = np.conj(f[:, ::-1, ::-1])
    real, imag = (f + mirrored) / 2, (f - mirrored) / 2j
    found = np.stack(
        [
            part[row]
            for row, pair in enumerate(pairs)
            for part, k in zip((real, imag), pair, strict=True)
            if k is not None
        ]
    )
    half, near = 2 * lmax, slice(lmax, 3 * lmax + 1)
    return found[: len(weights), half:], found[len(weights) :, half : half + lmax + 1, near], chi2


class Rings:
    """The 2L + 1 rings of latitude on which the moments are put back."""

    def __init__(self, lmax: int) -> None:
        self.lmax = lmax
        count = 2 * lmax + 1
        self.lat = -np.pi / 2 + (np.arange(count) + 0.5) * np.pi / count
        # The harmonics at α = 0: T_lm = (B cos mα, A sin mα) and (−B sin mα, A cos mα).
        toroidal = toroidal_harmonics(np.zeros(count), self.lat, lmax)
        modes = Modes(lmax)
        pairs = [(l, m) for m in range(lmax + 1) for l in range(max(m, 1), lmax + 1)]
        self.m = np.array([m for _, m in pairs])
        self.re = np.array([modes.index(Mode("T", l, m)) for l, m in pairs])
        self.im = self.re + 1  # where m > 0
        self.size = len(modes) // 2
        self.b = toroidal[self.re, 0]
        self.a = np.where(self.m[:, None] > 0, toroidal[np.minimum(self.im, len(toroidal) - 1), 1], 0.0)

    def spectra(self, moments: ComplexArray, turns_over: bool) -> ComplexArray:
        """Σ w e^{−iMα} on each ring, (k, M, ring), from the Fourier moments in δ.

        A function that goes with e^{iMα} is even or odd about the pole like M, or unlike M
        where it is a component of a vector, which `turns_over` there.
        """
        most = moments.shape[-1] // 2
        n = np.arange(-most, most + 1)[:, None]
        near = np.exp(1j * n * self.lat) / (4 * self.lmax + 2)
        far = (-1.0) ** n * np.conj(near)
        sign = (-1.0) ** np.arange(moments.shape[1]) * (-1 if turns_over else 1)
        return moments @ near + sign[:, None] * (moments @ far)

    def on_grid(self, weights: ComplexArray) -> FloatArray:
        """a, b, c on a grid of 2L + 1 rings by 4L + 2 longitudes from α = 0, (3, 2L + 1, 4L + 2).

        The grid with these weights, some of them negative, has the normal matrix of the catalogue.
        """
        spectra = np.swapaxes(self.spectra(weights, turns_over=False), 1, 2)
        return np.fft.irfft(spectra, 4 * self.lmax + 2)

    def matrix(self, weights: ComplexArray) -> FloatArray:
        """N from the moments of a, b, c."""
        a, b, c = self.spectra(weights, turns_over=False)
        # S is T turned by +90°, J = [[0, −1], [1, 0]]: N_SS has Jᵀ W J in place of W, N_TS has W J.
        tt = self.form(a, c, c, b)
        ss = self.form(b, -c, -c, a)
        ts = self.form(c, -a, b, -c)
        return np.block([[tt, ts], [ts.T, ss]])

    def rhs(self, motions: ComplexArray) -> FloatArray:
        """b from the moments of the weighted motions."""
        east, north = (z[self.m] for z in self.spectra(motions, turns_over=True))
        out = np.zeros((2, self.size))
        positive = self.m > 0
        for row, (e, n) in zip(out, ((east, north), (north, -east)), strict=True):  # S·z = T·(Jᵀz)
            row[self.re] = np.sum(self.b * e.real - self.a * n.imag, axis=1)
            row[self.im[positive]] = np.sum(self.b * e.imag + self.a * n.real, axis=1)[positive]
        return out.ravel()

    def form(self, ee: Any, en: Any, ne: Any, nn: Any) -> FloatArray:
        """Σ T_iᵀ W T_j for weights W = [[ee, en], [ne, nn]] on the rings, in the order of the modes."""
        spectra = np.stack([ee, en, ne, nn])
        real, sine = spectra.real, -spectra.imag  # Σ w cos Mα, Σ w sin Mα
        out = np.zeros((self.size, self.size))
        for m in range(self.lmax + 1):
            mine = self.m == m
            left = np.concatenate([self.b[mine], self.a[mine]], axis=1)
            plus, minus = m + self.m, np.abs(m - self.m)
            sign = np.sign(m - self.m)[:, None]
            c_plus, c_minus = real[:, plus], real[:, minus]
            s_plus, s_minus = sine[:, plus], sign * sine[:, minus]
            cc, ss = (c_minus + c_plus) / 2, (c_minus - c_plus) / 2
            sc, cs = (s_plus + s_minus) / 2, (s_plus - s_minus) / 2  # first of m, then of m'

            def product(on_b, on_a, left=left):
                """[B A] · [on_b; on_a], both (pairs, rings) on the right."""
                return left @ np.concatenate([on_b, on_a], axis=1).T

            b, a = self.b, self.a
            blocks = {
                ("re", "re"): product(cc[0] * b + cs[1] * a, sc[2] * b + ss[3] * a),
                ("re", "im"): product(cc[1] * a - cs[0] * b, sc[3] * a - ss[2] * b),
                ("im", "re"): product(-sc[0] * b - ss[1] * a, cc[2] * b + cs[3] * a),
                ("im", "im"): product(ss[0] * b - sc[1] * a, cc[3] * a - cs[2] * b),
            }
            for (i, j), block in blocks.items():
                if i == "im" and m == 0:
                    continue
                rows, columns = (self.re if i == "re" else self.im)[mine], self.re if j == "re" else self.im
                there = slice(None) if j == "re" else self.m > 0
                out[np.ix_(rows, columns[there])] = block[:, there]
        return out


class ScalarRings(Rings):
    """The same for scalar fields: their harmonics are those of an east component alone, B cos mα and −B sin mα."""

    def __init__(self, lmax: int) -> None:
        self.lmax = lmax
        count = 2 * lmax + 1
        self.lat = -np.pi / 2 + (np.arange(count) + 0.5) * np.pi / count
        modes = ScalarModes(lmax)
        pairs = [(l, m) for m in range(lmax + 1) for l in range(m, lmax + 1)]
        self.m = np.array([m for _, m in pairs])
        self.re = np.array([modes.index(Mode("F", l, m)) for l, m in pairs])
        self.im = self.re + 1  # where m > 0
        self.size = len(modes)
        self.b = scalar_harmonics(np.zeros(count), self.lat, lmax)[self.re]
        self.a = np.zeros_like(self.b)

    def matrix(self, weights: ComplexArray) -> FloatArray:
        """N from the moments of the weights."""
        (w,) = self.spectra(weights, turns_over=False)
        return self.form(w, 0 * w, 0 * w, 0 * w)

    def rhs(self, motions: ComplexArray) -> FloatArray:
        """b from the moments of the weighted values."""
        values = self.spectra(motions, turns_over=False)[0][self.m]
        out, positive = np.zeros(self.size), self.m > 0
        out[self.re] = np.sum(self.b * values.real, axis=1)
        out[self.im[positive]] = np.sum(self.b * values.imag, axis=1)[positive]
        return out
