"""Skies with a known truth."""

from vsh.tools.modules import lazy_names_from_stub

# What is named in __init__.pyi is imported when it is first asked for.
__getattr__, __dir__, __all__ = lazy_names_from_stub(__name__, __file__)
