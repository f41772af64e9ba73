"""What each command loads for its smallest real job: nothing that the job does not need."""

import pytest
from conftest import run_python

import sim
from vsh.commands import COMMANDS
from vsh.io.astrometry import write_astrometry

#: Libraries, and parts of them, that take long to import.
HEAVY = {
    "arviz", "astropy.coordinates", "astropy.cosmology", "astropy.io.ascii", "astropy.io.fits", "astropy.io.votable",
    "astropy.modeling", "astropy.table", "astropy.time", "astropy.units", "astropy.visualization", "astropy.wcs", "corner",
    "concurrent.futures.process", "dask", "emcee", "h5py", "healpy", "matplotlib", "multiprocessing", "numba", "pandas",
    "pyarrow", "scipy.integrate", "scipy.interpolate",
    "scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.special", "scipy.stats", "tqdm",
}  # fmt: skip
#: To read a FITS file, and to solve.
FITS = {"astropy.io.fits", "astropy.units", "scipy.linalg", "scipy.special"}
#: To write a table of columns with units; astropy's brings other formats.
TABLE = {"astropy.table", "astropy.io.ascii", "astropy.io.votable", "astropy.time", "multiprocessing"}
#: What the YAML of astropy's ECSV may hold.
ECSV = {"astropy.coordinates"}
#: Splines of distances; SciPy's bring its searches.
SPLINES = {"scipy.interpolate", "scipy.optimize"}
FIGURES = {"matplotlib", "astropy.coordinates", "astropy.visualization", "astropy.wcs"}
JOBS = {
    "fit": ("q.fits --format none", FITS | TABLE | {"scipy.optimize"}),
    "redshift": ("g.fits --bins 2", FITS | TABLE | SPLINES),
    "correlate": ("q.fits", FITS | TABLE),
    "pairs": ("q.fits", FITS | TABLE),
    "compare": ("a.fits b.fits", FITS | TABLE | {"scipy.optimize"}),
    "link": ("stars.csv", FITS | TABLE),
    "sim --errors expected": ("quasars --number 60 --no-transits --output n.fits", FITS | TABLE),
    "sim": ("quasars --number 60 --output s.fits", FITS | TABLE),
    "referee": ("q.fits --format none", FITS | TABLE | SPLINES | {"scipy.integrate"}),
    "forecast": ("", FITS | TABLE | {"scipy.linalg", "scipy.special"} | SPLINES),
    "waves": ("e.fits --attitude known --frequencies 2 --lmax 2 --nside 2 --skies 5", FITS | TABLE | SPLINES),
    "archive": ("gaia-crf3 --show", set()),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("jobs")
    for name in "qgab":
        population = (sim.galaxies if name == "g" else sim.quasars)(60, 1)
        sim.observe(population, sim.spin((1, 2, 3)), rng=2, sigma=50.0).write(folder / f"{name}.fits")
    write_astrometry(sim.link(1, 12), folder / "stars.csv")
    sim.epochs(sim.quasars(60, 1), sim.spin((1, 2, 3)), 2).write(folder / "e.fits")
    return folder


def test_no_command_is_forgotten():
    assert {job.split()[0] for job in JOBS} == {name.removeprefix("vsh-") for name in COMMANDS}


@pytest.mark.parametrize(
    "job", [pytest.param(job, marks=[pytest.mark.slow] * (job not in ("fit", "sim", "archive"))) for job in JOBS]
)
def test_imports_load_only_what_is_needed(job, folder):
    words, needed = JOBS[job]
    code = (
        "import runpy, sys\nsys.argv = ['vsh', *sys.argv[1:]]\n"
        "try:\n    runpy.run_module('vsh', run_name='__main__')\n"
        "except SystemExit as end:\n    assert not end.code, end.code\n"
        "print('loaded:', *sorted(sys.modules), file=sys.stderr)"
    )
    done = run_python("-c", code, job.split()[0], *words.split(), folder=folder)
    loaded = set(done.stderr.rpartition("loaded: ")[2].split())
    assert loaded & HEAVY <= needed
