"""What the examples of the gallery are run with."""

import runpy
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

_EXAMPLES = Path(__file__).parents[1] / "examples"


def arguments_of(gallery, script):
    """Those that want a real catalogue get a simulated twin of one, whose errors are as wrong as the real one's."""
    wants = Path(script["src_file"]).name in ("real_catalogue.py", "robust_fits.py", "vlbi_backgrounds.py")
    return [_twin()] if wants else []


@cache
def _twin():
    path = Path(mkdtemp()) / "vlbi_twin.ecsv"
    runpy.run_path(str(_EXAMPLES / "make_vlbi_twin.py"))["twin"]().write(path)
    return str(path)
