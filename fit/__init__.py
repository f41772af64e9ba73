"""From a field to what it says: normal equations, their solution, its report.

What is named in `__init__.pyi` is imported when it is first asked for.
"""

import lazy_loader

import vsh  # which knows modules by their old names, too

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
