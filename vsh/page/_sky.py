"""The interactive sky: what its script is given."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from vsh.basis import harmonics
from vsh.checks.types import FloatArray
from vsh.coefficients import Coefficients
from vsh.errors import ParameterError
from vsh.field import Field
from vsh.page._page import bundle
from vsh.page._panels import Panel
from vsh.plot import LONGEST, SURE, even_grid
from vsh.sky.frames import ANGLES

#: Sources that are sent at most, those with the most significant residuals first; of so many also their names.
MAX_SOURCES, MAX_NAMES = 20_000, 5_000
#: Between arrows. [deg]
STEP = 9.2
#: Degrees that the page can go through.
MAX_LMAX = 15
_KINDS = ("TS", "T", "S")


@dataclass(frozen=True)
class Shown:
    """A solution on the interactive sky.

    Attributes
    ----------
    label : str
        Under its map; none is needed where it is alone.
    field : Field
        The sources.
    coefficients : Coefficients
        What was fitted to them.
    covariance : (p, p) array
        Of the coefficients.
    unit : str
        Of the motions.
    n_sources : int, optional
        Of which `field` holds some; all of them unless given.
    """

    label: str
    field: Field
    coefficients: Coefficients
    covariance: FloatArray
    unit: str = "µas/yr"
    n_sources: int | None = None


def sky(*shown: Shown) -> Panel:
    """One or two solutions on a sky that can be turned; nothing where the package was built without d3.

    Parameters
    ----------
    *shown : Shown
        In one frame and unit; two are turned together.

    Raises
    ------
    ParameterError
        If there are not one or two, or their frames or units differ.
    """
    if not bundle():
        return Panel("")
    if len(shown) not in (1, 2):
        raise ParameterError(f"one or two solutions are shown side by side, not {len(shown)}")
    if len({each.field.frame for each in shown}) > 1 or len({each.unit for each in shown}) > 1:
        raise ParameterError("solutions side by side must have one frame and one unit")
    sent = [_sky(each) for each in shown]
    data = {
        "axes": ANGLES[shown[0].field.frame], "unit": shown[0].unit, "sure": SURE, "longest": LONGEST * STEP / 12.0,
        "grid": dict(zip(("lon", "lat"), (_floats(np.degrees(each)) for each in even_grid(STEP)), strict=True)),
        "skies": sent,
    }  # fmt: skip
    top = max(each["lmax"] for each in sent)
    figures = "".join(_figure(i, each, sent[i]["sent"]) for i, each in enumerate(shown))
    # "<" would end the block wherever a name holds "</script>".
    blob = json.dumps(data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return Panel(
        f'<section class="sky" aria-label="interactive sky">{_controls(top)}<div class="skies">{figures}</div>{_KEYS}'
        f'</section><script type="application/json" id="sky-data">{blob}</script>',
        ("d3", "sky"),
    )


def _controls(top):
    return f"""
<div class="controls">
<label for="degree"><span>highest degree: <output id="degree-text" for="degree">{top}</output></span>
<input type="range" id="degree" min="1" max="{top}" value="{top}" step="1"></label>
<label for="kinds">part <select id="kinds"><option value="TS">T and S</option><option value="T">T, turning</option>
<option value="S">S, flowing</option></select></label>
<label class="row" for="only"><input type="checkbox" id="only"> this degree alone</label>
<label for="projection">projection <select id="projection"><option value="hammer">Hammer</option>
<option value="mollweide">Mollweide</option><option value="globe">globe</option><option value="polar">half, equal areas</option></select></label>
<span class="row"><button id="farther" type="button" aria-label="zoom out">−</button>
<button id="closer" type="button" aria-label="zoom in">+</button>
<button id="home" type="button">reset</button></span>
</div>"""


_KEYS = f"""<p class="faint" id="sky-keys">Drag or arrow keys turn it, + and − zoom, 0 goes back, n and p step through the
sources. Coloured arrows stand above {SURE:.0f} σ, grey ones below; stars with circles: where acceleration and spin point, with 68 % cones.</p>"""


def _figure(i, shown, sent):
    n = shown.n_sources or len(shown.field)
    said = f"{sent} of {n} sources, those with the most significant residuals" if sent < n else f"all {n} sources"
    said = f"{shown.label}: {said}" if shown.label else said
    return (
        f'<figure><canvas tabindex="0" role="img" aria-label="{escape(shown.label)} sky with the fitted field as arrows; the text '
        f'below says what is shown" aria-describedby="said-{i} sky-keys"></canvas>'
        f'<figcaption><p class="faint">{escape(said)}</p><p class="said" id="said-{i}" role="status" aria-live="polite"></p></figcaption></figure>'
    )


def _sky(shown):
    modes, field = shown.coefficients.modes, shown.field
    if np.shape(shown.covariance) != (len(modes), len(modes)):
        raise ParameterError(f"covariance has shape {np.shape(shown.covariance)}, the coefficients are {len(modes)}")
    residual = field.motion - shown.coefficients.at(field.lon, field.lat)
    sure = field.inner(residual, residual)
    order = np.argsort(-sure, kind="stable")[:MAX_SOURCES]
    names = [] if field.name is None else [str(name) for name in field.name[order[:MAX_NAMES]]]
    return {
        "label": shown.label, "lmax": min(modes.lmax, MAX_LMAX), "fitted": modes.lmax, "sent": int(order.size), "names": names,
        "sources": {
            "lon": _floats(np.degrees(field.lon[order])), "lat": _floats(np.degrees(field.lat[order])),
            "motion": _floats(field.motion[:, order]), "error": _floats(field.sigma[:, order]),
            "residual": _floats(residual[:, order]), "sigmas": _floats(np.sqrt(sure[order])),
        },
        **_fields(shown, *even_grid(STEP)), "marks": _marks(shown),
    }  # fmt: skip


def _fields(shown, lon, lat):
    """The field of each degree and kind on the grid, and the variance of every sum the page can show."""
    modes, covariance = shown.coefficients.modes, np.asarray(shown.covariance, float)
    basis = harmonics(lon, lat, modes)
    degrees, kinds = modes.degrees, np.array([mode.kind for mode in modes])
    lmax = min(modes.lmax, MAX_LMAX)
    fields, variances = [], []
    for l in range(1, lmax + 1):
        for kind in "TS":
            own = (degrees == l) & (kinds == kind)
            fields.append(_floats(np.tensordot(shown.coefficients.values[own], basis[own], 1)))
    for alone in (False, True):
        for wanted in _KINDS:
            for l in range(1, lmax + 1):
                own = np.isin(kinds, list(wanted)) & ((degrees == l) if alone else (degrees <= l))
                east, north = np.moveaxis(basis[own], 1, 0)
                part = covariance[np.ix_(own, own)]
                with_east = part @ east
                parts = [np.sum(with_east * east, 0), np.sum((part @ north) * north, 0), np.sum(with_east * north, 0)]
                variances.append(_floats(parts))
    return {"fields": fields, "variances": variances}


def _marks(shown):
    names = ("acceleration", "spin") if shown.unit == "µas/yr" else ("glide", "rotation")
    marks: list[dict[str, Any]] = []
    for name, kind in zip(names, "ST", strict=True):
        vector = shown.coefficients.vector(kind, shown.covariance, shown.field.frame)
        if vector.p_value <= 0.05:  # else it points nowhere in particular
            marks.append({"name": name, "kind": kind, "at": vector.direction, "cone": vector.direction_cone()})
    return marks


def _floats(values: Any) -> str:
    """Numbers in single precision, as text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()
