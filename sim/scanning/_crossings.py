"""When fields of view cross sources: looked for spin by spin, by NumPy or by a compiled loop."""

from dataclasses import dataclass

import numpy as np

from vsh.tools.types import FloatArray, IntArray

#: Spins that are looked at together: most sources are far from the scan circle in all of them.
CHUNK = 8


@dataclass(frozen=True, eq=False)
class Spins:
    """The axes of a law at the start of every spin.

    Attributes
    ----------
    times : (n,) array
        When spins start. [yr]
    z, u, w : (3, n) arrays
        The spin axis, and the axes that azimuths are counted from and to.
    bend : float
        By how much the axis leaves a straight line within a spin. [rad]
    chunks, reach : (3, m, CHUNK + 1) and (m,) arrays
        z at the spins of every chunk, the last one filled up, and how far it goes within.
    """

    times: FloatArray
    z: FloatArray
    u: FloatArray
    w: FloatArray
    bend: float
    chunks: FloatArray
    reach: FloatArray

    @classmethod
    def of(cls, times: FloatArray, z: FloatArray, u: FloatArray, w: FloatArray) -> "Spins":
        """From the axes at the starts."""
        bend = float(np.abs(np.diff(z, 2)).max() / 8) if z.shape[1] > 2 else 0.0
        spin = np.arange(0, max(len(times) - 1, 1), CHUNK)[:, None] + np.arange(CHUNK + 1)
        chunks = z[:, np.minimum(spin, len(times) - 1)]
        reach = np.sqrt(np.sum((chunks - chunks[:, :, :1]) ** 2, 0)).max(1)
        return cls(times, z, u, w, bend, chunks, reach)

    def crossings(
        self, r: FloatArray, wide: float, half: float, *, compiled: bool = False
    ) -> tuple[IntArray, FloatArray, IntArray]:
        """Source, time and field (1 preceding, −1 following) of all crossings, ordered by source and time.

        Parameters
        ----------
        r : (3, n) array
            Directions of the sources, in the axes of z.
        wide : float
            Height above the scan circle, to either side, within which a source is met; between the starts of two spins
            heights are taken for linear.
        half : float
            Half the basic angle. [rad]
        compiled : bool
            By numba, which must be there; otherwise by NumPy.
        """
        if compiled:
            from sim.scanning import _compiled

            return _compiled.crossings(
                np.ascontiguousarray(r.T), np.ascontiguousarray(self.z.T), np.ascontiguousarray(self.u.T),
                np.ascontiguousarray(self.w.T), self.times, self.reach, CHUNK, wide, half,
            )  # fmt: skip
        source, spin, h0, h1 = self._near(r, wide)
        here = r[:, source]
        azimuth = np.arctan2(dot(here, self.w[:, spin]), dot(here, self.u[:, spin]))
        turn = np.arctan2(dot(here, self.w[:, spin + 1]), dot(here, self.u[:, spin + 1])) - azimuth
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
        crossings = []
        for view in (1, -1):
            # Where in the spin Ω(f) = 2π f meets the azimuth of the source less that of the field.
            first = (azimuth - view * half) % (2 * np.pi)
            # Where the azimuth of a source falls, a field may meet it twice in a spin.
            for rows, again in ((slice(None), 0.0), (np.flatnonzero(first < -turn), 2 * np.pi)):
                share = (first[rows] + again) / (2 * np.pi - turn[rows])
                hit = np.flatnonzero((share < 1) & (np.abs(h0[rows] + share * (h1 - h0)[rows]) < wide))
                where = spin[rows][hit]
                time = self.times[where] + share[hit] * (self.times[where + 1] - self.times[where])
                crossings.append((source[rows][hit], time, np.full(len(hit), view)))
        owner, time, views = (np.concatenate(each) for each in zip(*crossings, strict=True))
        # Four lists in order become one.
        order = np.argsort(owner + time / (self.times[-1] + 1), kind="stable")
        return owner[order], time[order], views[order]

    def _near(self, r, wide):
        """Which sources are near the scan circle in which spins, and their heights at the start and the end of each."""
        # Height above the circle at every eighth spin: z moves a degree in one.
        start = self.z[:, ::CHUNK][:, : len(self.reach)]
        source, chunk = np.nonzero(np.abs(r.T @ start) < wide + self.reach)
        height = r[0, source, None] * self.chunks[0, chunk]
        height += r[1, source, None] * self.chunks[1, chunk]
        height += r[2, source, None] * self.chunks[2, chunk]
        low, high = height < wide, height > -wide
        row, within = np.nonzero((low[:, :-1] | low[:, 1:]) & (high[:, :-1] | high[:, 1:]))
        spin = chunk[row] * CHUNK + within
        last = spin < self.z.shape[1] - 1
        row, within = row[last], within[last]
        return source[row], spin[last], height[row, within], height[row, within + 1]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """a · b along the first axis."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
