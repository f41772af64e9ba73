"""Results as tables, and back: ECSV or FITS, every bit of every number, readable by astropy alone.

What does not fit into columns stands as JSON under RESULT in the metadata: FITS headers keep
neither all digits of a number nor letters beyond ASCII.
"""

import json
from importlib import import_module

import numpy as np

from vsh.errors import TableError

#: Where each kind of result is defined.
_HOMES = {
    "Solution": "fit.solution", "Prediction": "fit.predict", "FrameSolution": "fit.frame", "VelocitySolution": "fit.drift",
    "HubbleSolution": "fit.drift", "BinnedSolution": "fit.binned", "CorrelationMap": "fit.correlation", "Leakage": "fit.leakage",
}  # fmt: skip
_FORMATS = ("ascii.ecsv", "fits")


class Stored:
    """A result that can be written to a file and read back."""

    def write(self, path, meta=None):
        """Write to an ECSV or FITS file, which takes its name when it is complete.

        Parameters
        ----------
        path : str or Path
        meta : dict, optional — provenance, plain values
        """
        from vsh import tables

        _check_format(path)
        columns, rest, units = pack(self)
        mark = json.dumps({"type": type(self).__name__} | rest)
        plain = {key: value for key, value in (("frame", getattr(self, "frame", None)), ("n_data", getattr(self, "n_data", None)))
                 if value is not None}  # fmt: skip
        if getattr(self, "notes", None) and tables.format_of(path) == "ascii.ecsv":  # a FITS header has no lists
            plain["notes"] = list(map(str, self.notes))
        tables.write(path, columns, plain | (meta or {}) | {"RESULT": mark}, units)

    @classmethod
    def read(cls, path):
        """Read what `write` wrote, bit for bit.

        Raises
        ------
        TableError
            If the file holds no result, or one of another kind.
        """
        found = read(path)
        if not isinstance(found, cls):
            raise TableError(
                f"{path} holds a {type(found).__name__}, not a {cls.__name__}: fit.storage.read takes either"
            )
        return found


def read(path):
    """Read any result that was written to a file.

    Raises
    ------
    TableError
        If the file holds none.
    """
    from vsh import tables

    _check_format(path)
    table = tables.read(path)
    try:
        rest = json.loads({key.upper(): value for key, value in table.meta.items()}["RESULT"])
        kind = rest.pop("type")
        home = import_module(_HOMES[kind])
    except (KeyError, TypeError, ValueError):
        raise TableError(f"{path} holds no result of a fit: it lacks its mark, RESULT, in the metadata") from None
    columns = {name: _native(table[name]) for name in table.colnames}
    return _UNPACK[_family(kind)](getattr(home, kind), columns, rest)


def pack(result):
    """Columns, the rest as plain values, and units of columns."""
    return _PACK[_family(type(result).__name__)](result)


def _family(kind):
    if kind in ("FrameSolution", "VelocitySolution", "HubbleSolution"):
        return "parameters"
    return "solution" if kind == "Prediction" else kind.lower()


def _check_format(path):
    from vsh import tables

    if tables.format_of(path) not in _FORMATS:
        raise TableError(f"{path}: results are written as .ecsv or .fits, which keep every bit")


def _native(column):
    array = np.asarray(column)
    return array.astype(array.dtype.newbyteorder("=")) if array.dtype.kind in "fi" else array.astype(str)


def _coefficient_columns(modes):
    modes = list(modes)
    return {
        "coefficient": [str(mode) for mode in modes], "kind": [mode.kind for mode in modes],
        "l": [mode.l for mode in modes], "m": [mode.m for mode in modes], "part": [mode.part or "-" for mode in modes],
    }  # fmt: skip


def _pack_solution(solution):
    columns = _coefficient_columns(solution.modes) | {
        "value": solution.coefficients.values, "sigma": solution.sigma, "covariance": solution.covariance,
    }  # fmt: skip
    rest = {"lmax": solution.modes.lmax, "chi2": _exact(solution.chi2), "n_data": int(solution.n_data), "frame": solution.frame,
            "notes": list(map(str, solution.notes)), "errors_from": solution.errors_from}  # fmt: skip
    if hasattr(solution, "_weight"):
        rest |= {"weight": _exact(solution._weight), "alone": [[_exact(x) for x in row] for row in solution._alone]}
    return columns, rest, dict.fromkeys(("value", "sigma"), "uas / yr") | {"covariance": "uas2 / yr2"}


def _unpack_solution(kind, columns, rest):
    from vsh import Coefficients, Modes

    coefficients = Coefficients(Modes(rest["lmax"]), columns["value"])
    extra = ()
    if "weight" in rest:
        extra = _number(rest["weight"]), np.array([[_number(x) for x in row] for row in rest["alone"]])
    return kind(
        coefficients, columns["covariance"], _number(rest["chi2"]), rest["n_data"], rest["frame"], tuple(rest["notes"]),
        rest["errors_from"], *extra,
    )  # fmt: skip


def _pack_parameters(found):
    from vsh.vector import Vector

    columns = {
        "parameter": list(found.names),
        "value": found.values,
        "sigma": found.sigma,
        "covariance": found.covariance,
    }
    rest = {}
    for name in found.__dataclass_fields__:
        if name in ("names", "values", "covariance"):
            continue
        value = getattr(found, name)
        if isinstance(value, Vector):
            value = {"value": [_exact(x) for x in value.value], "covariance": [[_exact(x) for x in row] for row in value.covariance],
                     "frame": value.frame, "unit": value.unit}  # fmt: skip
        rest[name] = (
            _exact(value) if isinstance(value, float) else list(map(str, value)) if isinstance(value, tuple) else value
        )
    return columns, rest, {}


def _unpack_parameters(kind, columns, rest):
    from vsh.vector import Vector

    options = {}
    for name, value in rest.items():
        if isinstance(value, dict):
            three, nine = (np.vectorize(_number)(value[key]) for key in ("value", "covariance"))
            options[name] = Vector(three, nine, value["frame"], value["unit"])
        else:
            options[name] = tuple(value) if isinstance(value, list) else _number(value) if _is_hex(value) else value
    return kind(
        names=tuple(columns["parameter"].tolist()), values=columns["value"], covariance=columns["covariance"], **options
    )


def _pack_binnedsolution(binned):
    p, bins, q = len(binned.modes), len(binned), len(binned.free)
    joint = np.full((bins * p, bins * q), np.nan)
    joint[: bins * q] = binned.covariance
    each = _coefficient_columns(binned.modes)
    columns = {"bin": np.repeat(np.arange(bins), p)} | {name: values * bins for name, values in each.items()}
    columns |= {
        "value": np.concatenate([s.coefficients.values for s in binned.solutions]),
        "covariance": np.concatenate([s.covariance for s in binned.solutions]), "joint_covariance": joint,
        "normal_matrix": np.concatenate([n.matrix for n in binned.normals]),
        "normal_rhs": np.concatenate([n.rhs for n in binned.normals]),
    }  # fmt: skip
    rest = {name: [_exact(x) for x in getattr(binned, name)] for name in ("edges", "redshift", "nearness")}
    rest |= {"counts": binned.counts.tolist(), "free": binned.free.tolist(), "notes": list(map(str, binned.notes)),
             "lmax": binned.modes.lmax, "frame": binned.frame,
             "solutions": [[_exact(s.chi2), int(s.n_data), list(map(str, s.notes)), s.errors_from] for s in binned.solutions],
             "normals": [[_exact(n.chi2_zero), int(n.n_data), list(map(str, n.notes))] for n in binned.normals]}  # fmt: skip
    return columns, rest, {"value": "uas / yr"}


def _unpack_binnedsolution(kind, columns, rest):
    from fit.normal import NormalEquations
    from vsh import Coefficients, Modes

    one = import_module(_HOMES["Solution"]).Solution
    modes, frame = Modes(rest["lmax"]), rest["frame"]
    solutions, normals = [], []
    for b, (solved, summed) in enumerate(zip(rest["solutions"], rest["normals"], strict=True)):
        mine = columns["bin"] == b
        chi2, n_data, notes, errors_from = solved
        coefficients = Coefficients(modes, columns["value"][mine])
        solutions.append(
            one(coefficients, columns["covariance"][mine], _number(chi2), n_data, frame, tuple(notes), errors_from)
        )
        matrix, rhs = columns["normal_matrix"][mine], columns["normal_rhs"][mine]
        normals.append(NormalEquations(modes, matrix, rhs, _number(summed[0]), summed[1], frame, tuple(summed[2])))
    edges, redshift, nearness = (
        np.array([_number(x) for x in rest[name]]) for name in ("edges", "redshift", "nearness")
    )
    size = len(rest["free"]) * len(solutions)
    return kind(
        edges, solutions, normals, redshift, np.array(rest["counts"]), columns["joint_covariance"][:size],
        np.array(rest["free"]), nearness, tuple(rest["notes"]),
    )  # fmt: skip


def _pack_correlationmap(found):
    columns = {"parameter": list(found.names)} | {f"matrix_{i}": matrix for i, matrix in enumerate(found.matrices)}
    rest = {
        "labels": list(found.labels),
        "frame": found.frame,
        "dipoles": [[_exact(x) for x in d] for d in found.dipoles],
    }
    return columns, rest, {}


def _unpack_correlationmap(kind, columns, rest):
    labels = tuple(rest["labels"])
    dipoles = [np.array([_number(x) for x in d]) for d in rest["dipoles"]]
    matrices = [columns[f"matrix_{i}"] for i in range(len(labels))]
    return kind(tuple(columns["parameter"].tolist()), matrices, labels, dipoles, rest["frame"])


def _pack_leakage(found):
    columns = {"coefficient": list(found.names), "matrix": found.matrix}
    rest = {"fitted": found.fitted.lmax, "unmodelled": found.unmodelled.lmax, "names": list(found.unmodelled_names)}
    return columns, rest | {"frame": found.frame}, {}


def _unpack_leakage(kind, columns, rest):
    from vsh import Modes

    names = tuple(columns["coefficient"].tolist())
    return kind(
        columns["matrix"], Modes(rest["fitted"]), Modes(rest["unmodelled"]), names, tuple(rest["names"]), rest["frame"]
    )


def _exact(x):
    """A number in hexadecimal: every bit, nan and inf among them."""
    return float(x).hex()


def _number(text):
    return float.fromhex(text) if isinstance(text, str) else text


def _is_hex(value):
    return isinstance(value, str) and value.lstrip("-").startswith(("0x", "nan", "inf"))


_PACK = {
    name.removeprefix("_pack_"): function for name, function in list(globals().items()) if name.startswith("_pack_")
}
_UNPACK = {
    name.removeprefix("_unpack_"): function for name, function in list(globals().items()) if name.startswith("_unpack_")
}
