"""Objects of other packages in and out: SkyCoord, QTable, pandas, xarray, units; values are equal and units kept."""

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.table import QTable
from gaia_table import NAMES, Stream

import fit
import sim
from vsh import Field, ParameterError, TableError, Vector, read_field
from vsh.sky.frames import AXES

FIELD = sim.observe(sim.quasars(50, rng=1), sim.spin((0, 0, 3)), rng=2, release="DR5")
COLUMNS = ("lon", "lat", "motion", "sigma")


def same(field, other=FIELD, names=COLUMNS):
    for name in names:
        np.testing.assert_allclose(getattr(field, name), getattr(other, name), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("frame", ["icrs", "galactic", "ecliptic"])
def test_skycoord_goes_out_and_in(frame):
    field = FIELD.to_frame(frame)
    read = read_field(field.to_skycoord(), sigma=100)
    assert read.frame == frame
    same(read, field, COLUMNS[:3])
    np.testing.assert_allclose(read.sigma, 100)


def test_qtable_with_a_column_of_coordinates():
    table = QTable({"sky": FIELD.to_skycoord(), "pmra_error": FIELD.sigma[0] * u.uas / u.yr,
                    "pmdec_error": FIELD.sigma[1] * u.uas / u.yr})  # fmt: skip
    same(read_field(table))
    assert "sky" in table.colnames  # which is left as it was


def test_skycoord_with_one_error_for_all():
    field = Field.from_skycoord(FIELD.to_skycoord(), 100 * u.uas / u.yr, 0.1)
    np.testing.assert_allclose(field.sigma, 100)


def test_coordinates_that_are_no_catalogue():
    with pytest.raises(TableError, match="fk5 are not known"):
        read_field(FIELD.to_skycoord().fk5, sigma=1)
    with pytest.raises(TableError, match="one position"):
        read_field(SkyCoord(1 * u.deg, 2 * u.deg), sigma=1)


@pytest.mark.filterwarnings("ignore:warning. half of the errors are below")
def test_distances_of_a_skycoord():
    coord = SkyCoord(FIELD.lon * u.rad, FIELD.lat * u.rad, distance=np.full(50, 2.0) * u.Mpc,
                     pm_ra_cosdec=FIELD.motion[0] * u.uas / u.yr, pm_dec=FIELD.motion[1] * u.uas / u.yr)  # fmt: skip
    table = QTable({"sky": coord, "distance_error": np.full(50, 10.0) * u.kpc})
    field = read_field(table, {"distance": "distance", "distance_error": "distance_error"}, sigma=1)
    np.testing.assert_allclose(field.distance, 2)
    np.testing.assert_allclose(field.distance_error, 0.01)


def test_qtable_has_units():
    table = FIELD.to_qtable()
    np.testing.assert_allclose(table["pmra"].to_value("uas/yr"), FIELD.motion[0], rtol=1e-12)
    same(read_field(table))


def test_xarray_dataset():
    xarray = pytest.importorskip("xarray")
    columns = {name: FIELD.to_table()[name] for name in NAMES}
    data = {name: ("source", np.asarray(column), {"units": str(column.unit)}) for name, column in columns.items()}
    same(read_field(xarray.Dataset(data)))
    data["pmra"] = "source", np.asarray(columns["pmra"]) * 1000, {"units": "uas/yr"}
    same(read_field(xarray.Dataset(data)))
    with pytest.raises(TableError, match="2 lengths"):
        read_field(xarray.Dataset(data | {"other": ("x", [1.0])}))


def test_units_in_the_attributes_of_a_data_frame():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({name: np.asarray(FIELD.to_table()[name]) for name in NAMES})
    frame[["pmra", "pmdec"]] *= 1000
    frame.attrs["units"] = {"pmra": "uas/yr", "pmdec": "uas/yr", "pmra_error": "mas/yr", "pmdec_error": "mas/yr"}
    same(read_field(frame))


def test_vectors_and_coefficients_have_units():
    solution = fit.fit_field(FIELD, 2)
    vector = solution.spin.to("mas/yr")
    np.testing.assert_allclose(vector.value, solution.spin.value / 1000)
    np.testing.assert_allclose(vector.covariance, solution.spin.covariance / 1e6)
    assert (vector.unit, vector.frame, vector.p_value) == ("mas/yr", "icrs", pytest.approx(solution.spin.p_value))
    assert vector.to(u.uas / u.yr).unit == "µas/yr"
    assert vector.quantity.unit == u.mas / u.yr
    np.testing.assert_allclose(solution.coefficients.to("mas/yr").value, solution.values / 1000)
    with pytest.raises(ParameterError, match="cannot be turned into km"):
        Vector([0, 0, 1], np.eye(3)).to("km")
    true = sim.spin([0, 0, 0.003] * u.mas / u.yr)(FIELD.lon, FIELD.lat)
    np.testing.assert_allclose(true, sim.spin((0, 0, 3))(FIELD.lon, FIELD.lat))


def test_solution_is_a_gaussian_likelihood():
    from scipy.stats import multivariate_normal

    solution = fit.fit_field(FIELD, 1)
    gaussian = solution.gaussian()
    assert gaussian.names[0] == "t(1,0)"
    points = np.random.default_rng(1).normal(gaussian.mean, 100, (7, 6))
    expected = multivariate_normal(gaussian.mean, gaussian.covariance).logpdf(points)
    np.testing.assert_allclose(gaussian.log_density(points), expected, rtol=1e-10)
    assert np.ndim(gaussian.log_density(points[0])) == 0
    recommended = fit.recommended(FIELD, 1)
    np.testing.assert_array_equal(recommended.gaussian().mean, recommended.solution.values)


@pytest.mark.parametrize("frame", ["icrs", "galactic"])
def test_data_frames_keep_units_and_frame(frame, tmp_path):
    pandas = pytest.importorskip("pandas")
    field = FIELD.to_frame(frame)
    data = field.to_pandas()
    east = AXES[frame][2]
    data[east] *= 1000
    data.attrs["units"][east] = "uas/yr"
    read = read_field(data)
    assert read.frame == frame
    same(read, field)
    pytest.importorskip("pyarrow")
    data.to_parquet(tmp_path / "data.parquet")
    read = read_field(tmp_path / "data.parquet")
    assert read.frame == frame
    same(read, field)
    assert isinstance(data, pandas.DataFrame)


@pytest.mark.parametrize("through", ["pyarrow", "polars", "capsule"])
def test_arrow_streams_keep_units_and_frame(through):
    pyarrow = pytest.importorskip("pyarrow")
    table = FIELD.to_frame("galactic").to_table()
    for ours, plain in zip(AXES["galactic"], AXES["icrs"], strict=True):
        table.rename_column(ours, plain)
        if f"{ours}_error" in table.colnames:
            table.rename_column(f"{ours}_error", f"{plain}_error")
    schema = pyarrow.schema(
        [pyarrow.field(name, pyarrow.float64(), metadata={"unit": str(table[name].unit)}) for name in NAMES],
        metadata={"FRAME": "galactic"},
    )
    data = pyarrow.table({name: np.asarray(table[name]) for name in NAMES}, schema=schema)
    if through == "polars":  # which has no metadata: the frame is said
        data = pytest.importorskip("polars").from_arrow(data)
    elif through == "capsule":
        data = Stream(data)
    read = read_field(data, frame="galactic" if through == "polars" else None)
    assert read.frame == "galactic"
    same(read, FIELD.to_frame("galactic"))
