"""The sky that turns, in a notebook."""

from collections.abc import Callable
from html import escape
from importlib.util import find_spec
from typing import Any

from vsh.figures.page._page import STATIC, Shown, figure, page, sky


class Framed:
    """A page of its own within a notebook's: it asks for nothing from any network, and its styles stay inside."""

    def __init__(self, html: str) -> None:
        self.html = html

    def _repr_html_(self) -> str:
        return self.html


def widget(*shown: Shown, height: int = 720, static: Callable[[], bytes] | None = None) -> Any:
    """One or two solutions on a sky that can be turned, for the last line of a notebook's cell.

    Parameters
    ----------
    *shown : Shown
        As for `sky`.
    height : int
        That of the frame. [pixels]
    static : callable, optional
        Makes a PNG that is shown where the package was built without the script of the sky.

    Returns
    -------
    ipywidgets.HTML, or an object that a notebook shows
        A widget, which can stand in a box with others, where ipywidgets is installed; the same without it otherwise.

    Raises
    ------
    ParameterError
        As `sky` does.
    """
    turned = sky(*shown)
    if turned.html:
        inner = escape(page("", [turned]), quote=True)
        html = f'<iframe srcdoc="{inner}" style="width: 100%; height: {height}px; border: 0" title="sky"></iframe>'
    else:
        html = figure(static(), f"The sky {STATIC}").html if static else f"<p>The sky {escape(STATIC)}.</p>"
    if find_spec("ipywidgets") is None:
        return Framed(html)
    import ipywidgets

    return ipywidgets.HTML(html)
