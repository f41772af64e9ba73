"""What the script of the interactive sky is given."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import random_field

import fit
from vsh import Coefficients, ParameterError
from vsh.figures.page import MAX_SOURCES, ShownSolution, sky
from vsh.figures.page import _page as sky_module
from vsh.figures.plot import even_grid


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def data_of(panel):
    return json.loads(re.search(r'id="sky-data">(.*?)</script>', panel.html, re.DOTALL).group(1))


def shown(field, lmax, **how):
    solution = fit.fit_field(field, lmax)
    return ShownSolution("s", field, solution.coefficients, solution.covariance, **how), solution


def test_fields_and_their_errors_are_exact():
    field = random_field(500, seed=1)
    one, solution = shown(field, 3)
    sent = data_of(sky(one))["skies"][0]
    lon, lat = even_grid(sky_module.STEP)
    fields = np.array([floats(each) for each in sent["fields"]]).reshape(3, 2, 2, -1)
    np.testing.assert_allclose(fields.sum((0, 1)), solution.coefficients.at(lon, lat), rtol=1e-5, atol=1e-5)
    # One sum of two degrees of S by hand: prediction at a place, with the covariance of its coefficients.
    only = np.array([mode.kind == "S" and mode.l <= 2 for mode in solution.modes])
    np.testing.assert_allclose(
        fields[:2, 1].sum(0),
        Coefficients(solution.modes, solution.coefficients.values * only).at(lon, lat),
        rtol=1e-4,
        atol=1e-5,
    )
    at, rows = 100, np.eye(len(solution.modes))[only]
    basis = np.array([Coefficients(solution.modes, row).at(lon[at], lat[at]) for row in rows])
    expected = basis.T @ solution.covariance[np.ix_(only, only)] @ basis
    variances = floats(sent["variances"][2 * 3 + 1]).reshape(3, -1)[:, at]  # kinds TS, T, S; degrees 1, 2, 3
    np.testing.assert_allclose(variances, [expected[0, 0], expected[1, 1], expected[0, 1]], rtol=1e-4)
    alone = floats(sent["variances"][9 + 1 * 3 + 2]).reshape(3, -1)[0, at]
    only = np.array([mode.kind == "T" and mode.l == 3 for mode in solution.modes])
    basis = np.array([Coefficients(solution.modes, row).at(lon[at], lat[at]) for row in np.eye(len(only))[only]])
    assert alone == pytest.approx(basis[:, 0] @ solution.covariance[np.ix_(only, only)] @ basis[:, 0], rel=1e-4)


def test_most_significant_sources_are_sent_and_counted():
    field = random_field(MAX_SOURCES + 500, seed=1)
    field = replace(field, name=np.arange(len(field)) + 10**9)
    one, solution = shown(field, 1)
    panel = sky(one)
    sent = data_of(panel)["skies"][0]
    assert sent["sent"] == len(floats(sent["sources"]["lon"])) == MAX_SOURCES
    # A name for each that is sent: later ones were called by their rank, which is another source's number.
    places = dict(zip(map(str, field.name), np.degrees(field.lon), strict=True))
    np.testing.assert_allclose([places[name] for name in sent["names"]], floats(sent["sources"]["lon"]), rtol=1e-6)
    assert f"{MAX_SOURCES} of {len(field)} sources, those with the most significant residuals" in panel.html
    sigmas = floats(sent["sources"]["sigmas"])
    assert (np.diff(sigmas) <= 0).all()
    np.testing.assert_allclose(sigmas[0] ** 2, solution.residuals(field).chi2.max(), rtol=1e-5)
    residual = floats(sent["sources"]["residual"]).reshape(2, -1)
    worst = np.argmax(solution.residuals(field).chi2)
    np.testing.assert_allclose(residual[:, 0], solution.residuals(field).motion[:, worst], rtol=1e-4, atol=1e-4)
    few, _ = shown(field[:100], 1, n_sources=4_000_000)
    assert "100 of 4000000 sources" in sky(few).html


def test_names_cannot_end_the_script():
    field = random_field(50, seed=1)
    field = replace(field, name=np.array(["</script><b>"] * 50))
    panel = sky(shown(field, 1)[0])
    assert "</script><b>" not in panel.html
    assert data_of(panel)["skies"][0]["names"][0] == "</script><b>"


def test_marks_point_where_vectors_do():
    field = random_field(3000, seed=1)
    one, solution = shown(field, 2)
    marks = {mark["name"]: mark for mark in data_of(sky(one))["skies"][0]["marks"]}
    for name, mark in marks.items():
        vector = getattr(solution, name)
        np.testing.assert_allclose(mark["at"], vector.direction)
        assert mark["cone"] == pytest.approx(vector.direction_cone())
    lost = ShownSolution("s", field, solution.coefficients * 1e-3, solution.covariance)
    assert data_of(sky(lost))["skies"][0]["marks"] == []  # directions that are not known


def test_two_solutions_have_one_frame():
    field = random_field(100, seed=1)
    panel = sky(shown(field, 1)[0], shown(field, 2)[0])
    assert panel.html.count("<canvas") == 2
    with pytest.raises(ParameterError, match="one frame"):
        sky(shown(field, 1)[0], shown(field.to_frame("galactic"), 1)[0])
    with pytest.raises(ParameterError, match="one or two"):
        sky()
    wrong = ShownSolution("s", field, fit.fit_field(field, 1).coefficients, np.eye(3))
    with pytest.raises(ParameterError, match="covariance has shape"):
        sky(wrong)
