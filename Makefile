PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

REALISATIONS ?= 100

.DEFAULT_GOAL := help
.PHONY: help demo paper docs test test-slow style bench clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(VENV)/installed  ## set up, and fit a simulated catalogue: report and figures in demo/
	$(BIN)/vsh-fit --demo --output demo

paper: $(VENV)/installed  ## every table and figure of the paper: paper/comparison.md (REALISATIONS=5 for a quick look)
	$(BIN)/vsh-study --paper --output paper --realisations $(REALISATIONS)

test: $(VENV)/installed-test  ## set up, and pass the tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pytest -m "not slow" -n auto

test-slow: $(VENV)/installed-test  ## the tests that take long
	$(BIN)/pytest -m slow

docs: $(VENV)/installed-docs  ## the documentation, with a gallery of examples run now: docs/_build/html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	$(BIN)/python docs/check_links.py docs/_build/html

style: $(VENV)/installed-test  ## put the code in its form
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(VENV)/installed-test  ## time this project beside others
	$(BIN)/python benchmarks/fits.py
	$(BIN)/python benchmarks/scaling.py

clean:  ## take away what was made here
	rm -rf $(VENV) demo paper docs/_build build *.egg-info .pytest_cache .ruff_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; name one: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(VENV)/bin/python setup.cfg pyproject.toml
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	@touch $@

$(VENV)/installed-test: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	@touch $@
