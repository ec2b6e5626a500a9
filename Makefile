# make demo   runs the main job on a simulated bench        make demo EXIT=1 ends there
# make test   runs the tests
# Both create .venv from requirements.lock first; that takes a minute once.
PYTHON ?= python3
VENV   := .venv
READY  := $(VENV)/.installed
BIN    := $(VENV)/bin
PYTEST_ARGS ?=

.PHONY: demo test lint install clean

install: $(READY)

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || { \
	  echo "error: $(PYTHON) is $$($(PYTHON) --version 2>&1); Python 3.11 to 3.13 is needed. Install one and name it: make PYTHON=python3.11 ..." >&2; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo "error: '$(PYTHON) -m venv' is not available. Install it (Debian, Ubuntu: apt-get install python3-venv) and run make again." >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing the pinned packages into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --no-index -e .
	@touch $(READY)

demo: $(READY)
	@$(BIN)/bench-service demo $(if $(EXIT),--exit)

test: $(READY)
	@$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: $(READY)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/basedpyright
	@$(BIN)/lint-imports

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .coverage build *.egg-info
