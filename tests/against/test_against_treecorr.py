"""TreeCorr: its correlations of vectors on the sphere, of every pair, summed under the bins of ours."""

import numpy as np
import pytest

from fit.pairs import correlation_function
from vsh import Field

treecorr = pytest.importorskip("treecorr", reason="TreeCorr is not installed: pip install 'vsh-astrometry[against]'")


def bins_of_ours(edges, theta):
    """Weights of separations in our overlapping bins, sin² up and cos² down, (bins, separations)."""
    rows = []
    for low, middle, high in zip(edges, edges[1:], edges[2:]):
        up, down = (theta - low) / (middle - low), (theta - middle) / (high - middle)
        rows.append(
            np.where((up >= 0) & (up < 1), np.sin(np.pi / 2 * up) ** 2, 0)
            + np.where((down >= 0) & (down < 1), np.cos(np.pi / 2 * down) ** 2, 0)
        )
    return np.array(rows)


def correlations_of(field, weights, edges):
    """ξ+ and ξ− of all pairs by TreeCorr, in narrow bins that are summed under ours. Its first component points west."""
    lon, lat, (east, north) = field.lon, field.lat, field.motion
    catalogue = treecorr.Catalog(ra=lon, dec=lat, v1=-east, v2=north, w=weights, ra_units="rad", dec_units="rad")
    narrow = treecorr.VVCorrelation(
        min_sep=np.degrees(edges[0]), max_sep=np.degrees(edges[-1]), nbins=4000,
        sep_units="deg", bin_type="Linear", metric="Arc", brute=True,
    )  # fmt: skip
    narrow.process(catalogue)
    share = bins_of_ours(edges, np.radians(narrow.rnom)) * narrow.weight
    return [share @ xi / share.sum(1) for xi in (narrow.xip, narrow.xim)]


@pytest.mark.parametrize("case", ["random motions and weights", "a radial field about the pole"])
def test_correlations(case):
    rng = np.random.default_rng(9)
    n = 1500
    lon = rng.uniform(0, 2 * np.pi, n)
    if case.startswith("random"):
        lat, edges = np.arcsin(rng.uniform(-1, 1, n)), np.radians([10, 25, 40, 60, 80, 100, 130, 160])
        motion, weights = rng.normal(0.1, 0.2, (2, n)), rng.uniform(0.5, 1, n)
    else:
        lat, edges = np.pi / 2 - np.radians(40) * np.sqrt(rng.uniform(0, 1, n)), np.radians(np.arange(4, 32, 4.0))
        distance = (np.pi / 2 - lat) / np.radians(10)
        motion, weights = np.stack([0 * lat, -0.05 * distance * np.exp(-(distance**2) / 2)]), np.ones(n)
    field = Field(lon, lat, motion, np.ones((2, n)))
    ours, theirs = correlation_function(field, edges, weights=weights), correlations_of(field, weights, edges)
    for one, other in zip((ours.plus, ours.minus), theirs, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3 * np.abs(theirs[0]).max())
