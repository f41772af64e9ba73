"""Two catalogues of one sky: how one frame is turned, drifts and is deformed against the other."""

from fit.compare._compare import FrameComparison, compare

__all__ = [
    "FrameComparison",
    "compare",
]
