# `make demo` and `make test` are all the set-up there is: they make .venv if need be.

PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test test-all lint bench clean

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

.venv/installed-dev: .venv/installed
	$(BIN)/python -m pip install --quiet --editable '.[dev]' torch==2.13.0
	touch $@

demo: .venv/installed  ## from nothing to verified crashes and pictures, in ./demo
	$(BIN)/regents attack -c sumo_nets/crossing/crossing.sumocfg --planner idm --count 10 --seed 0 -o demo
	@echo "pictures: demo/*/still.png"

test: .venv/installed-dev  ## everything but the slow tests
	$(BIN)/python -m pytest -n 2

test-all: .venv/installed-dev  ## everything
	$(BIN)/python -m pytest -m ''

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright
	$(BIN)/lint-imports

bench: .venv/installed-dev  ## speed, as ratios in one run
	$(BIN)/python -m pytest tests/benchmarks -o addopts='' --benchmark-only -s  # without the checks of shapes

clean:
	rm -rf .venv demo build dist
