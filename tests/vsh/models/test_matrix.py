"""Dense covariances: how they are made, checked and used."""

import numpy as np
import pytest
from astropy.io import fits
from conftest import random_field

import vsh.models.covariance as shared
from vsh import Field
from vsh.models.covariance import Covariance, Spectrum
from vsh.tools.errors import CovarianceError, ParameterError, TableError

FIELD = random_field(40, seed=1)


def test_function_is_the_field_of_its_spectrum():
    """V(θ) carried along great circles, against the harmonics of the same power: two ways to one matrix."""
    spectrum = 7 * Spectrum.power_law(-1.5)
    by_angle = shared.from_function(FIELD, lambda theta: spectrum.covariance(theta, 8))
    np.testing.assert_allclose(by_angle.matrix, shared.from_spectrum(FIELD, spectrum, 8).matrix, atol=1e-12)


def test_whitening_removes_the_covariance():
    both = shared.of_errors(FIELD) + shared.from_function(FIELD, shared.LINDEGREN_2021)
    white = both.whiten(np.eye(80))
    np.testing.assert_allclose(white.T @ both.matrix @ white, np.eye(80), atol=1e-10)
    chosen = both[FIELD.lat > 0]
    keep = np.tile(FIELD.lat > 0, 2)
    np.testing.assert_array_equal(chosen.matrix, both.matrix[np.ix_(keep, keep)])


def test_blocks_add_where_they_overlap():
    matrix = np.arange(16.0).reshape(4, 4)
    matrix = matrix + matrix.T
    found = shared.from_blocks([([0, 2], matrix), (np.array([True, False, False]), 100.0)], 3).matrix
    rows = [0, 2, 3, 5]
    expected = np.zeros((6, 6))
    expected[np.ix_(rows, rows)] = matrix
    expected[0, 0] += 100
    expected[3, 3] += 100
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("ending", ["npy", "fits", "txt"])
def test_files(ending, tmp_path):
    matrix = shared.of_errors(FIELD).matrix
    path = tmp_path / f"matrix.{ending}"
    {"npy": np.save, "txt": np.savetxt, "fits": fits.writeto}[ending](path, matrix)
    np.testing.assert_allclose(shared.read_covariance(path).matrix, matrix, rtol=1e-15)
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(TableError, match="holds no matrix that can be read"):
        shared.read_covariance(path)
    with pytest.raises(TableError, match="holds no matrix that can be read"):
        shared.read_covariance(tmp_path / "none.npy")


def test_large_file_is_refused_before_it_is_read(tmp_path):
    np.lib.format.open_memmap(tmp_path / "large.npy", "w+", float, (40_000, 40_000))
    with pytest.raises(ParameterError, match="of 20000 sources takes 12 GiB"):
        shared.read_covariance(tmp_path / "large.npy")


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Covariance(np.eye(3)), r"has shape \(2n, 2n\), east components first, not \(3, 3\)"),
    (lambda: Covariance([[1.0, 0.5], [0.0, 1.0]]), "not symmetric"),
    (lambda: Covariance(np.diag([1.0, -1.0])), "negative variance: of component 1"),
    (lambda: Covariance([[1.0, 0.0], [0.0, np.nan]]), "1 of 4 values of the covariance are not finite"),
    (lambda: shared.of_errors(FIELD) + Covariance(np.eye(2)), "covariances of 40 and of 1 sources do not add"),
    (lambda: shared.from_blocks([([1, 1], 1.0)], 3), "names a source twice"),
    (lambda: shared.from_blocks([([3], 1.0)], 3), "not among the 3"),
    (lambda: shared.from_blocks([([0, 1], np.eye(3))], 3), r"block 0 has 2 sources and a covariance of shape \(3, 3\)"),
])  # fmt: skip
def test_matrices_that_are_no_covariance_are_refused(make, words):
    with pytest.raises(ParameterError, match=words):
        make()


def test_component_that_others_determine_is_named():
    with pytest.raises(CovarianceError, match="the north component of source 0 is determined by those before it"):
        Covariance(np.array([[1.0, 1.0], [1.0, 1.0]])).whiten(np.eye(2))


def test_too_many_sources_are_refused_at_once():
    many = Field(np.zeros(10_001), np.zeros(10_001), np.zeros((2, 10_001)), np.ones((2, 10_001)))
    for make in (
        shared.of_errors,
        lambda f: shared.from_function(f, np.cos),
        lambda f: shared.from_spectrum(f, Spectrum.flat(), 1),
    ):
        with pytest.raises(ParameterError, match=r"takes 3 GiB; the most are 10000.*fit.background.floor"):
            make(many)
