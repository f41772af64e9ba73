"""A page: its panels in order, with styles and scripts, and leave to run nothing else; the sky as a widget."""

import base64
import hashlib
import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape, unescape
from importlib.resources import files
from importlib.util import find_spec
from string import Template
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vsh.basis import harmonics
from vsh.coefficients import Coefficients
from vsh.field import Field
from vsh.figures.plot import (
    CHANCE,
    LONGEST,
    SURE,
    allow_many_figures,
    close_figures,
    compute_smallest_chance,
    even_grid,
    make_png,
    plot_field,
)
from vsh.io.sections import Section
from vsh.io.tables import format_table
from vsh.sky.frames import ANGLES
from vsh.tools.errors import ParameterError
from vsh.tools.files import atomic_write
from vsh.tools.types import FloatArray, PathName
from vsh.vector import SEEN


class Panel(NamedTuple):
    """A part of a page.

    Attributes
    ----------
    html : str
        Nothing where there is nothing to show.
    scripts : tuple of str
        That it needs, by name.
    """

    html: str
    scripts: tuple[str, ...] = ()


def join_panels(text: str, *panels: Panel) -> Panel:
    """Panels under a heading; nothing if they are empty."""
    html = "\n".join(panel.html for panel in panels if panel.html)
    scripts = tuple(script for panel in panels for script in panel.scripts)
    return Panel(f"<h2>{escape(text)}</h2>\n{html}" if html else "", scripts)


def paragraph(text: str, kind: str = "") -> Panel:
    """A paragraph."""
    return Panel(f"<p{f' class={kind!r}' if kind else ''}>{escape(text)}</p>" if text else "")


def facts_panel(entries: Iterable[tuple[Any, Any]], kind: str = "") -> Panel:
    """Words with a label in front of each, broken where they are too long; those of the kind "answer" are large."""
    rows_html = "".join(
        f"<tr><th scope='row'>{escape(str(label))}</th><td class='broken'>{escape(str(text))}</td></tr>"
        for label, text in entries
    )
    return Panel(f"<div class='wide {kind}'><table><tbody>{rows_html}</tbody></table></div>" if rows_html else "")


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], *, sortable: bool = False, summary: str = "") -> Panel:
    """A table of text."""
    cell_template = "<th scope='col'>{}</th>"
    if sortable:
        cell_template = "<th scope='col' aria-sort='none'><button type='button'>{}</button></th>"
    head_html = "".join(cell_template.format(escape(title)) if title else "<td></td>" for title in titles)
    body_html = "".join(_format_html_row(row) for row in rows)
    table_tag = '<table class="sortable">' if sortable else "<table>"
    table_html = f"{table_tag}<thead><tr>{head_html}</tr></thead><tbody>{body_html}</tbody></table>"
    # What scrolls must be reached by keys, and so be named.
    html = f'<div class="wide" tabindex="0" role="group" aria-label="{escape(summary or "table")}">{table_html}</div>'
    if summary:
        html = f"<details><summary>{escape(summary)}</summary>{html}</details>"
    return Panel(html, ("tables",) if sortable else ())


def _format_html_row(row):
    """A row of a table, whose words may be broken and whose numbers may not."""
    label, *cells = map(str, row)
    class_attributes = (" class='broken'" if len(cell) > _MAX_NUMBER_LENGTH else "" for cell in cells)
    cells_html = "".join(f"<td{kind}>{escape(cell)}</td>" for kind, cell in zip(class_attributes, cells))
    return f"<tr><th scope='row'>{escape(label)}</th>{cells_html}</tr>"


#: Longer cells of a table are words.
_MAX_NUMBER_LENGTH = 32
#: Rows of a table that a page shows.
_MAX_ROWS = 200


def section_panel(part: Section) -> Panel:
    """A section of a result: its title, facts, table, remarks and notes."""
    rows_panel = footnote = Panel("")
    if (rows := part.shown) is not None:
        rows_panel = table(*format_table(rows[:_MAX_ROWS], part.forms), sortable=True)
        footnote = paragraph(
            f"The first {_MAX_ROWS} of {len(rows)} rows; the files have all." if len(rows) > _MAX_ROWS else "", "faint"
        )
    list_html = "".join(f"<li>{escape(str(entry))}</li>" for entry in dict.fromkeys(map(str, part.notes)))
    notes = Panel(f"<ul>{list_html}</ul>" if list_html else "")
    return join_panels(part.title, facts_panel(part.facts), rows_panel, footnote, *map(paragraph, part.remarks), notes)


def figure_panel(picture: bytes, caption: str) -> Panel:
    """A picture, a PNG, with its caption."""
    encoded_picture = base64.b64encode(picture).decode()
    escaped_caption = escape(caption)
    return Panel(
        f'<figure class="picture"><img alt="{escaped_caption}"'
        f' src="data:image/png;base64,{encoded_picture}"><figcaption>{escaped_caption}</figcaption></figure>'
    )


def panel_row(panels: Sequence[Panel]) -> Panel:
    """Figures beside each other where the page is wide enough."""
    panels_html = "".join(panel.html for panel in panels)
    return Panel(f'<div class="pictures">{panels_html}</div>' if panels_html else "")


def figure_row(named_axes: Mapping[str, Any], captions: Mapping[str, str]) -> Panel:
    """Figures as pictures beside each other, each under its caption, or its name."""
    return panel_row(
        [figure_panel(make_png(axes), captions.get(name, name.replace("_", " "))) for name, axes in named_axes.items()]
    )


def notes_panel(lines: Iterable[object]) -> Panel:
    """A list of notes."""
    list_html = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return join_panels("Notes", Panel(f"<ul>{list_html}</ul>" if list_html else ""))


def preformatted_panel(text: str, label: str = "report") -> Panel:
    """Text as a terminal shows it."""
    return Panel(f'<pre tabindex="0" role="group" aria-label="{escape(label)}">{escape(text)}</pre>' if text else "")


def provenance_panel(sources: Mapping[str, Any], command: Sequence[str] | None = None) -> Panel:
    """Show the provenance of a result, and the command that repeats it."""
    if not sources:
        return Panel("")
    entries = [
        (key.replace("_", " "), ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value)
        for key, value in sources.items()
        if value not in ([], {}, None)
    ]
    introduction = paragraph("To repeat the run:" if command else "")
    command_panel = preformatted_panel(shlex.join(command or ()), "command")
    return join_panels("Where this comes from", introduction, command_panel, facts_panel(entries))


def page(title: str, panels: Iterable[Panel], *, lead: str = "", source: str = "") -> str:
    """Assemble panels into one HTML file that needs no network.

    Parameters
    ----------
    title : str
        Title of the page.
    panels : iterable of Panel
        In order; empty ones are left out.
    lead : str
        Under the title.
    source : str
        What it is about, which stands first in the name of the browser's tab.

    Returns
    -------
    str
        A Content-Security-Policy in it allows its own style and scripts, by their hashes, and pictures within it.
    """
    shown_panels = [panel for panel in panels if panel.html]
    headings: dict[str, str] = {}

    def add_anchor(match: re.Match[str]) -> str:
        """A heading with its anchor, which is its own even where two have the same words."""
        anchor = re.sub(r"\W+", "-", unescape(match[1]).lower()).strip("-")
        anchor = f"{anchor}-{len(headings)}" if anchor in headings else anchor
        headings[anchor] = match[1]
        return f'<h2 id="{anchor}">{match[1]}</h2>'

    body = re.sub("<h2>(.*?)</h2>", add_anchor, "\n".join(panel.html for panel in shown_panels))
    links = "".join(f'<li><a href="#{anchor}">{text}</a></li>' for anchor, text in headings.items())
    script_names = list(dict.fromkeys(script for panel in shown_panels for script in panel.scripts))
    script_texts = [read_d3_script() if name == "d3" else _read_asset(f"{name}.js") for name in script_names]
    style = _read_asset("page.css")
    return Template(_read_asset("page.html")).substitute(
        title=escape(title),
        name=escape(f"{source}: {title}" if source else title),
        lead=f'<p class="lead">{escape(lead)}</p>' if lead else "",
        style=style,
        style_hash=_format_policy_hash(style),
        contents=f'<nav class="contents" aria-label="contents"><ul>{links}</ul></nav>' if len(headings) > 3 else "",
        body=body,
        scripts="\n".join(f"<script>{text}</script>" for text in script_texts),
        script_hashes=" ".join(map(_format_policy_hash, script_texts)) or "'none'",
    )


@lru_cache
def read_d3_script() -> str:
    """The script that projects the sky, d3 with its licences."""
    return f"/*\n{_read_asset('d3.LICENSES.txt').replace('*/', '')}*/\n{_read_asset('d3.min.js')}"


def write_page(path: PathName, text: str, *, overwrite: bool = False) -> None:
    """Write a page.

    Parameters
    ----------
    path : str or Path
        The file.
    text : str
        Text of `page`.
    overwrite : bool
        Whether a file that is there is replaced.
    """
    with atomic_write(path, overwrite) as temporary_path:
        temporary_path.write_text(text, encoding="utf-8")


def _format_policy_hash(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _read_asset(name):
    return files("vsh.figures.page").joinpath(name).read_text(encoding="utf-8")


#: Sources that are sent at most, with their names, those with the most significant residuals first.
MAX_SOURCES = 20_000
#: Between arrows. [deg]
STEP = 9.2
#: Degrees that the page can go through.
MAX_LMAX = 15
_KIND_COMBINATIONS = ("TS", "T", "S")


@dataclass(frozen=True)
class ShownSolution:
    """A solution on the interactive sky."""

    label: str
    field: Field
    coefficients: Coefficients
    covariance: FloatArray
    unit: str = "µas/yr"
    n_sources: int | None = None


def sky(*shown: ShownSolution) -> Panel:
    """Show one or two solutions on an interactive globe.

    Parameters
    ----------
    *shown : ShownSolution
        In one frame and unit; two are turned together.

    Raises
    ------
    ParameterError
        If there are not one or two, or their frames or units differ.
    """
    if len(shown) not in (1, 2):
        raise ParameterError(f"one or two solutions are shown side by side, not {len(shown)}")
    if len({solution.field.frame for solution in shown}) > 1 or len({solution.unit for solution in shown}) > 1:
        raise ParameterError("solutions side by side must have one frame and one unit")
    skies = [_collect_sky_data(solution) for solution in shown]
    sky_data = {
        "axes": ANGLES[shown[0].field.frame],
        "unit": shown[0].unit,
        "sure": SURE,
        "chance": CHANCE,
        "longest": LONGEST * STEP / 12.0,
        "grid": dict(zip(("lon", "lat"), (_encode_floats(np.degrees(item)) for item in even_grid(STEP)), strict=True)),
        "skies": skies,
    }
    top_degree = max(entry["lmax"] for entry in skies)
    figures_html = "".join(_format_sky_figure(i, solution, skies[i]["sent"]) for i, solution in enumerate(shown))
    mark_names = " and ".join(dict.fromkeys(mark["name"] for entry in skies for mark in entry["marks"]))
    # "<" would end the block wherever a name holds "</script>".
    json_text = json.dumps(sky_data, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    controls = Template(_read_asset("controls.html")).substitute(top=top_degree)
    inner_html = f'{controls}<div class="skies">{figures_html}</div>{_format_sky_help(mark_names)}'
    return Panel(
        f'<section class="sky" aria-label="interactive sky">{inner_html}</section>'
        f'<script type="application/json" id="sky-data">{json_text}</script>',
        ("d3", "sky"),
    )


def _format_sky_help(mark_names):
    stars = f" Stars with circles show where {mark_names} point{'' if ' and ' in mark_names else 's'}, with 68 % cones."
    return (
        '<p class="faint" id="sky-keys">Drag the sky or use the arrow keys to turn it, + and − to zoom, 0 to go back,'
        " and n and p to step through the sources. Tap a source, or a name in a table below, to see where it is."
        f" Noise alone colours {100 * CHANCE:.0f} % of the arrows; where the field is not detected all are grey."
        f"{stars if mark_names else ''}</p>"
    )


def _format_sky_figure(i, solution, sent):
    n = solution.n_sources or len(solution.field)
    caption = f"{sent} of {n} sources, those with the most significant residuals" if sent < n else f"all {n} sources"
    caption = f"{solution.label}: {caption}" if solution.label else caption
    return (
        f"<figure>{_draw_still_image(solution)}"
        f'<canvas tabindex="0" role="img" aria-label="{escape(solution.label)} sky with the fitted field as'
        f' arrows; the text below says what is shown" aria-describedby="said-{i} sky-keys"></canvas><figcaption><p'
        f' class="faint">{escape(caption)}</p><p class="said" id="said-{i}" role="status"'
        ' aria-live="polite"></p></figcaption></figure>'
    )


def _draw_still_image(solution):
    """The picture that stands there where no script runs."""
    with allow_many_figures():  # those of the page are open
        axes = plot_field(solution.field, solution.coefficients, covariance=solution.covariance, unit=solution.unit)
    data = base64.b64encode(make_png(axes, dpi=120)).decode()
    close_figures([axes])
    return f'<img class="still" alt="the sources, and the motions fitted to them" src="data:image/png;base64,{data}">'


def _collect_sky_data(solution):
    modes, field = solution.coefficients.modes, solution.field
    if np.shape(solution.covariance) != (len(modes), len(modes)):
        raise ParameterError(f"covariance has shape {np.shape(solution.covariance)}, the coefficients are {len(modes)}")
    residual = field.motion - solution.coefficients.at(field.lon, field.lat)
    chi2 = field.inner(residual, residual)
    shown_indices = np.argsort(-chi2, kind="stable")[:MAX_SOURCES]
    names = [] if field.name is None else [str(name) for name in field.name[shown_indices]]
    return {
        "label": solution.label,
        "lmax": min(modes.lmax, MAX_LMAX),
        "fitted": modes.lmax,
        "sent": int(shown_indices.size),
        "names": names,
        "seen": compute_smallest_chance(solution.coefficients, np.asarray(solution.covariance)) < SEEN,
        "sources": {
            "lon": _encode_floats(np.degrees(field.lon[shown_indices])),
            "lat": _encode_floats(np.degrees(field.lat[shown_indices])),
            "motion": _encode_floats(field.motion[:, shown_indices]),
            "error": _encode_floats(field.sigma[:, shown_indices]),
            "residual": _encode_floats(residual[:, shown_indices]),
            "sigmas": _encode_floats(np.sqrt(chi2[shown_indices])),
        },
        **_compute_grid_data(solution, *even_grid(STEP)),
        "marks": _list_direction_marks(solution),
    }


def _compute_grid_data(solution, lon, lat):
    """The field of each degree and kind on the grid, and the variance of every sum the page can show."""
    modes, covariance = solution.coefficients.modes, np.asarray(solution.covariance, float)
    basis = harmonics(lon, lat, modes)
    degrees, kinds = modes.degrees, np.array([mode.kind for mode in modes])
    lmax = min(modes.lmax, MAX_LMAX)
    fields, variances = [], []
    for l in range(1, lmax + 1):
        for kind in "TS":
            selection = (degrees == l) & (kinds == kind)
            fields.append(_encode_floats(np.tensordot(solution.coefficients.values[selection], basis[selection], 1)))
    for is_single in (False, True):
        for combination in _KIND_COMBINATIONS:
            for l in range(1, lmax + 1):
                selection = np.isin(kinds, list(combination)) & ((degrees == l) if is_single else (degrees <= l))
                east, north = np.moveaxis(basis[selection], 1, 0)
                covariance_block = covariance[np.ix_(selection, selection)]
                with_east = covariance_block @ east
                moments = np.sum([with_east * east, (covariance_block @ north) * north, with_east * north], axis=1)
                variances.append(_encode_floats(moments))
    return {"fields": fields, "variances": variances}


def _list_direction_marks(solution):
    names = ("acceleration", "spin") if solution.unit == "µas/yr" else ("glide", "rotation")
    marks: list[dict[str, Any]] = []
    for name, kind in zip(names, "ST", strict=True):
        vector = solution.coefficients.vector(kind, solution.covariance, solution.field.frame)
        if vector.p_value <= 0.05:  # else it points nowhere in particular
            marks.append({"name": name, "kind": kind, "at": vector.direction, "cone": vector.direction_cone()})
    return marks


def _encode_floats(values: Any) -> str:
    """Numbers in single precision, as text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def widget(*shown: ShownSolution, height: int = 720) -> Any:
    """Show one or two solutions on a sky that can be turned, as the last line of a notebook's cell.

    Parameters
    ----------
    *shown : ShownSolution
        As for `sky`.
    height : int
        That of the frame. [pixels]

    Returns
    -------
    ipywidgets.HTML, or an object that a notebook shows
        A widget, which can stand in a box with others, where ipywidgets is installed; the same without it otherwise.

    Raises
    ------
    ParameterError
        As `sky` does.
    """
    page_html = escape(page("", [sky(*shown)]), quote=True)
    html = f'<iframe srcdoc="{page_html}" style="width: 100%; height: {height}px; border: 0" title="sky"></iframe>'
    if find_spec("ipywidgets") is None:
        return SimpleNamespace(_repr_html_=lambda: html)  # which notebooks show
    import ipywidgets

    return ipywidgets.HTML(html)
