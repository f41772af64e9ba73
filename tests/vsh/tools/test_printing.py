"""What is printed: text that fits the terminal, and LaTeX."""

import re

from vsh.tools.printing import latex_text, wrap_lines

REPORT = """errors         robust fit, with errors from its residuals, to degree 5, systematic floor included (acceleration ± 0.22, spin ± 0.19)
  - a note that is much longer than the terminal is wide, and which is therefore broken below its own first word here
  p   one column   another column   a third column of a table that is wider than the terminal and stays as it is
short
a_name_without_a_blank_that_is_longer_than_the_terminal_is_wide_and_which_cannot_be_broken_anywhere_at_all"""


def test_reports_are_wrapped_between_words():
    wrapped = wrap_lines(REPORT, 60)
    errors, note, table, *others = re.split(r"\n(?=\S|  [p-])", wrapped)
    assert max(map(len, errors.splitlines())) <= 60
    assert all(re.match(r" {15}\S", line) for line in errors.splitlines()[1:])
    assert all(line.startswith("    ") for line in note.splitlines()[1:])
    assert len(table.splitlines()) == 1
    assert others == REPORT.splitlines()[3:]
    assert re.sub(r"\n {4,}", " ", wrapped) == REPORT
    assert wrap_lines(REPORT, 1000) == REPORT
    assert "±\n" not in wrap_lines(REPORT, 75)


def test_numbers_in_latex():
    assert (
        latex_text("δ = -28°, p = 1.7e-67, J1234-5678")
        == r"$\delta$ = $-$28$^\circ$, p = $1.7 \times 10^{-67}$, J1234-5678"
    )
