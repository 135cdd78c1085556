# make demo   set up, then the whole loop on simulated robots, one to two minutes: logs, fit, serve, plan, remove fragments, pages
# make test   set up, then the tests
# make check  what .ci/run runs: format, lint, types, import contracts, docs, tests
# make docs   set up, then the manual and the API reference as pages in build/site
# make bench  every benchmark, each printing its table
.DEFAULT_GOAL := help
.PHONY: help demo test check lint docs bench clean

# The first Python that runs and is new enough; override with `make PYTHON=/path/to/python demo`.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3 python; do \
  $$p -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' >/dev/null 2>&1 && { echo $$p; break; }; done)
VENV ?= .venv
BIN := $(VENV)/bin
# Two BLAS pools on few cores fight each other: tests and benchmarks are parallel by process instead.
# Tests wait for other processes a sixth of their time: with a worker more than cores no core does.
WORKERS := $(shell expr $$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2) + 1)
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
# Nothing is compiled at installation: without bytecode on disk every process that a test starts would compile all it
# imports anew, three seconds of it. Images of containers often forbid it.
unexport PYTHONDONTWRITEBYTECODE

help:
	@sed -n 's/^# make/make/p' Makefile

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "No Python 3.11 or newer found. Install one, or say make PYTHON=/path/to/python."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.all: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[all]'
	@touch $@

# What is imported is compiled then: pip would compile all of every package, 20 s on one core.
$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --no-compile --editable '.[dev]'
	@touch $@ $(VENV)/.all

demo: $(VENV)/.all
	$(BIN)/python examples/demo.py --output demo_output

test: $(VENV)/.dev
	$(ONE_THREAD) $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

check: $(VENV)/.dev
	$(MAKE) --jobs 2 lint docs
	$(MAKE) test

bench: $(VENV)/.dev
	@for script in bench/*.py; do echo "== $$script"; $(ONE_THREAD) $(BIN)/python $$script || exit 1; done

clean:
	rm -rf $(VENV) build demo_output bench/results
