"""Vector spherical harmonics of proper motions: coefficients, fields and catalogues.

Inside, angles are in radians and proper motions in µas/yr. What is named in `__init__.pyi` is imported when it is first asked for.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
