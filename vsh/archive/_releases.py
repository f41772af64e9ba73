"""Gaia's data releases: epochs, columns, which solutions are of use. What is not published is not here."""

from __future__ import annotations

from dataclasses import dataclass

from vsh.checks.notebook import InNotebook


@dataclass(frozen=True)
class DataRelease(InNotebook):
    """What one release calls things, and when it was observed.

    Attributes
    ----------
    name : str
    epoch : float
        Of positions, a Julian year (TCB).
    months : int
        Of observations.
    schema : str
        Of its tables in the archive.
    solution : str
        The column of gaia_source that says which astrometric model was solved for.
    accepted : dict of int to str
        Those of its values that are of use for quasars and galaxies, and what they are. All others are
        counted by value and left out.
    parallax_bias : str or None
        The column by which parallaxes can be corrected.

    Notes
    -----
    DR3: Lindegren et al. (2021, A&A 649, A2). DR4: ESA's pages on its content and the draft of its data model,
    which may change until it is out on 2 December 2026: gaia_source holds for each source the best model, those of
    stars that are not single among them. Its tables of quasars are not known yet, so no query for them is here.
    """

    name: str
    epoch: float
    months: int
    schema: str
    solution: str
    accepted: dict[int, str]
    parallax_bias: str | None = None


_SINGLE = {31: "position, parallax, proper motion", 95: "the same and a colour"}

DR3 = DataRelease("DR3", 2016.0, 34, "gaiadr3", "astrometric_params_solved", _SINGLE)
DR4 = DataRelease("DR4", 2017.5, 66, "gaiadr4", "astrometric_params", _SINGLE, "tentative_parallax_bias")
#: By name.
RELEASES = {release.name: release for release in (DR3, DR4)}
