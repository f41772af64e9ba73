"""Studies whose attitude is solved together with the sources."""

import numpy as np
import pytest
from astropy.table import Table

import study
from study.config import StudyError

TOLD = {
    "study": {"name": "solved", "seed": 3, "n_realisations": 2, "frame": "galactic", "lmax": 1},
    "mission": {"years": 2.0, "attitude": "solved", "release": "paper"},
    "truth": {"acceleration": [4.3, 0.0, 0.0], "orientation": [200.0, 0.0, 0.0]},
    "case": [
        {
            "name": "A", "quasars": {"number": 600, "sky": "gums", "variability": 100.0},
            "vlbi": {"number": 150, "radio": 50.0}, "galaxies": {"number": 150, "excess_noise": 215.0},
        }
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joint") / "study"
    study.run(study.load(TOLD), folder, workers=1, progress=False)
    return folder


def files_of(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_every_kind_of_source_is_fitted(finished):
    table = Table.read(finished / "summary.ecsv")
    rows = {row["parameter"]: row for row in table}
    assert {"epsilon_x", "omega_z", "a_x@1", "g_a_y", "v_x"} <= set(rows)
    # The truth is there, within systematic errors of errors.
    assert abs(rows["epsilon_x"]["mean"] - 200) < 8 * rows["epsilon_x"]["sigma"]
    assert abs(rows["a_x"]["mean"] - 4.3) < 12 * rows["a_x"]["sigma"]


@pytest.mark.slow
def test_same_bytes_again_and_by_more_workers(finished, tmp_path):
    study.run(study.load(TOLD), tmp_path / "again", workers=2, progress=False)
    assert files_of(tmp_path / "again") == files_of(finished)


def test_realisations_differ(finished):
    table = Table.read(finished / "results.ecsv")
    values = table[table["parameter"] == "a_x"]["value"]
    assert np.ptp(values) > 0


def test_messages(tmp_path):
    with pytest.raises(StudyError, match='attitude is its error in µas, or "solved"'):
        study.load(TOLD | {"mission": {"attitude": "perfect"}})
    with pytest.raises(StudyError, match="knots must be at least"):
        study.load(TOLD | {"mission": {"attitude": "solved", "knots": 0.0}})
    few = TOLD | {"case": [{"name": "A", "quasars": {"number": 10}}]}
    with pytest.raises(StudyError, match="case A: "):
        study.run(study.load(few), tmp_path / "few", progress=False)
