"""Transits of all sources in the order of time, with the weights of what they measure.

The attitude's errors: a cubic B-spline in time, of three components along the axes of the sky.

Along the axes of the sky, not of the satellite: so it holds a rotation ε₀ + ω t exactly, whatever its knots.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sim.scanning import NominalScanningLaw
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.files import atomic_folder, atomic_write, digest_values, make_scratch_array
from vsh.tools.notebook import Frozen, InNotebook
from vsh.tools.parallel import GIB, free_memory, progress_bar
from vsh.tools.types import ArrayLike, FloatArray, IntArray, PathName
from vsh.tools.units import JULIAN_YEAR

#: Parts that the transits are cut into for threads: fixed, so that their number changes no bit of a sum.
PARTS = 8
#: Bytes: of a transit while transits are sorted and afterwards; of a source; of a source and right-hand side; of a
#: coefficient's row of the band and of its vectors.
_SORTING, _TRANSIT, _SOURCE, _COLUMN, _BAND, _COEFFICIENT = 64, 48, 720, 40 * 12, 3 * 12 * 8, 3 * 6 * 8
#: Bytes of a source in the fit by which iterations stop, degree 3.
_LOW_DEGREE_FIT = 480
#: And of the libraries. [bytes]
_BASE = 3e8
#: CPU seconds (of a 2 GHz server core): of a million transits to follow, and for an iteration; of a million
#: coefficients to solve for.
_FOLLOW, _ITERATE, _SOLVE = 4.0, 0.085, 0.3
#: Sources whose transits are counted for the estimate.
_SAMPLE_SIZE = 300


@dataclass(frozen=True)
class Plan(InNotebook):
    """Cost of a joint solution."""

    transits: float
    coefficients: float
    memory: float
    disk: float
    setup_seconds: float
    iteration_seconds: float

    @property
    def memory_on_disk(self) -> float:
        """Memory where transits, observations and the factor of the attitude are on disk. [bytes]"""
        return self.memory - self.disk

    def __str__(self) -> str:
        return (
            f"{self.transits / 1e6:.1f} million transits, {3 * self.coefficients / 1e6:.1f} million coefficients of the"
            f" attitude: {self.memory / GIB:.1f} GiB of memory, or {self.memory_on_disk / GIB:.1f} and "
            f"{self.disk / GIB:.1f} on disk; {self.setup_seconds / 60:.1f} CPU minutes before the first "
            f"iteration, {self.iteration_seconds:.1f} CPU seconds for each"
        )


@arguments.accepts(
    law=arguments.a(NominalScanningLaw),
    lon=arguments.array_with_dimensions(1),
    lat=arguments.array_with_dimensions(1),
    knots=arguments.positive,
)
def plan(law: NominalScanningLaw, lon: ArrayLike, lat: ArrayLike, knots: float = 30.0, *, ccds: int = 1) -> Plan:
    """Estimate the cost of the joint solution of some sources.

    Parameters
    ----------
    law : NominalScanningLaw
        The scanning law.
    lon, lat : (n,) arrays
        Positions in its frame. [rad]
    knots : float
        Time between knots. [s]
    ccds : {1, 9}
        Observations in a transit.

    Returns
    -------
    Plan
        From constants measured on one machine; good to a factor of two on others.

    Raises
    ------
    ParameterError
        If there are no sources, or positions do not match.
    """
    lon = arguments.float_array("lon", lon)
    arguments.float_array("lat", lat, lon.shape)
    if not len(lon):
        raise ParameterError("a plan needs a source at least")
    arguments.choice("ccds", ccds, (1, 9))
    n, n_transits = np.size(lon), estimate_transit_count(law, lon, lat) * ccds
    coefficients = law.years * JULIAN_YEAR / knots + 3
    memory = _BASE + max(_SORTING * n_transits, system_memory(n, coefficients) + _TRANSIT * n_transits)
    setup_seconds = (_FOLLOW / ccds + 5 * _ITERATE) * n_transits / 1e6 + _SOLVE * coefficients / 1e6
    disk = _TRANSIT * n_transits + _BAND * coefficients + _LOW_DEGREE_FIT * n
    iteration_seconds = _ITERATE * n_transits / 1e6 + _SOLVE * coefficients / 1e6
    return Plan(n_transits, coefficients, max(memory, disk + _BASE), disk, setup_seconds, iteration_seconds)


def estimate_transit_count(law: NominalScanningLaw, lon: ArrayLike, lat: ArrayLike) -> float:
    """About how many transits some sources will have: those of a sample, which the law remembers, times all."""
    lon, lat = np.asarray(lon), np.asarray(lat)
    sample_indices = np.linspace(0, len(lon) - 1, min(_SAMPLE_SIZE, len(lon))).astype(int)
    key = ("transits", lon[sample_indices].tobytes(), lat[sample_indices].tobytes())
    if key not in law.remembered:
        law.remembered[key] = len(law.transits(lon[sample_indices], lat[sample_indices]))
    return 1.02 * law.remembered[key] * len(lon) / len(sample_indices)


def system_memory(n_sources: int, coefficients: float, is_mapped: bool = False) -> float:
    """Bytes of the normal equations, without the transits and, mapped, without what is on disk then."""
    disk_bytes = n_sources * _LOW_DEGREE_FIT + coefficients * _BAND
    vector_bytes = n_sources * (_SOURCE + _COLUMN) + coefficients * _COEFFICIENT
    return vector_bytes if is_mapped else vector_bytes + disk_bytes


def check_memory(n_bytes: float, task: str, remedy: str) -> None:
    """Raise ParameterError if fewer than `n_bytes` are free for a task."""
    free = free_memory()
    if n_bytes > free:
        raise ParameterError(f"{task} would need {n_bytes / GIB:.1f} GiB, and {free / GIB:.1f} GiB are free: {remedy}")


#: Half of the height that a field may have. [rad]
_MAX_HALF_HEIGHT = 0.5
#: Quasars of the paper, at whose number nothing is scaled.
FULL = 500_000


def scaled(
    n: int, law: NominalScanningLaw | None = None, *, knots: float = 30.0, full: int = FULL
) -> tuple[NominalScanningLaw, float]:
    """A scanning law and knots with which n sources are seen as `full` ones are by the whole mission.

    As many sources in a field, observations in an interval and transits of a source: with s = n/full the fields are
    1/√s as wide and the satellite turns √s as fast, so that knots are 1/s as far apart.
    """
    share = arguments.whole("n", n) / arguments.whole("full", full)
    law = NominalScanningLaw() if law is None else arguments.a(NominalScanningLaw)("law", law)
    scale = share**0.5
    if law.half_height / scale > _MAX_HALF_HEIGHT:
        min_sources = int(np.ceil(full * (law.half_height / _MAX_HALF_HEIGHT) ** 2))
        raise ParameterError(
            f"{n} sources are too few to stand for {full}: a field would be "
            f"{np.degrees(2 * law.half_height / scale):.0f}° high. Take {min_sources} or more, or scale nothing"
        )
    # Gaps that were drawn are kept as they are.
    gap_options = {"dead_time": 0.0, "rng": None, "gaps": tuple(map(tuple, law.lost))}
    scaled_law = replace(law, half_height=law.half_height / scale, spin_rate=law.spin_rate * scale, **gap_options)
    return scaled_law, arguments.positive("knots", knots) / share


#: The nine CCDs of a row are passed so many seconds apart.
CCDS, CCD_STEP = 9, 4.85
#: Sources followed together, and transits sorted together.
_BLOCK_SOURCES, _BLOCK_SORTED = 20_000, 4_000_000
#: Transits that a pass looks at together where something is made of each.
BLOCK_TRANSITS = 2**20
_RECORD = np.dtype(
    [("time", "f8"), ("source", "i4"), ("sin", "f4"), ("cos", "f4"), ("along_factor", "f4"), ("across_factor", "f4")]
)
_RECORD_NAMES = tuple(_RECORD.names or ())
#: The names of the file that tells which scans a folder holds, and of the folder of those that are being made.
_KEY_PATTERN = re.compile(r"[0-9a-f]{16}\.(json|parts)")
_COLUMNS = ("source", "place", "knot", "frac", "sin", "cos", "along_factor", "across_factor")


@dataclass(frozen=True, eq=False)
class Scans(Frozen):
    """Transits in the order of time: 32 bytes each.

    `place` is the source's number among all in the order of their places, `order`: neighbours on the sky are neighbours
    in memory there, so that a scan meets few pages, in less than half the time.
    """

    lon: FloatArray
    lat: FloatArray
    weights: FloatArray
    source: IntArray
    place: IntArray
    knot: IntArray
    frac: FloatArray
    sin: FloatArray
    cos: FloatArray
    along_factor: FloatArray
    across_factor: FloatArray
    intervals: int
    spacing: float
    years: float
    frame: str = "icrs"
    folder: Path | None = None
    law: NominalScanningLaw | None = None

    def __len__(self) -> int:
        return len(self.source)

    @property
    def n_sources(self) -> int:
        """Number of sources, n."""
        return len(self.lon)

    @property
    def middle(self) -> float:
        """The reference epoch, since the start of the mission. [yr]"""
        return self.years / 2

    @property
    def sines_and_cosines(self) -> FloatArray:
        """sin α, cos α, sin δ and cos δ of each source, in single precision, (4, n)."""
        columns = [function(angle) for angle in (self.lon, self.lat) for function in (np.sin, np.cos)]
        return np.array(columns, np.float32)

    @cached_property
    def counts(self) -> IntArray:
        """Transits of each source, (n,)."""
        counts = np.zeros(self.n_sources, int)
        for block in self.blocks():
            counts += np.bincount(self.source[block], minlength=self.n_sources)
        return counts

    @cached_property
    def order(self) -> IntArray:
        """The order of the sources by their places, (n,)."""
        return _find_sky_order(self.lon, self.lat)

    def blocks(self) -> Iterator[slice]:
        """Transits so many at a time that no copy of theirs is large."""
        return (slice(start, min(start + BLOCK_TRANSITS, len(self))) for start in range(0, len(self), BLOCK_TRANSITS))

    def array(self, *shape: int) -> FloatArray:
        """Zeros of this shape, beside the transits: in memory, or on disk where they are."""
        return make_scratch_array(self.folder, shape)

    def time(self, part: slice = slice(None)) -> FloatArray:
        """Times of transits since the start of the mission. [yr]"""
        return (self.knot[part] + self.frac[part].astype(float)) * self.spacing


@arguments.accepts(
    law=arguments.a(NominalScanningLaw),
    lon=arguments.array_with_dimensions(1),
    lat=arguments.array_with_dimensions(1),
    knots=arguments.positive,
)
def scans(
    law: NominalScanningLaw,
    lon: ArrayLike,
    lat: ArrayLike,
    sigma_along: ArrayLike,
    sigma_across: ArrayLike | None,
    knots: float = 30.0,
    *,
    ccds: int = 1,
    folder: PathName | None = None,
    threads: int | None = None,
    progress: bool = False,
) -> Scans:
    """Compute the transits of some sources through a mission, in the order of time.

    Parameters
    ----------
    law : NominalScanningLaw
        Its gaps are those of the transits.
    lon, lat : (n,) arrays
        Positions in the law's frame. [rad]
    sigma_along, sigma_across : float or (n,) array
        Errors of a field-of-view transit along and across; None, or infinite, where nothing is measured. [µas]
    knots : float
        Time between knots of the attitude. [s]
    ccds : {1, 9}
        Observations of a transit: one, or one on each of nine CCDs, 4.85 s apart with three times the error.
    folder : path, optional
        Keep the transits there and map them into memory, and beside them the observations, the attitude's factor and
        what sources add to low degrees. Transits are read again where they are the same, and those that a killed run
        had followed are not followed again.
    threads : int, optional
        One a core unless given; changes nothing.
    progress : bool
        Show a bar, after two seconds.

    Raises
    ------
    ParameterError
        If an error is not above zero, knots are longer than the mission, or the memory would not do.
    """
    lon = arguments.float_array("lon", lon)
    lat, n, shape = arguments.float_array("lat", lat, lon.shape), len(lon), lon.shape
    along_error = arguments.float_array("sigma_along", sigma_along, shape, broadcast=True)
    across_error = np.inf if sigma_across is None else sigma_across
    across_error = arguments.float_array("sigma_across", across_error, shape, finite=False, broadcast=True)
    if not ((along_error > 0).all() and (across_error > 0).all()):
        n_bad = int(np.sum(~(along_error > 0)) + np.sum(~(across_error > 0)))
        raise ParameterError(f"{n_bad} errors of transits are zero or negative")
    arguments.choice("ccds", ccds, (1, CCDS))
    spacing = knots / JULIAN_YEAR
    if spacing >= law.years:
        raise ParameterError(f"knots {knots:g} s apart are no knots in a mission of {law.years:g} years")
    if n == 0:
        raise ParameterError("scans need a source at least")
    weights = np.stack([1 / along_error**2, 1 / across_error**2]) / ccds
    attributes: dict[str, Any] = {
        "lon": lon.copy(),
        "lat": lat.copy(),
        "weights": weights,
        "intervals": int(np.ceil(law.years / spacing)),
        "spacing": spacing,
        "years": law.years,
        "frame": law.frame,
        "law": law,
    }
    scans_key = _digest_scan_inputs(law, attributes, ccds)
    if folder is None:
        check_memory(
            2 * _RECORD.itemsize * estimate_transit_count(law, lon, lat) * ccds, "transits", "give a folder= for them"
        )
        return Scans(
            **attributes, **_sort_transits(_follow_law(law, lon, lat, ccds, threads, progress, None), attributes, None)
        )
    path = _check_scans_folder(Path(folder))
    if not (path / f"{scans_key}.json").exists():
        parts = path / f"{scans_key}.parts"  # stay where the run is killed, and go with the folder that is replaced
        parts.mkdir(parents=True, exist_ok=True)
        with atomic_folder(path) as temporary_folder:
            _sort_transits(_follow_law(law, lon, lat, ccds, threads, progress, parts), attributes, temporary_folder)
            (temporary_folder / f"{scans_key}.json").write_text(
                json.dumps({"sources": n, "knots": knots, "ccds": ccds}), encoding="utf-8"
            )
    return Scans(**attributes, **{name: np.load(path / f"{name}.npy", mmap_mode="r") for name in _COLUMNS}, folder=path)


def _check_scans_folder(folder):
    """The folder, if nothing else than scans is in it, which may be replaced."""
    file_names = {f"{name}.npy" for name in _COLUMNS}
    if folder.exists() and not folder.is_dir():
        raise ParameterError(f"{folder} is a file, not a folder for scans")
    names = [entry.name for entry in folder.iterdir()] if folder.exists() else []
    other_files = [name for name in names if name not in file_names and not _KEY_PATTERN.fullmatch(name)]
    if other_files:
        raise ParameterError(f"{folder} holds other files ({other_files[0]}, …): name a new folder for scans")
    return folder


def _follow_law(law, lon, lat, ccds, threads, progress, folder):
    """Transits of blocks of sources, each block in the order of time: arrays, or the files that hold them."""
    rotation = rotation_matrix("ecliptic", law.frame)
    # Not over the edges of the mission: the end is an edge of the last interval.
    last_time = np.nextafter(law.years, 0)
    with progress_bar(total=len(lon), words="transits", shown=progress, unit=" sources") as bar:
        for start in range(0, len(lon), _BLOCK_SOURCES):
            block = slice(start, min(start + _BLOCK_SOURCES, len(lon)))
            part_path = None if folder is None else folder / f"part-{start}-{block.stop}.npy"
            if part_path is not None and part_path.exists():
                bar.update(block.stop - start)
                yield np.load(part_path, mmap_mode="r")
                continue
            transits = law.transits(lon[block], lat[block], threads=threads)
            p, q, _ = triad(lon[block], lat[block])
            records = np.empty((len(transits), ccds), _RECORD)
            ccd_delays = (np.arange(ccds) - (ccds - 1) / 2) * CCD_STEP / JULIAN_YEAR
            records["time"] = np.clip(transits.time[:, None] + ccd_delays, 0, last_time)
            sin, cos = np.sin(transits.angle), np.cos(transits.angle)
            sun, distance = law.sun(transits.time)
            sun = rotation @ sun
            east, north = (np.einsum("ij,ij->j", v[:, transits.source], sun) for v in (p, q))
            # As of the parallax along the scan: the Sun seen from 1 % beyond the Earth.
            factors = transits.parallax_factor, 1.01 * distance * (sin * north - cos * east)
            for name, column in zip(_RECORD_NAMES[1:], (transits.source + start, sin, cos, *factors), strict=True):
                records[name] = column[:, None]
            records = records.ravel()
            records = records[np.argsort(records["time"], kind="stable")]
            bar.update(len(p[0]))
            if part_path is None:
                yield records
            else:
                with atomic_write(part_path, overwrite=True) as temporary_path:
                    np.save(temporary_path, records)
                yield np.load(part_path, mmap_mode="r")


def _sort_transits(chunks, attributes, folder):
    """All parts in one order of time: columns, in memory or as files of a folder."""
    chunks = list(chunks)
    n_transits = sum(map(len, chunks))
    dtypes = {name: np.dtype("i4" if name in ("source", "place", "knot") else "f4") for name in _COLUMNS}
    rank = np.argsort(_find_sky_order(attributes["lon"], attributes["lat"]))
    columns = {
        name: (
            np.empty(n_transits, dtype)
            if folder is None
            else np.lib.format.open_memmap(folder / f"{name}.npy", "w+", dtype, (n_transits,))
        )
        for name, dtype in dtypes.items()
    }
    time_edges = np.linspace(0, attributes["years"], n_transits // _BLOCK_SORTED + 2)
    time_edges[-1] = np.inf
    # Once for all edges: each search makes a copy of a part's times.
    cuts = [np.searchsorted(chunk["time"], time_edges) for chunk in chunks]
    offset = 0
    for k in range(len(time_edges) - 1):
        records = np.concatenate([chunk[slice(*cut[k : k + 2])] for chunk, cut in zip(chunks, cuts, strict=True)])
        records = records[np.argsort(records["time"], kind="stable")]
        rows = slice(offset, offset + len(records))
        knot_time = records["time"] / attributes["spacing"]
        columns["knot"][rows] = np.minimum(knot_time.astype("i4"), attributes["intervals"] - 1)
        columns["frac"][rows] = knot_time - columns["knot"][rows]
        for name in _RECORD_NAMES[1:]:
            columns[name][rows] = records[name]
        columns["place"][rows] = rank[records["source"]]
        offset += len(records)
    for column in columns.values():
        if folder is not None:
            column.flush()  # type: ignore[union-attr]  # a map of a file where there is a folder
    return columns


def _find_sky_order(lon, lat):
    """The order of sources in bands of latitude, along each by longitude; some fifty in a square of a band's height."""
    band = np.floor(lat / np.sqrt(4 * np.pi * 50 / len(lat)))
    return np.lexsort((lon, band))


def _digest_scan_inputs(law, attributes, ccds):
    """A hash of all that determines the transits, and of what is kept of each."""
    law_options = {entry.name: getattr(law, entry.name) for entry in fields(law) if entry.init and entry.name != "rng"}
    arrays = law.lost, attributes["lon"], attributes["lat"], attributes["weights"]
    return digest_values(((law_options, attributes["spacing"], ccds, _COLUMNS), *arrays))[:16]


#: Coefficients that meet in an interval, times three components: rows of the band, the diagonal among them.
BANDS = 12


def evaluate_splines(fraction: FloatArray) -> FloatArray:
    """The four B-splines that are not zero at a fraction of an interval, (4, k)."""
    f, g = fraction, 1 - fraction
    return np.stack([g**3, 4 - 6 * f**2 + 3 * f**3, 4 - 6 * g**2 + 3 * g**3, f**3]) / 6


def add_smoothing(band: FloatArray, weight: float) -> None:
    """Add to the normal equations a penalty on second differences of the coefficients.

    It bridges gaps in which nothing is observed, costs no bandwidth and spares ε₀ + ω t, which a ridge would not.
    """
    n = band.shape[1] // 3
    difference_weights = (1.0, -2.0, 1.0)
    for i, u in enumerate(difference_weights):
        for j in range(i + 1):
            # Products of coefficients k + i and k + j, for k = 0 … n − 3 and three components each.
            band[3 * (i - j), 3 * j : 3 * (j + n - 2)] += weight * u * difference_weights[j]
