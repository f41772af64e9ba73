"""What a joint solution found, and what its errors are like."""

from typing import TYPE_CHECKING

import lazy_loader

from sim.agis.results._solution import AgisSolution, rotate_frame
from sim.agis.results._statistics import correlation_by_angle, ratio_by

if TYPE_CHECKING:
    from sim.agis.results._plot import plot_convergence, plot_correlation, plot_errors_by_magnitude, plot_ratio_map

__all__: list[str] = []

# matplotlib and healpy are imported when a figure is asked for.
__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={"_plot": ["plot_convergence", "plot_correlation", "plot_errors_by_magnitude", "plot_ratio_map"]},
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
