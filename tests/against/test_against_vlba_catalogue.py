"""Truebenbach & Darling (2017): the acceleration in VLBI proper motions."""

import numpy as np
from conftest import real_catalogue

import fit
from vsh import Modes
from vsh.io.catalogue import read_field

PUBLISHED = {"amplitude": (1.69, 0.27), "direction": ((275.2, 10.0), (-29.4, 8.8))}


def vlba():
    return read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))


def test_table_is_read_whole():
    field = vlba()
    assert len(field) == 713
    assert np.isfinite(field.redshift).sum() == 659
    assert field.name[0] == "2358+189"
    np.testing.assert_allclose(field.motion[:, 0], [5.59, -1.12])
    assert "correlations taken as zero" in " ".join(field.notes)


def test_acceleration_agrees_with_the_published_one():
    clipped = fit.robust.clip(vlba(), Modes(1), kappa=3)
    found = clipped.solution.acceleration
    value, error = PUBLISHED["amplitude"]
    assert abs(found.amplitude - value) < np.hypot(error, found.amplitude_error)
    for angle, sigma, (value, error) in zip(
        found.direction, found.direction_error, PUBLISHED["direction"], strict=True
    ):
        assert abs(angle - value) < np.hypot(sigma, error)


def test_both_solvers_agree():
    field = vlba()
    kept = field[fit.robust.clip(field, Modes(1), kappa=3).kept]
    assert fit.cross_check(kept).largest < 1e-9
