"""How quantities are written: one symbol for each, in figures and in LaTeX, and tables of them in LaTeX."""

import re

from vsh.io.sections import format_table
from vsh.sky.frames import title_of
from vsh.tools.printing import latex_text
from vsh.tools.types import Table

__all__ = ["latex_table", "symbol"]

#: Vectors, by what stands before their axis in the names of parameters and columns.
_VECTOR_SYMBOLS = {
    "epsilon": r"\epsilon", "orientation": r"\epsilon", "omega": r"\omega", "spin": r"\omega", "ω": r"\omega",
    "a": r"\tilde a", "acceleration": r"\tilde a", "g": r"\tilde a", "v": "v", "velocity": "v",
}  # fmt: skip
_SYMBOLS = {
    "H0": "$H_0$", "hubble": "$H_0$", "hubble_flows": "$H_0$, flows fitted", "speed": "$|v|$", "r0": "$R_0$",
    "peculiar_dispersion": r"$\sigma_{\rm pec}$", "excess_noise": r"$\sigma_{\rm excess}$", "theta": r"$\theta$",
    "plus": r"$\xi_+$", "minus": r"$\xi_-$", "n_pairs": "pairs", "low95": "95 %, from", "high95": "95 %, to",
    "z_low": r"$z_{\rm min}$", "z_high": r"$z_{\rm max}$", "z": "$z$", "chi2_dof": r"$\chi^2/{\rm dof}$",
    "chi2": r"$\chi^2$", "p_value": "$p$", "lon": "longitude", "lat": "latitude", "l": "$l$", "degree": "degree",
    "velocity_flows": "velocity, flows fitted", "acceleration_floor": "acceleration, with floor",
    "acceleration_law": "acceleration, published covariance", "limit_low": "limit, 16 %",
    "limit_median": "limit, median", "limit_high": "limit, 84 %", "lost": "share lost [%]",
}  # fmt: skip
#: The name of a coefficient: kind, degree, order, and real or imaginary part.
_MODE_NAME = re.compile(r"([tsf])\((\d+),(\d+)(?:,(re|im))?\)")
_VECTOR_NAME = re.compile(rf"(jump |\|)?({'|'.join(_VECTOR_SYMBOLS)})(?:_([xyz])|\|)( at (\S+))?")


def symbol(name: str) -> str:
    """The name of a parameter or a column as it is written in figures and LaTeX: ω_x, ã_x, H_0, t_20, s_21^R.

    Parameters
    ----------
    name : str
        As in tables and files: `omega_x`, `jump omega_x at 13`, `H0`, `t(2,1,re)`.

    Returns
    -------
    str
        With its mathematics between dollars, which matplotlib and LaTeX read alike; the name where it has no symbol.
    """
    if match := _MODE_NAME.fullmatch(name):
        kind, l, m, component = match.groups()
        subscript = f"{l}{m}" if len(l) == len(m) == 1 else f"{l},{m}"
        superscript = f"^{{\\rm {'R' if component == 're' else 'I'}}}" if component else ""
        return f"${kind}_{{{subscript}}}{superscript}$"
    if (match := _VECTOR_NAME.fullmatch(name)) and (match[1] == "|") == (match[3] is None):
        jump, letter, axis, _, place = match[1], _VECTOR_SYMBOLS[match[2]], match[3], match[4], match[5]
        if axis is None:
            return f"$|{letter}|$"
        return f"{'jump of ' if jump else ''}${letter}_{axis}${f' at {place}' if place else ''}"
    return _SYMBOLS.get(name, name)


#: Widths in characters: of a column, of what needs smaller letters, of a page, and of words that are broken.
_COLUMN_WIDTH, _SMALL_WIDTH, _PAGE_WIDTH, _WORDS = 42, 70, 82, 20
#: What is printed of a cell has no room of its own.
_INVISIBLE = re.compile(r"\\(rm|tilde|mu|times|pm|xi|chi|omega|epsilon|theta)\b|[${}^_\\,]")
#: Rows of a table that stays on one page.
_PAGE_ROWS = 45
_NUMBER = re.compile(r"([<>] )?([+-]?[\d.]+)(?:e([+-]?\d+))?( ± [\d.]+)?")


def make_label(words: str) -> str:
    """Make a label of LaTeX from words: letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", words.lower()).strip("-")[:40].strip("-")


def latex_table(table: Table, caption: str = "") -> str:
    """A table in LaTeX, with the rules of booktabs, which no page cuts.

    Parameters
    ----------
    table : Table
        Errors stand in the cells of their values; columns of correlations are left out.
    caption : str
        Above it; its first words make the label.

    Returns
    -------
    str
        What is wider than a page is turned, where that makes it narrower, or split; what is longer is a `longtable`.
    """
    shown_table = table[[table_label for table_label in table.colnames if not table_label.startswith("correlation_")]]
    heads, rows = format_table(shown_table, write_name=str, digits=3)
    heads = [_format_column_head(*head.partition(" [")) for head in heads]
    rows = [list(map(_format_latex_cell, row)) for row in rows]
    first_column, *other_columns = zip(heads, *rows, strict=True)
    transposed = list(first_column), list(map(list, other_columns))
    if len(heads) <= _PAGE_ROWS and len(_group_columns_by_page(*transposed)) < len(_group_columns_by_page(heads, rows)):
        heads, rows = transposed
    title = ": ".join(title_part for title_part in (caption, str(table.meta.get("summary", ""))) if title_part)
    if (frame := str(table.meta.get("frame", ""))) and f"{frame} axes" not in title.lower():
        title += f" ({title_of(frame)} axes)"
    groups = _group_columns_by_page(heads, rows)
    label_stem = make_label(caption or "table")
    tables = []
    for i, column_numbers in enumerate(groups):
        part_title = f", part {i + 1} of {len(groups)}" if len(groups) > 1 else ""
        table_label = f"tab:{label_stem}{f'-{i + 1}' if len(groups) > 1 else ''}"
        table_rows = [[heads[k] for k in column_numbers], *([row[k] for k in column_numbers] for row in rows)]
        tables.append(_format_table_environment(table_rows, f"{latex_text(title)}{part_title}", table_label))
    return "\n\n".join(tables)


def _group_columns_by_page(heads, rows):
    """Group columns by part of the table: the first in each, and as many others as are not wider than a page."""
    widths = [_measure_column_width([head, *(row[k] for row in rows)]) for k, head in enumerate(heads)]
    column_groups, group_width = [[0]], widths[0]
    for k in range(1, len(heads)):
        if group_width + widths[k] > _PAGE_WIDTH and len(column_groups[-1]) > 1:
            column_groups.append([0])
            group_width = widths[0]
        column_groups[-1].append(k)
        group_width += widths[k]
    return column_groups


def _measure_column_width(cells):
    """Count the characters of a column, with the space beside it; long words are broken."""
    longest = max(len(_INVISIBLE.sub("", cell)) for cell in cells)
    return longest + 3 if longest <= _WORDS else _WORDS + 4 if longest < 3 * _WORDS else 2 * _WORDS + 4


def _format_table_environment(rows, title, name):
    widths = [_measure_column_width(column) for column in zip(*rows, strict=True)]
    alignment = "".join(
        f"p{{{width / 2.6:.1f}em}}" if width > _WORDS + 3 else "l" if k == 0 else "c" for k, width in enumerate(widths)
    )
    head, *body = (" & ".join(row_cells) + r" \\" for row_cells in rows)
    if len(body) > _PAGE_ROWS:
        opening = [rf"\begin{{longtable}}{{{alignment}}}", rf"\caption{{{title}}}\label{{{name}}}\\", r"\toprule", head,
                 r"\midrule", r"\endfirsthead", r"\toprule", head, r"\midrule", r"\endhead"]  # fmt: skip
        return "\n".join([r"\begingroup\small", *opening, *body, r"\bottomrule", r"\end{longtable}", r"\endgroup"])
    environment = "table*" if sum(widths) > _COLUMN_WIDTH else "table"
    size_command = [r"\small"] if sum(widths) > _SMALL_WIDTH else []
    opening = [rf"\begin{{{environment}}}", rf"\caption{{{title}}}", rf"\label{{{name}}}", r"\centering", *size_command,
             rf"\begin{{tabular}}{{{alignment}}}", r"\toprule", head, r"\midrule"]  # fmt: skip
    return "\n".join([*opening, *body, r"\bottomrule", r"\end{tabular}", rf"\end{{{environment}}}"])


def _format_column_head(name, bracket="", unit=""):
    """Format the name of a quantity in LaTeX, with its unit."""
    return (_format_symbol(name) or latex_text(name.replace("_", " "))) + latex_text(bracket + unit)


def _format_symbol(name):
    """Format the symbol of a quantity, what stands between its dollars as it is; nothing where it has none."""
    quantity_symbol = symbol(name)
    pieces = (piece if k % 2 else latex_text(piece) for k, piece in enumerate(quantity_symbol.split("$")))
    return "$".join(pieces) if quantity_symbol != name else ""


def _format_latex_cell(text):
    """Format text that LaTeX prints as it is; numbers with its minus, ± and powers of ten."""
    match = _NUMBER.fullmatch(text)
    if match is None or (match[3] and match[4]):
        name, bracket, unit = text.partition(" [")
        return _format_symbol(name) + latex_text(bracket + unit) if _format_symbol(name) else latex_text(text)
    sign, value, exponent, error = match.groups(default="")
    power_of_ten = rf" \times 10^{{{int(exponent)}}}" if exponent else ""
    return f"${sign}{value}{power_of_ten}{error}$".replace("±", r"\pm")
