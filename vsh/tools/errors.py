"""What can go wrong, each with the remedy in its message."""

from vsh.tools.printing import printable


class VshError(Exception):
    """Base of every error this project raises on purpose; every one of them is a ValueError too."""

    def __str__(self) -> str:
        return printable(super().__str__())  # what files and columns are called must not steer a terminal


class ModesError(VshError, ValueError):
    """A degree, an order or a number of coefficients that no expansion has."""


class FieldError(VshError, ValueError):
    """A field's arrays disagree in shape, or hold values that are not possible on the sky."""


class NothingLeftError(FieldError):
    """No row of a table can be used.

    Attributes
    ----------
    notes : tuple of str
        Which rows those are, and why.
    """

    notes: tuple[str, ...] = ()


class NothingSelectedError(NothingLeftError):
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
