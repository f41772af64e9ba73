"""Questions that were answered wrongly without a word: by other axes, other sources, or the other way round."""

import numpy as np
import pytest
from conftest import random_field

import fit
from fit.in_time import waves
from vsh import Field, FrameError, Vector
from vsh.classes import Classes
from vsh.io.parts import as_parts
from vsh.models.cosmology import velocity_in_frame
from vsh.scalars import ScalarField
from vsh.sky.astrometry import propagate
from vsh.sky.frames import Positions
from vsh.tools.errors import ParameterError, VshError
from vsh.tools.formats import hide_secrets


def test_motions_of_a_model_are_those_of_its_axes():
    near = Field.from_columns(*(np.random.default_rng(1).uniform(0, 80, (2, 40))), *np.ones((4, 40)),
                              parallax=np.full(40, 5.0), parallax_error=np.full(40, 0.1))  # fmt: skip
    kinematics = fit.motions.stars.kinematics(near)
    assert (near.frame, kinematics.frame) == ("icrs", "galactic")
    with pytest.raises(FrameError):
        kinematics.model(near)


def test_scalars_have_equations_of_a_robust_fit():
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 6.28, 300), np.arcsin(rng.uniform(-1, 1, 300))
    field = ScalarField(lon, lat, rng.normal(size=300), np.ones(300))
    robust = fit.robust.student_t(field, 2)
    assert robust.equations(field, 2).n_sources == 300


def test_a_robust_fit_is_the_same_after_it_was_used(tmp_path):
    """The catalogue went into its file."""
    field = random_field(200, 1)
    robust = fit.robust.student_t(field, 1)
    robust.write(tmp_path / "before.ecsv")
    robust.equations(field, 1)
    robust.write(tmp_path / "after.ecsv")
    assert (tmp_path / "after.ecsv").stat().st_size < 1.1 * (tmp_path / "before.ecsv").stat().st_size


def test_parts_in_several_frames_are_refused():
    field = random_field(200, 1)
    with pytest.raises(FrameError, match="several frames"):
        fit.pairs.correlation_function(as_parts([field.to_frame("galactic"), field]), np.radians([10, 20, 30]))


def test_frequencies_that_no_name_separates():
    with pytest.raises(ParameterError, match="twice"):
        waves(1.0, 1.0000001)


def test_degrees_are_whole():
    normals = [fit.normal_equations(random_field(300, seed), 4) for seed in (1, 2)]
    with pytest.raises(VshError, match=r"3\.7"):
        fit.background.shared(normals, degrees=(2, 3.7))


@pytest.mark.parametrize(("dof", "factor"), [(np.inf, 1.0), (4.0, np.sqrt(2.0))])
def test_errors_of_a_direction_allow_for_few_degrees_of_freedom(dof, factor):
    known, few = (Vector([5, 1, 0], 0.1 * np.eye(3), dof=each) for each in (np.inf, dof))
    assert few.direction_error == pytest.approx(factor * np.array(known.direction_error))
    assert few.direction_cone() == pytest.approx(factor * known.direction_cone(), rel=0.02)


def test_a_cone_of_a_vector_of_known_length():
    cone = Vector.from_spherical(5, 0, 0, (0, 5, 4)).direction_cone()
    assert 5 < cone < 9


def test_edges_of_classes_keep_their_digits():
    assert Classes.from_text("jd:2457123.5").conditions == ("jd < 2457123.5", "jd >= 2457123.5")
    times = 2457000 + 0.01 * np.arange(100)
    assert Classes.by_parts("t", times, 4).masks.sum(1).tolist() == pytest.approx([25] * 4, abs=1)
    assert (Classes.by_parts("x", [1, 1, 1, 1, 2, 3, 4.0], 3).masks.sum(1) > 0).all()


def test_velocities_are_converted():
    assert velocity_in_frame(Vector([369000.0, 0, 0], np.eye(3), unit="m/s"), "icrs").value[0] == pytest.approx(369.0)
    with pytest.raises(VshError):
        velocity_in_frame(Vector([369.0, 0, 0], np.eye(3), unit="uas/yr"), "icrs")


def test_parallaxes_below_their_motions_stay():
    five = np.array([[1.0], [0.3], [100.0], [1e5], [0.0]])
    for light_time in (True, False):
        assert propagate(five, [0.0], [2016.0], [2026.0], light_time=light_time)[0][2] == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize("address", ["https://u:pa?ss@host/t", "https://u:p::w@host/t", "https://u:pa'ss@host/t"])
def test_passwords_of_any_characters_are_hidden(address):
    assert hide_secrets(f"no answer from {address}") == "no answer from https://host/t"


def test_differences_of_two_frames_have_a_sign():
    a, b = random_field(300, 1), random_field(300, 2)
    b = Field(a.lon, a.lat, b.motion, b.sigma, name=np.arange(300))
    a = Field(a.lon, a.lat, a.motion, a.sigma, name=np.arange(300))
    one, two = (Positions(f.lon, f.lat + 1e-9 * k, f.sigma, name=f.name) for k, f in enumerate((a, b)))
    result, _ = fit.frames.compare.compare_catalogues(one, two, 1)
    first, second = result.labels
    there, back = result.vectors(first, second), result.vectors(second, first)
    assert np.allclose(there["glide"].value, -back["glide"].value)
    with pytest.raises(ParameterError, match="the catalogues are"):
        result.vectors("x", "y")
