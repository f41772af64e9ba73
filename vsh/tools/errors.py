"""What can go wrong, each with the remedy in its message."""

import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

from vsh.tools.printing import printable


class VshError(Exception):
    """Base of every error this project raises on purpose; every one of them is a ValueError too."""

    def __str__(self) -> str:
        return printable(super().__str__())  # what files and columns are called must not steer a terminal


class ModesError(VshError, ValueError):
    """A degree, an order or a number of coefficients that no expansion has."""


class FieldError(VshError, ValueError):
    """A field's arrays disagree in shape, or hold values that are not possible on the sky."""


class EmptyFieldError(FieldError):
    """No row of a table can be used.

    Attributes
    ----------
    notes : tuple of str
        Which rows those are, and why.
    """

    notes: tuple[str, ...] = ()


class EmptySelectionError(EmptyFieldError):
    """A condition selects no row of a table."""


class FrameError(VshError, ValueError):
    """A reference frame nobody knows, or two that do not match."""


class TableError(VshError, ValueError):
    """A table cannot be read, or lacks what a field needs."""


class ArchiveError(VshError, ValueError):
    """An archive is away, refuses a query, or does not send the whole answer."""


class ParameterError(VshError, ValueError):
    """A number that no such parameter can have: a Hubble constant of zero, say."""


class DegeneracyError(VshError, ValueError):
    """The data cannot tell some of the parameters apart."""


class CovarianceError(VshError, ValueError, AttributeError):
    """A solution was asked for a covariance that it does not have."""


class ConvergenceError(VshError, ValueError):
    """An iteration has not converged."""


class CheckpointError(VshError, ValueError):
    """A file of a run that was interrupted cannot be used to go on."""


class WriteError(VshError, ValueError):
    """A file is somebody else's, is read by the same run, or is being written by another process."""


class VshWarning(UserWarning):
    """Base of every warning: the answer stands, but read it with care."""


def first_line(error: object) -> str:
    """The first line of what an error says."""
    text = str(error).strip()
    return text.splitlines()[0].rstrip(".") if text else type(error).__name__


#: What people who know other packages ask a result, a field or a vector for, and what it is here: a name answers, other
#: words are a hint.
ATTRIBUTES = {
    "cl": "power", "coef_": "values", "coords": "to_skycoord()", "cov": "covariance", "describe": "to_table().info()",
    "error": "sigma", "evaluate": "predict", "fit": "fit.recommended(field)", "galactic": 'to_frame("galactic")',
    "get_power": "power", "icrs": 'to_frame("icrs")', "log_likelihood": "chi2, −2 ln L up to a constant",
    "mag": "magnitude", "mask": "field[mask], which selects", "params": "values", "plot_spectrum": "plot",
    "save": "write", "skycoord": "to_skycoord()", "sort": "to_table(), whose rows can be sorted", "std": "sigma",
    "to_arviz": "sample(n), whose draws ArviZ takes", "to_latex": "latex",
}  # fmt: skip
#: The same of modules.
NAMES = {
    "Table": "astropy.table.Table; vsh.read_field reads a catalogue",
    "T": "vsh.basis.harmonics, or Coefficients(…).at(lon, lat)", "archive": "vsh.io.archive",
    "catalogue": "vsh.io.catalogue", "cosmology": "vsh.models.cosmology", "evaluate": "Coefficients(…).at(lon, lat)",
    "fit": "fit.recommended(field), after `import fit`", "harmonics": "vsh.basis.harmonics",
    "healpix": "vsh.sky.pixels", "huber": "fit.robust.student_t, which leaves less to a choice",
    "plot": "vsh.figures.plot", "plot_sky": "vsh.figures.plot.plot_field", "read": "vsh.read_field",
    "read_table": "vsh.read_field", "run_mcmc": "fit.posterior.sample",
    "simulate": "sim.observe(sim.quasars(n), signal)", "sky": "vsh.figures.plot.plot_field",
    "vsh": "vsh.basis.harmonics(lon, lat, modes)",
}  # fmt: skip
#: The same of arguments.
ARGUMENTS = {
    "n": "n_replicates", "random_state": "rng",
    "robust": "the function fit.robust.student_t, or fit.estimate(field, lmax, method)", "seed": "rng",
}  # fmt: skip


class MissingAttribute(AttributeError):
    """The error for an attribute that an object does not have; what it may be is looked for when the error is shown."""

    def __str__(self) -> str:
        owner, name = self.obj, str(self.name)
        names = [name for name in dir(owner) if not name.startswith("_")]
        hint = ATTRIBUTES.get(name, "")
        if re.sub(r"\W.*", "", hint) not in names and not hint.startswith(("fit.", "field[")):
            hint = " or ".join(get_close_matches(name, names, n=2))
        return f"{type(owner).__name__} has no {name}{hint and f': did you mean {hint}?'}"


def missing_name_error(module: str, name: str, names: list[str], original_error: AttributeError) -> AttributeError:
    """The error for a name that a module does not have, with what it may be."""
    if name.startswith("_"):
        return original_error
    hint = NAMES.get(name) or " or ".join(get_close_matches(name, names, n=3))
    return AttributeError(f"{module} has no {name}: did you mean {hint}?", name=name) if hint else original_error


def unknown_argument_error(function: Callable[..., Any], error: TypeError) -> TypeError:
    """Add to an error the name that an unknown argument may have."""
    match = re.fullmatch(r".*\(\) got an unexpected keyword argument '(\w+)'", str(error))
    if match is None:
        return error
    annotations: Mapping[str, Any] = function.__annotations__
    hint = ARGUMENTS.get(match[1], "")
    if hint not in annotations and " " not in hint:
        hint = " or ".join(get_close_matches(match[1], list(annotations), n=2))
    return TypeError(f"{error}: did you mean {hint}?") if hint else error
