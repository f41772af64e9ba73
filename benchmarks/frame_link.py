"""Coverage of links of frames: simulated radio stars and quasars in Gaia and VLBI, with a known frame.

Usage: python benchmarks/frame_link.py [SKIES] [CASE ...]
"""

import sys
import time

import numpy as np

import sim
from fit.frames.link import LinkPrior, link
from vsh.vector import Vector

TRUTH = np.array([100.0, 200.0, -100.0, 20.0, -30.0, 50.0])
JUMP = np.array([30.0, 40.0, 0.0])
#: Options of the sky, and of the fit.
CASES = {
    "normal errors": ({"binaries": 0.0}, {}),
    "10 % binaries": ({}, {}),
    "10 % binaries, heavy tails": ({"tails": 3}, {}),
    "  not robust": ({"tails": 3}, {"robust": False}),
    "errors 1.5 times": ({"tails": 3, "wrong": 1.5}, {}),
    "30 % binaries, heavy tails": ({"tails": 3, "binaries": 0.3}, {}),
    "15 stars": ({"n": 15, "tails": 3}, {}),
    "single epochs": ({"tails": 3, "single": 1.0}, {}),
    "  no offset sought": ({"tails": 3, "single": 1.0}, {"excess": False}),
    "single epochs, offsets of 300 µas": ({"tails": 3, "single": 1.0, "star_offset": 300.0}, {}),
    "10 calibrators, off by 400 µas": ({"tails": 3, "calibrators": 10, "calibrator_error": 400.0}, {}),
    "half single epochs": ({"tails": 3, "single": 0.5}, {}),
    "jump at 13": ({"tails": 3, "jump": JUMP, "n": 80}, {"steps": [13.0]}),
    "quasars with offsets": ({"tails": 3, "n": 20, "quasars": 80, "offset": 300.0}, {}),
    "  not sought": ({"tails": 3, "n": 20, "quasars": 80, "offset": 300.0}, {"excess": False}),
    "prior of the spin": ({"tails": 3}, {"prior": 5.0}),
}


def one(seed, sky, options):
    """Values in errors, and the p-value of the jump."""
    options = dict(options)
    prior = options.pop("prior", None)
    rng = np.random.default_rng(seed)
    data = sim.link(rng, **{"orientation": TRUTH[:3], "spin": TRUTH[3:], "aberration": AT} | sky)
    if prior:
        known = TRUTH[3:] + prior * rng.standard_normal(3)
        options["priors"] = [LinkPrior("spin", known, prior**2 * np.eye(3))]
    solution = link(data, **options)
    truth = TRUTH
    if "steps" in options:
        truth = np.r_[TRUTH[:3], np.zeros(3), TRUTH[3:], sky["jump"]]
    return (solution.values - truth) / solution.sigma, solution.sigma


AT = Vector.from_spherical(5.05, 269.1, -31.6)

if __name__ == "__main__":
    skies = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(f"{'':34} 68 % of ε, ω    95 % of ε, ω   rms    median error  CPU s a sky   ({skies} skies)")
    for name, (sky, options) in CASES.items():
        if len(sys.argv) > 2 and not any(word in name for word in sys.argv[2:]):
            continue
        start = time.process_time()
        pulls, errors = map(np.array, zip(*(one(seed, sky, options) for seed in range(skies)), strict=True))
        took = (time.process_time() - start) / skies
        half = pulls.shape[1] // 2
        share = [np.mean(np.abs(part) < limit) for limit in (1, 1.96) for part in (pulls[:, :half], pulls[:, half:])]
        print(
            f"{name:34} {share[0]:.3f} {share[1]:.3f}   {share[2]:.3f} {share[3]:.3f}   {np.std(pulls):.2f}   "
            f"{np.median(errors[:, :half]):.1f} {np.median(errors[:, half:]):.2f}   {took:.2f}"
        )
