# The course: `make book` builds it, `make test` proves it. Each does all its own set-up.
SHELL := bash
VENV := .venv
ifeq ($(OS),Windows_NT)
PYTHON ?= python
SCRIPTS := Scripts
EXE := .exe
else
PYTHON ?= python3
SCRIPTS := bin
endif
BIN := $(VENV)/$(SCRIPTS)
PIP := $(BIN)/python -m pip --disable-pip-version-check
export PIP_ROOT_USER_ACTION := ignore
ifdef PIP_INDEX_URL
export UV_DEFAULT_INDEX ?= $(PIP_INDEX_URL)
endif
# Some hundred processes are started: each would compile every module that it imports.
unexport PYTHONDONTWRITEBYTECODE
# Small dense products stall when two BLAS threads contend for two cores.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

# Real logs for trials, where they lie beside the checkout; without them such tests are skipped.
DATA := $(abspath ../shared/data)
ifneq ($(wildcard $(DATA)),)
export SLAMLAB_DATA ?= $(DATA)
endif

# nbval is slow to load, and only notebooks need it.
PYTEST := $(BIN)/python -m pytest -q -p no:nbval
# As an error a warning of numbers gone wrong tells its line; on stderr it would only differ.
# Three on two cores: while one waits for its kernel, two have work.
NBVAL := PYTHONWARNINGS=error::RuntimeWarning $(BIN)/python -m pytest -q -n 3 --dist loadfile --no-loadscope-reorder \
  --nbval --nbval-current-env --nbval-cell-timeout 300
PARTS := set-up lint-and-warm unit speed notebooks same steady pages-and-figures book-tests
# The long ones first, so that no core waits for them in the end.
NOTEBOOKS := notebooks/labs/*.ipynb notebooks/[12]*.ipynb notebooks/[!12]*.ipynb notebooks/solutions/*.ipynb \
  notebooks/exercises/*.ipynb
# Browser tests that need no built page.
FIGURES := $(addprefix tests/book/test_,widgets_browser.py simulator_browser.py jupyterlab.py drawings.py)

.DEFAULT_GOAL := help
.PHONY: help book paper pdf slides test lab set-up lint-and-warm lint unit unit-without-numba quick fuzz speed notebooks \
  same pages-and-figures pages figures book-tests seeds steady trials chromium exercises check-library check-oldest \
  check-newest same-newest check-tag \
  dist site lock vendor slim clean

help:  ## Show this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 15

$(BIN)/python$(EXE):
	$(PYTHON) -m venv $(VENV)

# One stamp a set of extras, renewed when the lock or the project file changes. uv needs a fifth of
# pip's time; where it cannot serve (a mirror that only pip was told of), pip does it, without
# compiling: most of it is never imported.
$(VENV)/.%-installed: pyproject.toml requirements.lock | $(BIN)/python$(EXE)
	@echo "== Installing ($* extras, pinned by requirements.lock)"
	@$(PIP) install --quiet --constraint requirements.lock uv && \
	  $(BIN)/uv pip install --quiet --python $(BIN)/python --constraint requirements.lock --editable '.[$*]' || \
	  $(PIP) install --quiet --no-compile --constraint requirements.lock --editable '.[$*]'
	@touch $@

book: $(VENV)/.book-installed  ## Build the book (runs what changed) and say where it is
	@$(BIN)/python tools/build_book.py

site: book  ## Make the folder for a static host, _build/site (BOOK_URL=https://example.org/slam/)
	@$(BIN)/python tools/site.py

pdf: $(VENV)/.pdf-installed chromium book  ## Print the book into one file, _build/slam.pdf
	$(BIN)/python tools/pdf.py

paper: $(VENV)/.pdf-installed chromium  ## Print the paper on the course, _build/paper.pdf
	@$(BIN)/python tools/paper.py

slides: book  ## Make slides of a lesson, _build/slides (CH=09; every lesson without CH)
	@$(BIN)/python tools/slides.py $(CH)

lab: $(VENV)/.lab-installed  ## Open the notebooks in JupyterLab
	$(BIN)/jupyter lab --notebook-dir=notebooks

test:  ## Run everything: lint, types, tests, notebooks, book, browser
	@table=""; for part in $(PARTS); do begin=$$SECONDS; \
	  $(MAKE) --no-print-directory $$part && verdict=passed || verdict=FAILED; \
	  table+=$$(printf '  %-18s %6d s  %s' $$part $$((SECONDS - begin)) $$verdict)$$'\n'; \
	  [ $$verdict = passed ] || break; \
	done; \
	printf '== Where the %d minutes went\n%s' $$(((SECONDS + 30) / 60)) "$$table"; \
	[ $$verdict = passed ] && echo "== All passed"

set-up:  ## Install everything a developer needs (and Chromium, where apt is there)
	@$(MAKE) --no-print-directory -j 2 chromium $(VENV)/.dev-installed

# Two workers that need a compiled function at the same time would both compile it.
lint-and-warm:
	@$(MAKE) --no-print-directory -j 3 lint warm-own warm-plain

warm-%: $(VENV)/.dev-installed
	@$(BIN)/python tools/notebooks.py warm --setting $* >/dev/null

lint: $(VENV)/.dev-installed  ## Lint, format check, types, spelling
	@echo "== Lint, types, spelling"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/codespell

# What is slower than some 20 s on plain code is skipped where numba is missing, and says so.
UNIT := -n 2 --dist worksteal --doctest-modules --ignore=tests/benchmarks --ignore=tests/book \
  --benchmark-disable slamlab tests

unit: $(VENV)/.dev-installed  ## Unit, property and derivation tests, docstring examples
	@echo "== Tests of the library"
	$(PYTEST) $(UNIT)

# numba comes later than a new Python, and to no browser.
unit-without-numba: $(VENV)/.dev-installed  ## The same where numba cannot be imported
	@echo "== Tests of the library on plain code"
	PYTHONPATH=$(CURDIR)/tests/without_numba $(PYTEST) $(UNIT)

quick: $(VENV)/.dev-installed  ## The tests of the library without the slow ones
	$(PYTEST) -n 2 --dist worksteal -m "not slow" --ignore=tests/benchmarks --ignore=tests/book \
	  --benchmark-disable tests

# make fuzz N=3 SEED=7: three times as many damaged files as in the unit tests, damaged in other
# ways, and every spoilt call.
fuzz: $(VENV)/.dev-installed  ## Damage files and spoil arguments, N times as often as the unit tests
	@$(BIN)/python tools/fuzz.py $(or $(N),2) $(or $(SEED),0)

speed: $(VENV)/.dev-installed  ## Ratios against peers, one at a time
	@echo "== Speed against peers"
	$(PYTEST) -p no:xdist tests/benchmarks

notebooks: $(VENV)/.dev-installed  ## Run every notebook and compare its outputs
	@echo "== Notebooks, cell by cell"
	$(NBVAL) $(NOTEBOOKS)

SETTING ?= plain
same: $(VENV)/.dev-installed  ## Run the book as on a machine without AVX (SETTING=haswell: AVX2), compare its numbers
	@echo "== The book under another setting: every number as in the notebooks"
	@$(BIN)/python tools/build_book.py --setting $(SETTING) --strict --no-pages

# One process reads all pages before others help to write them, and figures that play are waited for.
pages-and-figures:
	@$(MAKE) --no-print-directory -j 2 pages figures

pages: $(VENV)/.dev-installed
	@$(BIN)/python tools/build_book.py --setting plain --strict

figures: $(VENV)/.dev-installed  ## Figures, drawings and JupyterLab in Chromium, without the book
	@echo "== Figures, drawings and JupyterLab in a browser"
	$(PYTEST) -n 2 --dist loadfile $(FIGURES)

# Four on two cores: pages that load, settle or play are waited for.
book-tests: $(VENV)/.dev-installed  ## Open the built pages in Chromium
	@echo "== The built book in a browser"
	$(PYTEST) -n 4 --dist worksteal tests/book $(FIGURES:%=--ignore=%)

# make seeds CH=09 N=20: one chapter, twenty shifts.
seeds: $(VENV)/.dev-installed  ## Run the chapters with their seeds moved, N times: what turns, what varies
	@$(BIN)/python tools/seeds.py --shifts $(or $(N),5) $(CH)

# Three on two cores, as for the notebooks. Second pages: make seeds.
steady: $(VENV)/.dev-installed  ## One shift of the seeds: lessons and derivation tests must hold
	@echo "== Lessons with their seeds moved: nothing raises, no verdict turns"
	@$(BIN)/python tools/seeds.py --steady --jobs 3
	@echo "== Derivation tests with their seeds moved: wrong forms fail, right ones pass"
	$(PYTEST) -n 2 --dist worksteal -m "not slow" --seed-shift 1 tests/derivations

# make trials AGAIN=1: a sample, compared with what is stored; MISSING=1: what is not stored yet.
trials: $(VENV)/.dev-installed  ## Make every stored trial again, over all its seeds (many hours)
	@$(BIN)/python tools/trials.py $(if $(AGAIN),--again) $(if $(MISSING),--missing) $(TRIAL)

chromium:
	@if command -v chromium >/dev/null; then :; \
	elif command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then \
	  echo "== Installing Debian's chromium for the browser tests"; \
	  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium >/dev/null; \
	elif command -v apt-get >/dev/null && command -v sudo >/dev/null; then \
	  echo "== Installing Debian's chromium for the browser tests (sudo)"; \
	  sudo apt-get update -qq && sudo apt-get install -y -qq chromium >/dev/null; \
	else \
	  echo "chromium was not found and cannot be installed here: install it (or set SLAMLAB_CHROMIUM"; \
	  echo "to its path) to run the browser tests; they are skipped without it."; \
	fi

exercises: $(VENV)/.dev-installed  ## Write exercise and solution notebooks from their sources
	$(BIN)/python tools/exercises.py

# What a workflow runs on each system and each Python; browser, book and races are left to one.
check-library: $(VENV)/.dev-installed  ## The tests of the library on this Python, with the lock
	$(PYTEST) -n 2 --dist worksteal --ignore=tests/benchmarks --ignore=tests/book \
	  --benchmark-disable tests

# Tests that need no more than the library, pytest and hypothesis.
CORE := $(addprefix tests/,datasets golden localization mapping matching robots sensors slam worlds)

# check-oldest: the oldest versions that pyproject allows. check-newest: the newest that there are.
check-oldest: RESOLUTION := lowest-direct
check-newest: RESOLUTION := highest
check-oldest check-newest: check-%: pyproject.toml  ## The library with the oldest (newest) dependencies
	rm -rf _build/$*-env && $(PYTHON) -m venv _build/$*-env
	_build/$*-env/$(SCRIPTS)/python -m pip install --quiet uv
	_build/$*-env/$(SCRIPTS)/uv pip install --quiet --resolution $(RESOLUTION) \
	  --python _build/$*-env/$(SCRIPTS)/python '.[fast]'
	_build/$*-env/$(SCRIPTS)/uv pip install --quiet --python _build/$*-env/$(SCRIPTS)/python pytest hypothesis
	_build/$*-env/$(SCRIPTS)/python -m pytest -q -m "not slow" $(CORE)

same-newest: pyproject.toml  ## Every number of the notebooks, with the newest dependencies
	rm -rf _build/pages-env && $(PYTHON) -m venv _build/pages-env
	_build/pages-env/$(SCRIPTS)/python -m pip install --quiet '.[book,test]'
	PYTHONPATH=$(CURDIR) _build/pages-env/$(SCRIPTS)/python tools/notebooks.py check $(NOTEBOOKS)

lock: ## Refresh requirements.lock: install the newest set that fits, try it, write it down
	rm -rf _build/lock-env && $(PYTHON) -m venv _build/lock-env
	_build/lock-env/bin/python -m pip install --quiet --upgrade uv --editable '.[dev]'
	_build/lock-env/bin/python -m pip freeze --exclude-editable > requirements.lock
	@echo "requirements.lock is new: run make test before you commit it"

dist: $(VENV)/.dist-installed  ## Build wheel and source archive into dist/, and check them
	@echo "== Wheel and source archive"
	rm -rf dist build
	$(BIN)/python -m build --outdir dist .
	$(BIN)/twine check --strict dist/*
	$(BIN)/python tools/check_distribution.py dist

check-tag: $(BIN)/python$(EXE)  ## The release's tag (TAG=v1.0.0) names the version that is built
	$(BIN)/python tools/check_distribution.py --tag "$(TAG)"

vendor: $(VENV)/.dev-installed  ## Refresh the browser files under book/static/vendor (needs npm)
	$(BIN)/python tools/vendor.py

slim: $(VENV)/.dev-installed  ## Take images and widget views out of the notebooks
	$(BIN)/python tools/notebooks.py slim $(NOTEBOOKS)

clean:  ## Remove what was built (the environment stays)
	rm -rf _build .pytest_cache .ruff_cache .mypy_cache .hypothesis .benchmarks
