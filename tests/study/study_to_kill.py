"""A small study; `python study_to_kill.py FOLDER` runs it, or goes on with it."""

import sys

import study

SMALL = {
    "study": {"name": "small", "n_realisations": 12, "lmax": 2},
    "mission": {"years": 3.0, "release": "DR5"},
    "truth": {"acceleration": [4.3, 0, 0], "spin": [1, 0, -1], "orientation": [50, 0, 0], "velocity": [369, 264, 48]},
    "case": [
        {
            "name": "A",
            "quasars": {"number": 1000},
            "vlbi": {"number": 200, "radio": 50.0},
            "galaxies": {"number": 500, "peculiar_dispersion": 300.0},
        },
        {"name": "D", "quasars": {"number": 1000, "sky": "igql", "variability": 100.0}},
    ],
}

if __name__ == "__main__":
    study.run(study.load(SMALL), sys.argv[1], workers=2, progress=False)
