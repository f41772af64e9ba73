"""The paper on the Solar System's acceleration: Gaia Collaboration, Klioner et al. (2021, A&A 649, A9)."""

from study.gaia._run import DegreeOrSubset, GaiaStudy, Sources, fit_sources, read_gaia, run_gaia, subsets
from study.gaia._write import write_gaia

__all__ = ["read_gaia", "run_gaia", "write_gaia"]
