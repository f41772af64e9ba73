"""Velocities on a cubic grid, as reconstructions from galaxies come in files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsh.checks import arguments
from vsh.checks.notebook import InNotebook
from vsh.checks.notes import printable
from vsh.checks.types import FloatArray, PathName
from vsh.errors import ParameterError, TableError
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import triad
from vsh.system.files import write_arrays


@dataclass(frozen=True, eq=False, repr=False)
class VelocityGrid(InNotebook):
    """Velocities on a cube around us.

    Attributes
    ----------
    velocity : (3, k, k, k) array
        Components along the axes of `frame`, at points from −half_width to +half_width on each axis. [km/s, in the
        frame of the microwave background]
    half_width : float
        [Mpc/h]
    frame : str
        Of the axes.

    Raises
    ------
    ParameterError
        If it is no cube of finite numbers.
    """

    velocity: FloatArray
    half_width: float
    frame: str = "galactic"

    def __post_init__(self) -> None:
        velocity = np.asarray(self.velocity)
        size = velocity.shape[-1] if velocity.ndim == 4 else 0
        if size < 2 or velocity.shape != (3, size, size, size):
            raise ParameterError(
                f"a grid of velocities has shape (3, k, k, k), not {velocity.shape}: components, then x, y and z"
            )
        if velocity.dtype.kind not in "fiu" or not np.isfinite(velocity).all():
            raise ParameterError("a grid of velocities holds finite numbers, in km/s")
        check_frame(self.frame)
        object.__setattr__(self, "velocity", velocity)
        object.__setattr__(self, "half_width", arguments.positive("half_width", self.half_width))

    def __repr__(self) -> str:
        return f"<VelocityGrid: {self.velocity.shape[-1]}³ points to ±{self.half_width:g} Mpc/h, {self.frame}>"

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray, frame: str) -> tuple[FloatArray, FloatArray]:
        """The velocity between the points, by threes of linear interpolations, along the axes of `frame`.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions in `frame`. [rad]
        distance : (n,) array
            [Mpc/h]
        frame : str
            Of the positions and of the result.

        Returns
        -------
        velocity : (3, n) array
            [km/s]; zero outside the cube.
        inside : (n,) mask
            Which sources are within the cube.
        """
        from scipy.ndimage import map_coordinates  # slow to import

        turn = rotation_matrix(frame, self.frame)
        places = turn @ triad(lon, lat)[2] * np.asarray(distance, float)
        inside = (np.abs(places) <= self.half_width).all(0)
        size = self.velocity.shape[-1]
        index = (places + self.half_width) * ((size - 1) / (2 * self.half_width))
        found = np.stack([map_coordinates(each, index, order=1, cval=0.0, output=float) for each in self.velocity])
        return turn.T @ np.where(inside, found, 0.0), inside

    def write(self, path: PathName) -> None:
        """Write it as a file of NumPy, which `read_velocity_grid` reads.

        Parameters
        ----------
        path : str or Path
            Its ending is .npz.
        """
        arrays = {"velocity": self.velocity, "half_width": self.half_width, "frame": np.array(self.frame)}
        write_arrays(path, arrays, compress=True)


def read_velocity_grid(path: PathName, half_width: float | None = None, frame: str | None = None) -> VelocityGrid:
    """Read velocities on a grid.

    Parameters
    ----------
    path : str or Path
        .npz as `VelocityGrid.write` writes it; or .npy, an array (3, k, k, k) as that of 2M++ (Carrick et al. 2015,
        MNRAS 450, 317), which is in Galactic axes to ±200 Mpc/h.
    half_width : float, optional
        Of the cube: the file's own, or 200 Mpc/h of an .npy file.
    frame : str, optional
        Of the axes: the file's own, or Galactic of an .npy file.

    Raises
    ------
    TableError
        If the file cannot be read or holds no such grid.
    """
    label = printable(path)
    try:
        found = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise TableError(f"{label} cannot be read as a grid of velocities (.npz or .npy of NumPy): {error}") from None
    if isinstance(found, np.ndarray):
        velocity, own_width, own_frame = found, 200.0, "galactic"
    else:
        with found:
            missing = {"velocity", "half_width", "frame"} - set(found.files)
            if missing:
                raise TableError(f"{label} lacks {', '.join(sorted(missing))}: it is no grid of velocities")
            velocity, own_width, own_frame = found["velocity"], float(found["half_width"]), str(found["frame"])
    try:
        return VelocityGrid(velocity, half_width or own_width, frame or own_frame)
    except ParameterError as error:
        raise TableError(f"{label}: {error}") from None
