"""
A study of one's own
====================

Whether an error bar is true is not argued, it is tried: simulate a sky with a known truth, fit it, look how far off the fit is, in its errors; do
this many times. A study is a file that says which sky, which truth, how often. Here one asks: does an acceleration from 3000 quasars come out
right on a sky that is not even?
"""

from pathlib import Path
from tempfile import mkdtemp

from study import load, run
from study.run import plot_calibration, read_realisations, summary

folder = Path(mkdtemp())
(folder / "study.toml").write_text(
    """
[study]
name = "my survey"
seed = 1
n_realisations = 40
frame = "galactic"
lmax = 1

[mission]
release = "DR4"

[truth]
acceleration = [5.05, 0.0, 0.0]

[[case]]
name = "even"
quasars = { number = 3000, sky = "uniform" }

[[case]]
name = "uneven"
quasars = { number = 3000, sky = "igql" }
""",
    encoding="utf-8",
)

# %%
# Run it
# ------
#
# Every transit of the satellite is followed once; each realisation draws noise with the covariances that come out. Realisations are kept in files of their
# own: a study that is killed goes on where it was, and the same seed gives the same bytes.
study = load(folder / "study.toml")
results = run(study, folder / "results", workers=1, progress=False)
study

# %%
# Look
# ----
#
# For every parameter: truth, mean, scatter, the error that was quoted. If errors are right, scatter over error is 1, the mean is off by no more
# than the error of a mean, and 68 % of intervals cover the truth.
rows = [row for row in summary(study, read_realisations(study, results, 40)) if "@" not in row["parameter"]]
print(f"{'case':10}{'parameter':12}{'truth':>8}{'mean':>9}{'scatter':>9}{'quoted':>9}{'68 %':>7}")
for row in rows:
    print(
        f"{row['case']:10}{row['parameter']:12}{row['truth']:8.2f}{row['mean']:9.3f}{row['std']:9.3f}{row['sigma']:9.3f}{100 * row['within_68']:6.0f}%"
    )

# %%
plot_calibration(rows)

# %%
# Both cases are calibrated: what an uneven sky costs is in its errors. With 40 realisations a scatter is known to 11 %; before you call something wrong,
# raise ``n_realisations`` (the study goes on).
#
# From a shell::
#
#     vsh-study study.toml --output results
#
# All keys of the file: :doc:`../study`.
