"""Names that a user guesses do what they say, and others say what is near."""

import json

import numpy as np
import pytest
from matplotlib.text import Text

import fit
import sim
from vsh import FieldError, ParameterError
from vsh.figures.plot import plot_sources


@pytest.fixture(scope="module")
def field():
    return sim.observe(sim.quasars(300, 1), sim.spin((1, 2, 3)), rng=1)


def test_degree_by_its_name(field):
    assert fit.fit_field(field, lmax=1) == fit.fit_field(field, 1)
    assert fit.fit_field(field) == fit.fit_field(field, 3)
    with pytest.raises(ParameterError, match="one of the two"):
        fit.fit_field(field, modes=1, lmax=1)


def test_parts_of_a_solution(field):
    solution = fit.fit_field(field, 1)
    assert (solution["acceleration"].value == solution.acceleration.value).all()
    assert solution["t(1,0)"] == (solution.values[0], solution.sigma[0])
    assert fit.solve_frame(field)["omega_x"][0] == fit.solve_frame(field).spin.value[0]
    with pytest.raises(ParameterError, match="is it acceleration"):
        solution["aceleration"]
    recommended = fit.recommended(field)
    assert recommended["acceleration"] == recommended.acceleration


def test_signals_are_multiplied():
    one, lon, lat = sim.spin((1, 2, 3)), np.array([0.1, 2.0]), np.array([0.3, -1.0])
    for twice in (2 * one, one * 2.0, -2 * -one):
        assert np.allclose(twice(lon, lat), 2 * one(lon, lat))
    wave = sim.in_time(lambda lon, lat, t: np.stack([t, t]))
    assert np.allclose((3 * wave).displacement(lon, lat, [1.0, 2.0]), [[3, 6], [3, 6]])
    ours = sim.secular_parallax((370.0, 0, 0))
    seen = [(k * ours).observed_redshift(lon, lat, [0.01, 0.01]) for k in (1, 2)]
    assert np.allclose((1.01 / (1 + seen[1]) - 1), 2 * (1.01 / (1 + seen[0]) - 1))
    with pytest.raises(TypeError):
        one * "two"


def test_degrees_are_refused_at_once():
    with pytest.raises(FieldError, match="in radians"):
        sim.Population(np.array([10.0]), np.array([45.0]), np.array([18.0]))


def test_results_print_in_three_lines(field):
    for result in (fit.robust.student_t(field, 2), fit.robust.clip(field, 1), fit.cross_check(field)):
        assert len(repr(result)) < 300
        assert str(result).count("\n") in (0, 2)


def test_field_is_drawn(field):
    axes = plot_sources(field)
    assert axes.get_title().startswith("300 sources")


def test_sky_of_a_fit_and_of_a_signal(field):
    solution = fit.fit_field(field, 2)
    for of in (None, field):
        axes = solution.plot_sky(of)
        assert axes.get_title() == "300 sources and the field fitted to degree 2"
        assert (len(axes.collections) > len(solution.plot_sky().collections)) == (of is not None)
    for signal, redshift, key in ((sim.spin((0, 0, 0)), None, []), (sim.secular_parallax((370.0, 0, 0)), 0.01, ["3"])):
        words = [text.get_text() for text in signal.plot(redshift).figure.findobj(Text)]
        assert [word.removesuffix(" µas/yr") for word in words if "µas" in word] == key


def test_criteria_of_information(field):
    one, two = (fit.fit_field(field, l) for l in (1, 2))
    assert one.aic - one.chi2 == pytest.approx(12)
    assert two.bic - two.chi2 == pytest.approx(16 * np.log(600))


def test_result_as_json(field):
    solution = fit.recommended(field)
    document = json.loads(solution.to_json())
    assert document == solution.to_dict()
    assert document["answer"] == dict(solution.answer.lines)
    assert document["table"]["columns"]["value"]["unit"] is not None
    assert np.array_equal(document["table"]["columns"]["value"]["values"], solution.to_table()["value"])


def test_names_of_other_packages_in_our_modules():
    assert fit.posterior.run_mcmc is fit.posterior.sample
    with pytest.raises(AttributeError, match="did you mean fit.robust.student_t"):
        _ = fit.robust.huber
    with pytest.raises(AttributeError, match="fit.robust has no studentt: did you mean student_t"):
        _ = fit.robust.studentt
