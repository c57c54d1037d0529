PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
INSTALLED_FORM := build/installed
ARGS ?=
# The index of the build of torch that is wanted; pip's own where it is empty (docs/installation.md).
TORCH_INDEX ?=
TORCH = $(if $(TORCH_INDEX),--index-url '$(TORCH_INDEX)') $(shell grep '^torch==' constraints.txt)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

# Official data and recorded behaviour beside the checkout are used unless the variables say otherwise.
ifneq ($(wildcard ../shared/lilgym),)
export LILGYM_DATA ?= $(abspath ../shared/lilgym)
endif
ifneq ($(wildcard ../shared/golden),)
export LILGYM_GOLDEN ?= $(abspath ../shared/golden)
endif

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install demo test test-long lint style types imports docs pictures test-matrix bench clean

help:  ## this list
	@echo "make TARGET [PYTHON=python3.11] [ARGS=...] [TORCH_INDEX=URL]"
	@sed -n 's/^\([a-z-]*\):[^#]*## /  \1\t/p' $(MAKEFILE_LIST) | expand -t 16

install: $(STAMP)  ## set up .venv with everything that developers need

# A .venv copied along from another checkout points back there: build it anew.
ifneq ($(shell grep -qs '$(CURDIR)/$(VENV)/' $(BIN)/pip && echo ours),ours)
.PHONY: $(STAMP)
endif

$(STAMP): pyproject.toml constraints.txt
	@rm -f $@
	@command -v $(PYTHON) >/dev/null || { echo "no '$(PYTHON)' here; name a Python 3.11 or newer: make $(MAKECMDGOALS) PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is $$($(PYTHON) --version 2>&1); lilgym_mp needs Python 3.11 or newer: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@{ grep -qs '$(CURDIR)/$(VENV)/' $(BIN)/pip && $(BIN)/python -m pip --version >/dev/null 2>&1; } || { rm -rf $(VENV); $(PYTHON) -m venv $(VENV); } || \
		{ echo "'$(PYTHON) -m venv' failed; some systems keep it in a package of its own (python3-venv)" >&2; exit 1; }
	@echo "installing into $(VENV): torch first, then the rest (the first time takes minutes)"
	@$(BIN)/python -m pip install --quiet $(TORCH)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: install  ## train an agent for a few minutes and evaluate it
	$(BIN)/lilgym-mp demo $(ARGS)

test: install  ## the tests, ruff and the import contract among them
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not long' $(ARGS)

test-long: install  ## the other tests: commands and documents run at length, the site built
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m long $(ARGS)

lint: style types imports  ## ruff, pyright and the import contract

style: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED_FORM)
	$(BIN)/pyright --pythonpath $(BIN)/python

imports: $(INSTALLED_FORM)
	cd $(INSTALLED_FORM) && '$(CURDIR)/$(BIN)/lint-imports' --config '$(CURDIR)/pyproject.toml' --no-cache

# The package laid out as installed, wrappers and data inside: what static tools need to see it whole.
.PHONY: $(INSTALLED_FORM)
$(INSTALLED_FORM): install
	@rm -rf $@
	@$(BIN)/python -c 'from setuptools import setup; setup()' --quiet build_py --build-lib $@

test-matrix: test-oldest test-newest  ## the tests with the oldest and the newest Gymnasium, NumPy and PettingZoo

.PHONY: test-oldest test-newest
test-oldest: MATRIX := constraints-oldest.txt
test-newest: MATRIX := constraints.txt
test-oldest test-newest: test-%:
	@rm -rf build/matrix/$*
	@$(PYTHON) -m venv build/matrix/$*
	@build/matrix/$*/bin/python -m pip install --quiet $(TORCH)
	@build/matrix/$*/bin/python -m pip install --quiet --constraint $(MATRIX) --editable '.[dev]'
	@build/matrix/$*/bin/python -m pip list 2>/dev/null | grep -i -E '^(gymnasium|numpy|pettingzoo|stable_baselines3|numba) '
	@build/matrix/$*/bin/python -m pytest -n 2 --dist worksteal $(ARGS)

docs: $(INSTALLED_FORM)  ## the documentation as a site, in build/site
	$(BIN)/python scripts/write_environment_pages.py
	NO_MKDOCS_2_WARNING=1 LILGYM_DOCS_PACKAGE=$(INSTALLED_FORM) $(BIN)/python -m mkdocs build --strict --quiet
	@echo "open build/site/index.html"

pictures: install  ## the films and drawings of README and docs
	$(BIN)/python scripts/draw_pictures.py $(ARGS)

bench: install  ## steps per second of every way to run the environments
	$(BIN)/lilgym-mp bench $(ARGS)

clean:  ## remove what tools left behind, but not .venv
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
