PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
INSTALLED_FORM := build/installed
ARGS ?=
# The package index to install torch from; pip's default if empty (docs/installation.md).
TORCH_INDEX ?=
TORCH = $(if $(TORCH_INDEX),--index-url '$(TORCH_INDEX)') $(shell grep '^torch==' constraints.txt)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1
# Test processes and the commands they start would otherwise compile every module anew.
unexport PYTHONDONTWRITEBYTECODE

# Use official data and recordings next to the checkout unless the variables are set.
ifneq ($(wildcard ../shared/lilgym),)
export LILGYM_DATA ?= $(abspath ../shared/lilgym)
endif
ifneq ($(wildcard ../shared/golden),)
export LILGYM_GOLDEN ?= $(abspath ../shared/golden)
endif

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install demo test test-long lint style types imports docs pictures test-matrix bench clean

help:  ## show this list
	@echo "make TARGET [PYTHON=python3.11] [ARGS=...] [TORCH_INDEX=URL]"
	@sed -n 's/^\([a-z-]*\):[^#]*## /  \1\t/p' $(MAKEFILE_LIST) | expand -t 16

install: $(STAMP)  ## create .venv with all development dependencies

# A .venv copied from another checkout points back to it: rebuild it.
ifneq ($(shell grep -qs '$(CURDIR)/$(VENV)/' $(BIN)/pip && echo ours),ours)
.PHONY: $(STAMP)
endif

$(STAMP): pyproject.toml constraints.txt
	@rm -f $@
	@command -v $(PYTHON) >/dev/null || { echo "'$(PYTHON)' not found; name a Python 3.11 or newer: make $(MAKECMDGOALS) PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is $$($(PYTHON) --version 2>&1); lilgym_mp needs Python 3.11 or newer: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@{ grep -qs '$(CURDIR)/$(VENV)/' $(BIN)/pip && $(BIN)/python -m pip --version >/dev/null 2>&1; } || { rm -rf $(VENV); $(PYTHON) -m venv $(VENV); } || \
		{ echo "'$(PYTHON) -m venv' failed; some systems package it separately (python3-venv)" >&2; exit 1; }
	@echo "installing into $(VENV), torch first (the first time takes minutes)"
	@$(BIN)/python -m pip install --quiet $(TORCH)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: install  ## train two agents in about four minutes and evaluate them
	@$(BIN)/python examples/demo.py $(ARGS)

test: install  ## run the tests, without the long ones and without lint
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not long' $(ARGS)

test-long: install  ## run the long tests: trainings, full-length commands, tutorials, the site
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m long $(ARGS)

lint: style types readme imports  ## run ruff, pyright, mypy on README's code, and the import contract

style: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED_FORM)
	$(BIN)/pyright --pythonpath $(BIN)/python

# README's Python code, as users of the installed package see it.
readme: $(INSTALLED_FORM)
	@sed -n '/^```python$$/,/^```$$/{/^```/d;p}' README.md > $(INSTALLED_FORM)/readme.py
	cd $(INSTALLED_FORM) && '$(CURDIR)/$(BIN)/pyright' --pythonpath '$(CURDIR)/$(BIN)/python' readme.py
	cd $(INSTALLED_FORM) && '$(CURDIR)/$(BIN)/mypy' --cache-dir=/dev/null --follow-imports=silent readme.py

imports: $(INSTALLED_FORM)
	cd $(INSTALLED_FORM) && '$(CURDIR)/$(BIN)/lint-imports' --config '$(CURDIR)/pyproject.toml' --no-cache

# The package in its installed layout, with wrappers and data inside, for static tools.
.PHONY: $(INSTALLED_FORM)
$(INSTALLED_FORM): install
	@rm -rf $@
	@$(BIN)/python -c 'from setuptools import setup; setup()' --quiet build_py --build-lib $@

test-matrix: test-oldest test-newest  ## test with the oldest and the newest Gymnasium, NumPy and PettingZoo

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

# The adapters of integrations/, each in an environment of its own with the library it adapts to.
INTEGRATIONS := balrog trl verifiers openenv reasoning_gym
.PHONY: test-integrations $(INTEGRATIONS:%=test-integration-%)
test-integrations: $(INTEGRATIONS:%=test-integration-%)  ## test the adapters to libraries for training language models
$(INTEGRATIONS:%=test-integration-%): test-integration-%:
	@$(PYTHON) -m venv build/integrations/$*
	@$(if $(filter trl,$*),build/integrations/$*/bin/python -m pip install --quiet $(TORCH))
	@build/integrations/$*/bin/python -m pip install --quiet --editable . -r integrations/$*/requirements.txt
	cd integrations/$* && PATH="$(CURDIR)/build/integrations/$*/bin:$$PATH" PYTHONPATH=. \
		python -m pytest -q -p no:cacheprovider -c /dev/null --rootdir .

docs: $(INSTALLED_FORM)  ## build the documentation site in build/site
	$(BIN)/python scripts/write_environment_pages.py
	NO_MKDOCS_2_WARNING=1 LILGYM_DOCS_PACKAGE=$(INSTALLED_FORM) $(BIN)/python -m mkdocs build --strict --quiet
	@echo "open build/site/index.html"

pictures: install  ## redraw the films and drawings of README and docs
	$(BIN)/python scripts/draw_pictures.py $(ARGS)

bench: install  ## measure steps per second of every kind of environment
	$(BIN)/lilgym-mp bench $(ARGS)

clean:  ## remove build and cache files, but not .venv
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
