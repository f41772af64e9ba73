"""What Gaia's archive would hold of simulated sources, in its own columns."""

from sim.gaia._crf import crf3, crf4
from sim.gaia._epochs import epochs
from sim.gaia._link import link

__all__: list[str] = []
