"""What Gaia's archive would hold of simulated sources, in its own columns."""

from sim.gaia._crf3 import CRF3_COUNTS, crf3
from sim.gaia._epochs import epochs

__all__ = [
    "crf3",
    "epochs",
]
