"""Vector spherical harmonics of proper motions: coefficients, fields and catalogues.

Inside, angles are in radians and proper motions in µas/yr.
"""

from vsh.tools import modules

__version__ = "0.1.0"

# What is named in __init__.pyi is imported when it is first asked for.
__getattr__, __dir__, __all__ = modules.lazy_names_from_stub(__name__, __file__)
modules.warn_if_packages_hidden()
