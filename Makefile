# make demo   runs the main job on a simulated bench        make demo EXIT=1 ends there
# make test   runs the tests                                make lint  checks format, types and import rules
# make proof  runs the long benchmarks whose results stand in docs/results.md; can be stopped, goes on where it was
# All create .venv from requirements.lock first; that takes a minute or two, once.

# The first of these that is Python 3.11 to 3.13; name another one with  make PYTHON=/path/to/python ...
PYTHON ?= $(firstword $(foreach name,python3 python3.13 python3.12 python3.11,$(shell \
  $(name) -c 'import sys; (3, 11) <= sys.version_info[:2] <= (3, 13) and print("$(name)")' 2>/dev/null)) python3)
VENV   := .venv
READY  := $(VENV)/.installed
BIN    := $(VENV)/bin
PYTEST_ARGS ?=
# Test processes side by side, two more than the two processors of CI: a part of the time they wait for devices,
# services and pages; with three it takes as long, with five a tenth longer. Each file stays in one of them. In the
# order of their names, because those of the browser and of whole campaigns are long: by itself xdist begins with the
# files that hold the most tests.
WORKERS ?= 4
# Hundreds of processes start in the tests: each would translate the project's files anew, 1.3 s a service.
unexport PYTHONDONTWRITEBYTECODE
PIP    := $(BIN)/python -m pip --quiet --disable-pip-version-check

.PHONY: install demo test proof lint clean

install: $(READY)

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null || { \
	  echo "error: $(PYTHON) is $$($(PYTHON) --version 2>/dev/null || echo missing); Python 3.11 to 3.13 is needed. Install one (Debian, Ubuntu: apt-get install python3 python3-venv) or name it: make PYTHON=/path/to/python3.11 ..." >&2; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo "error: '$(PYTHON) -m venv' does not work here. Install what it needs (Debian, Ubuntu: apt-get install python3-venv) and run make again." >&2; exit 2; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@echo "Installing the pinned packages into $(VENV) ..."
	@# What is imported is translated then: all of it takes a third of the time here.
	@$(PIP) install --no-compile --require-hashes --only-binary :all: -r requirements.lock
	@$(PIP) install --no-compile --no-deps --no-build-isolation --no-index -e .
	@touch $(READY)

demo: $(READY)
	@$(BIN)/bench-service demo $(if $(EXIT),--exit)

test: $(READY)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.compiled
	@$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

proof: $(READY)
	@$(BIN)/python benchmarks/proof.py

lint: $(READY)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/basedpyright
	@$(BIN)/lint-imports

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .import_linter_cache .hypothesis .coverage* build *.egg-info
