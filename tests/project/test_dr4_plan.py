"""The plan of DR4's day: frozen, quoted with its hash, and the same commands as on the page."""

import hashlib
import re
import tomllib

from conftest import ROOT

import vsh

PLAN, PAGE = ROOT / "docs" / "dr4_plan.toml", ROOT / "docs" / "dr4.md"


def test_page_has_the_hash_and_the_commands_of_the_plan():
    page, plan = PAGE.read_text(encoding="utf-8"), tomllib.loads(PLAN.read_text(encoding="utf-8"))
    assert hashlib.sha256(PLAN.read_bytes()).hexdigest() in page
    assert plan["version"] == vsh.__version__
    commands = re.findall(r"(?m)^ {7}(vsh-.*)$", page)
    assert [each for each in commands if not each.startswith("vsh-sim")] == list(plan["commands"].values())
    assert "Has it run as frozen?" in page


def test_rules_of_the_plan_are_those_of_the_program():
    from fit.background._floor import _PRIOR_ODDS, list_shapes
    from fit.methods import _DEGREE
    from fit.results.quality import SEEN
    from vsh.vector import GAIA_EDR3

    plan = tomllib.loads(PLAN.read_text(encoding="utf-8"))
    assert f"p < {SEEN}" in plan["rules"]["detected"]
    assert f"degree {_DEGREE}" in plan["configuration"]["estimator"]
    assert list_shapes(5) == ("flat", "gaia", "steep")
    assert _PRIOR_ODDS == {"gaia": 3.0, "steep": 0.5}
    lon, lat = GAIA_EDR3.direction
    assert f"{GAIA_EDR3.amplitude:.2f} +- 0.35" in plan["rules"]["agrees_with_edr3"]
    assert f"({lon:.1f}, {lat:.1f})" in plan["rules"]["agrees_with_edr3"]
