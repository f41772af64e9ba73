"""skyplothelper: fields by the names of the ICRF3 papers."""

import numpy as np
import pytest

from vsh.conventions import from_icrf3

peer = pytest.importorskip(
    "skyplothelper.vsh", reason="skyplothelper is not installed: pip install 'vsh-astrometry[against]'"
)


def name_of(theirs):
    """Our name of a parameter of theirs: E21R of E_21_Re."""
    return theirs.replace("_Re", "R").replace("_Im", "I").replace("_", "")


@pytest.mark.parametrize("parameter", peer.VSH_PARAM_NAMES)
def test_every_parameter(parameter):
    rng = np.random.default_rng(2)
    lon, lat = rng.uniform(0, 360, (5, 20)), np.degrees(np.arcsin(rng.uniform(-1, 1, (5, 20))))
    ours = from_icrf3({name_of(parameter): 30.0}).at(np.radians(lon), np.radians(lat))
    np.testing.assert_allclose(ours, peer.vsh_field(lon, lat, {parameter: 30.0}), atol=1e-12)


def test_all_of_them_at_one_place():
    values = dict(zip(peer.VSH_PARAM_NAMES, np.random.default_rng(3).normal(0, 50, 16), strict=True))
    ours = from_icrf3({name_of(parameter): value for parameter, value in values.items()})
    np.testing.assert_allclose(ours.at(2.0, -0.7), peer.vsh_field(*np.degrees([2.0, -0.7]), values), atol=1e-11)
