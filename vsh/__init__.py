"""Vector spherical harmonics of proper motions: coefficients, fields and catalogues.

Inside, angles are in radians and proper motions in µas/yr.
"""

import lazy_loader  # what is named in __init__.pyi is imported when it is first asked for

from vsh.tools import modules

__version__ = "0.1.0"

_lazy, _, __all__ = lazy_loader.attach_stub(__name__, __file__)

modules.install()
modules.warn_if_hidden()
_moved = {old.removeprefix("vsh."): new for old, new in modules.MODULES.items()}
__getattr__ = modules.old_names(__name__, _moved, _lazy)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
