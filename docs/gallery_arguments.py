"""What the examples of the gallery are run with."""

from pathlib import Path

_DEMO = Path(__file__).parents[1] / "fit" / "demo.fits"


def arguments_of(gallery, script):
    """Those that want a catalogue get the simulated one of the demo."""
    wants = Path(script["src_file"]).name in ("real_catalogue.py", "robust_fits.py", "vlbi_backgrounds.py")
    return [str(_DEMO)] if wants else []
