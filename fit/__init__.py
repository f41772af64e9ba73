"""From a field to what it says: normal equations, their solution, its report."""

import lazy_loader  # what is named in __init__.pyi is imported when it is first asked for

from vsh import __version__ as __version__
from vsh.tools.modules import old_names

_lazy, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = old_names(__name__, {"report": ("fit.output.report", "the method `solution.report()`")}, _lazy)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
