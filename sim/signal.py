"""True fields: functions of position that add."""

from dataclasses import dataclass

from vsh import Coefficients


@dataclass(frozen=True)
class Signal:
    """A true field of motions: called as signal(lon, lat, redshift) → (2, n) µas/yr, added with +.

    Attributes
    ----------
    parts : tuple of functions of (lon, lat, redshift)

    Examples
    --------
    >>> both = spin((1, 0, 0)) + acceleration((0, 0, 2))
    >>> both([0.0], [0.0]).round(12).T
    array([[0., 2.]])
    """

    parts: tuple

    def __call__(self, lon, lat, redshift=None):
        return sum(part(lon, lat, redshift) for part in self.parts)

    def __add__(self, other):
        return Signal(self.parts + as_signal(other).parts)


def field(coefficients):
    """Any band-limited field."""
    return Signal((lambda lon, lat, redshift: coefficients.at(lon, lat),))


def spin(vector):
    """Rigid rotation of the frame, ω × r. [µas/yr]"""
    return field(Coefficients.from_vectors(rotation=vector))


def acceleration(vector):
    """Drift towards a point by the Solar System's acceleration, ã − (ã·r) r. [µas/yr]"""
    return field(Coefficients.from_vectors(glide=vector))


def as_signal(truth):
    """Coefficients and Signals alike as a Signal."""
    return field(truth) if isinstance(truth, Coefficients) else truth
