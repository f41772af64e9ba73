"""Subjects of commits have the form that CONTRIBUTING gives."""

import pytest
from commit_subject import fault_of


@pytest.mark.parametrize(
    "subject", ["fit: Add a systematic floor to waves", "vsh/io: Read files of Gaia DR4", "Merge branch 'main'"]
)
def test_subject_of_the_form_passes(subject):
    assert fault_of(f"{subject}\n\nWhy, and figures.") == ""


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        ("A docstring says whose", "not of the form"),
        ("fit: add a floor", "not of the form"),
        ("fit: Add a floor; Mend the waves", "several topics"),
        (f"fit: Add {'x' * 70}", "has 79 characters. Shorten it to 72"),
    ],
)
def test_other_subjects_are_refused(subject, words):
    assert words in fault_of(subject)
