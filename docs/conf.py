"""The documentation: `make docs`."""

import logging
import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE)]

from sphinx_gallery.sorting import ExplicitOrder  # noqa: E402

import vsh  # noqa: E402 (found by the path above)
from vsh.tools.parallel import without_progress_bars  # noqa: E402
from vsh.tools.printing import PACKAGES  # noqa: E402

project = "vsh-astrometry"
author = "the vsh-astrometry developers"
version = release = vsh.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",
    "numpydoc",
    "sphinxarg.ext",
    "sphinx_gallery.gen_gallery",
    "reference",
    "samples",
    "accessible",
]
exclude_patterns = ["_build", "_examples", "tutorials", "images", "style"]
# Options are copied from these pages: two hyphens stay two hyphens.
smartquotes = False
default_role = "py:obj"
html_theme = "furo"
html_title = "vsh-astrometry"
html_show_copyright = False
html_static_path = ["style"]
html_css_files = ["pages.css"]
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
suppress_warnings = ["config.cache", "myst.header"]

# Others' inventories are fetched where the pages are hosted; the build on a machine without a network has none.
intersphinx_mapping = (
    {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "scipy": ("https://docs.scipy.org/doc/scipy", None),
        "astropy": ("https://docs.astropy.org/en/stable", None),
        "arviz": ("https://python.arviz.org/en/stable", None),
        "healpy": ("https://healpy.readthedocs.io/en/stable", None),
        "matplotlib": ("https://matplotlib.org/stable", None),
    }
    if os.environ.get("READTHEDOCS")
    else {}
)

# Every object has a docstring, and no argument is documented that is not there.
numpydoc_validation_checks = {"GL08", "PR02"}
# A class documents its attributes, which are what it is made with.
numpydoc_validation_exclude = {r"\.[A-Z]\w*$", r"\.__\w+__$", r"\.(index|count)$"}
# Types of arguments and results are links where they are classes of the project.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # words that are no classes stay words
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# A page shows what a class can do, wherever it has it from.
autodoc_default_options = {"inherited-members": "tuple,BaseException,Protocol"}

# No page shows a progress bar, wherever it is built, and the build does not tell every step.
without_progress_bars().__enter__()
for name in PACKAGES:
    logging.getLogger(name).setLevel("WARNING")

# The gallery runs in a copy, by subject: the examples write their figures where they stand.
EXAMPLES = HERE / "_examples"
SECTIONS = {
    "first_steps": ("First steps", "first_fit real_catalogue harmonics simulated_sky"),
    "estimators": (
        "Estimators and systematic errors",
        "robust_fits shared_errors correlation_matrices vlbi_backgrounds",
    ),
    "frames": ("Reference frames", "compare_catalogues parallax_zero_point"),
    "galaxies": (
        "Galaxies: velocity and the Hubble constant",
        "redshift_dipoles velocity_or_hubble velocity_forecast growth_from_motions",
    ),
    "waves": ("Gravitational waves", "pairs_and_waves pulsars_and_motions skies_in_place_of_a_likelihood"),
    "joint": ("Joint solutions of sources and attitude", "joint_solution calibrated_basic_angle"),
}
shutil.rmtree(EXAMPLES, ignore_errors=True)
shutil.copytree(ROOT / "examples", EXAMPLES, ignore=shutil.ignore_patterns("*.py", "*.png", "__pycache__"))
ABOUT = "Every example runs when these pages are built; each is a script of its own in ``examples/``.\n"
(EXAMPLES / "GALLERY_HEADER.rst").write_text(f"Gallery\n=======\n\n{ABOUT}", encoding="utf-8")
for folder, (title, scripts) in SECTIONS.items():
    section = EXAMPLES / folder
    section.mkdir()
    (section / "GALLERY_HEADER.rst").write_text(f"{title}\n{'-' * len(title)}\n", encoding="utf-8")
    for script in scripts.split():
        shutil.copy(ROOT / "examples" / f"{script}.py", section)


class InOrder:
    """Examples of a section as they are listed above, tutorials by their file names."""

    def __init__(self, folder):
        self.names = [name for _, scripts in SECTIONS.values() for name in scripts.split()]

    def __call__(self, name):
        name = name.removesuffix(".py")
        return (self.names.index(name), name) if name in self.names else (0, name)

    def __repr__(self):
        return "InOrder"


sphinx_gallery_conf = {
    "examples_dirs": ["_examples", "tutorials"],
    "gallery_dirs": ["gallery", "learn"],
    # Axes are seen in the figure they are on.
    "ignore_repr_types": r"matplotlib|vsh\.plot|numpy|builtins|class '(int|list|tuple|dict)",
    "filename_pattern": r"\.py$",
    "reset_argv": "gallery_arguments.arguments_of",
    "subsection_order": ExplicitOrder([f"_examples/{folder}" for folder in SECTIONS]),
    "within_subsection_order": InOrder,
    # A page of the reference names the examples that use it.
    "backreferences_dir": "gallery/uses",
    "doc_module": ("vsh", "sim", "fit", "study"),
    "abort_on_example_error": True,
    "download_all_examples": True,  # notebooks of all tutorials, in one archive
    "show_memory": False,
    "plot_gallery": True,
    "remove_config_comments": True,
}
# Where the repository is public, `owner/name` there opens every example in Binder (.binder/ has what it installs).
if repository := os.environ.get("BINDER_REPOSITORY"):
    owner, name = repository.split("/")
    sphinx_gallery_conf["binder"] = {
        "org": owner, "repo": name, "branch": os.environ.get("BINDER_BRANCH", "main"), "use_jupyter_lab": True,
        "binderhub_url": "https://mybinder.org", "dependencies": str(ROOT / ".binder" / "requirements.txt"),
    }  # fmt: skip
