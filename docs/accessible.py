"""What a screen reader or a keyboard misses in the theme's pages is put in when they are written."""

import re
from pathlib import Path

#: From what the theme and docutils write to what WCAG 2.2 asks for (axe's rules behind each).
CHANGES = (
    (r'#fit\.ScalarSolution"', '#fit.results.solution.ScalarSolution"'),  # its file has names of `fit`, too
    (r'<p class="caption" role="heading">', '<p class="caption" role="heading" aria-level="2">'),  # aria-required-attr
    (r'<aside class="sidebar-drawer">', '<aside class="sidebar-drawer" aria-label="All pages">'),  # landmark-unique
    (r'<aside class="toc-drawer( no-toc)?">', r'<aside class="toc-drawer\1" aria-label="On this page">'),
    (r'<div class="content-icon-container">', '<div class="content-icon-container" role="navigation" aria-label="Tools">'),
    (r"<pre>", '<pre tabindex="0">'),  # scrollable-region-focusable
    (r'<div class="table-wrapper([^"]*)">', r'<div class="table-wrapper\1" tabindex="0" role="group" aria-label="table">'),
    (r'<div class="output_subarea output_html rendered_html output_result">',
     '<div class="output_subarea output_html rendered_html output_result" tabindex="0" role="group" aria-label="result">'),
    (r'<th class="head">(?:<p></p>)?</th>', '<td class="head"></td>'),  # empty-table-header
    (r'<a class="reference internal" href="([^"]+)"><span class="doc">([^<]+)</span></a>',  # link-name
     r'<a class="reference internal" href="\1" aria-label="\2"><span class="doc">\2</span></a>'),
)  # fmt: skip


def finish(app, error):
    """Change every page that was written."""
    if error is not None or app.builder.name != "html":
        return
    for path in Path(app.outdir).rglob("*.html"):
        text = changed = path.read_text(encoding="utf-8")
        for old, new in CHANGES:
            changed = re.sub(old, new, changed)
        if changed != text:
            path.write_text(changed, encoding="utf-8")


def setup(app):
    """After all pages are there."""
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True}
