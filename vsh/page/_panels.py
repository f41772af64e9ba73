"""What a page is made of."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from vsh.checks.types import Table
from vsh.plot import picture_of


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


def heading(text: str, *panels: Panel) -> Panel:
    """Panels under a heading; nothing if they are empty."""
    html = "\n".join(panel.html for panel in panels if panel.html)
    scripts = tuple(script for panel in panels for script in panel.scripts)
    return Panel(f"<h2>{escape(text)}</h2>\n{html}" if html else "", scripts)


def words(text: str, kind: str = "") -> Panel:
    """A paragraph."""
    return Panel(f"<p{f' class={kind!r}' if kind else ''}>{escape(text)}</p>" if text else "")


def cards(items: Iterable[tuple[str, str, str]]) -> Panel:
    """The main results, large."""
    inner = "".join(
        f'<div class="card">{escape(name)}<b>{escape(value)}</b><span class="faint">{escape(more)}</span></div>'
        for name, value, more in items
    )
    return Panel(f'<div class="cards">{inner}</div>' if inner else "")


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, sortable: bool = False, summary: str = "") -> Panel:
    """A table of text.

    Parameters
    ----------
    heads : sequence of str
        Of the columns, plain.
    rows : iterable of sequences of str
        Plain.
    sortable : bool
        By a click on a heading, or Enter.
    summary : str
        Under which it is folded away, if any.
    """
    cell = "<th scope='col' aria-sort='none'><button type='button'>{}</button></th>" if sortable else "<th scope='col'>{}</th>"  # fmt: skip
    head = "".join(cell.format(escape(each)) if each else "<td></td>" for each in heads)
    body = "".join(_row(row) for row in rows)
    opened = '<table class="sortable">' if sortable else "<table>"
    inner = f"{opened}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    # What scrolls must be reached by keys, and so be named.
    html = f'<div class="wide" tabindex="0" role="group" aria-label="{escape(summary or "table")}">{inner}</div>'
    if summary:
        html = f"<details><summary>{escape(summary)}</summary>{html}</details>"
    return Panel(html, ("tables",) if sortable else ())


def _row(row):
    first, *rest = map(str, row)
    return f"<tr><th scope='row'>{escape(first)}</th>" + "".join(f"<td>{escape(each)}</td>" for each in rest) + "</tr>"


def sheet(title: str, columns: Table, *, most: int = 200) -> Panel:
    """An astropy Table under a heading, sortable."""
    rows = zip(*(columns[name][:most].tolist() for name in columns.colnames), strict=True)
    heads = [name.replace("_", " ") for name in columns.colnames]
    more = f"The first {most} of {len(columns)} rows; the files have all." if len(columns) > most else ""
    return heading(
        title, table(heads, ([cell(each) for each in row] for row in rows), sortable=True), words(more, "faint")
    )


def cell(value: Any) -> str:
    """A value of a table as text: numbers to five digits."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{value:.5g}"
    return "" if value is None else str(value)


def figure(picture: bytes, caption: str) -> Panel:
    """A picture with its caption.

    Parameters
    ----------
    picture : bytes
        PNG, of `vsh.plot.picture_of`.
    caption : str
        Said to those who cannot see it, too.
    """
    data = base64.b64encode(picture).decode()
    said = escape(caption)
    return Panel(f'<figure class="picture"><img alt="{said}" src="data:image/png;base64,{data}"><figcaption>{said}</figcaption></figure>')  # fmt: skip


def pictures(figures: Sequence[Panel]) -> Panel:
    """Figures beside each other where the page is wide enough."""
    inner = "".join(panel.html for panel in figures)
    return Panel(f'<div class="pictures">{inner}</div>' if inner else "")


def figures(drawn: Mapping[str, Any], captions: Mapping[str, str]) -> Panel:
    """Figures as pictures beside each other, each under its caption, or its name."""
    return pictures(
        [figure(picture_of(each), captions.get(name, name.replace("_", " "))) for name, each in drawn.items()]
    )


def notes(lines: Iterable[object]) -> Panel:
    """A list of notes."""
    inner = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return heading("Notes", Panel(f"<ul>{inner}</ul>" if inner else ""))


def preformatted(text: str, label: str = "report") -> Panel:
    """Text as a terminal shows it."""
    return Panel(f'<pre tabindex="0" role="group" aria-label="{escape(label)}">{escape(text)}</pre>' if text else "")


def provenance(facts: Mapping[str, Any], command: Sequence[str] | None = None) -> Panel:
    """Where a result comes from, and the command that repeats it."""
    if not facts:
        return Panel("")
    rows = []
    for key, value in facts.items():
        if value in ([], {}, None):
            continue
        inner = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)
        rows.append(
            f"<tr><th scope='row'>{escape(key.replace('_', ' '))}</th><td class='broken'>{escape(inner)}</td></tr>"
        )
    again = [words("To repeat the run:"), preformatted(shlex.join(command), "command")] if command else []
    return heading("Where this comes from", *again, Panel(f"<div class='wide'><table><tbody>{''.join(rows)}</tbody></table></div>"))  # fmt: skip
