# `make demo` and `make test` are all the set-up there is: they make .venv if need be.

PYTHON ?= python3
BIN := .venv/bin

# Half of the files each, so that what a file compiles and sets up is made once.
TWO := -n 2 --dist worksteal

DEMO := -c sumo_nets/crossing/crossing.sumocfg --planner idm --count 10 --seed 0

CHROMIUM := $(shell command -v chromium || command -v google-chrome)

.PHONY: demo browser test test-all test-oldest lint docs bench bench-parts bench-gpu results wheel release-check clean

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	touch $@

.venv/installed-dev: .venv/installed
	$(BIN)/python -m pip install --quiet --editable '.[dev]' torch==2.13.0
	touch $@

.venv/installed-docs: .venv/installed
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

demo: .venv/installed  ## from nothing to verified crashes, pictures and a report, in ./demo
	$(BIN)/regents attack $(DEMO) -o demo
	$(BIN)/regents report demo -o demo/report.html
	@echo "The same windows by ReGentS of the paper, to compare:"
	$(BIN)/regents attack $(DEMO) --method regents -o demo-regents
	@echo "pictures: demo/*/still.png, and all of it in a browser: demo/report.html"

# The report is tested in a browser. Where none can be installed these tests are skipped, and say so.
browser:
ifeq ($(CHROMIUM),)
	-@[ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null && \
		{ apt-get update -qq && apt-get install -qq --yes chromium; } > /dev/null 2>&1 || \
		echo "no browser: tests of the report's page are skipped (apt-get install -y chromium)"
endif

test: .venv/installed-dev  ## everything but the slow tests
	$(BIN)/python -m pytest $(TWO)

test-all: .venv/installed-dev browser  ## everything
	$(BIN)/python -m pytest $(TWO) -m ''

test-oldest:  ## the tests with the lowest version of every package that is allowed, in an environment of its own
	$(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet $$(.ci/lowest)
	.venv-oldest/bin/python -m pip install --quiet --no-deps --editable .
	.venv-oldest/bin/python -m pytest $(TWO)

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright
	$(BIN)/lint-imports

docs: .venv/installed-docs  ## the documentation, in site/index.html; any broken link is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

results: .venv/installed-dev  ## measure what the documentation reports and write its tables: hours; QUICK=1: half an hour
	$(BIN)/python benchmarks/measured/measure.py $(if $(QUICK),--quick)

bench: .venv/installed-dev  ## what searches and suites cost, as one table, in a few minutes
	$(BIN)/python benchmarks/speed/table.py

bench-parts: .venv/installed-dev  ## iterations, drives, recording and replays by themselves, as ratios in one run
	$(BIN)/python -m pytest benchmarks/speed -o addopts='' --benchmark-only -s  # without the checks of shapes

bench-gpu: .venv/installed-dev  ## scenario-iterations per second over batch sizes, on the device that JAX finds
	$(BIN)/python benchmarks/speed/accelerator.py

wheel: .venv/installed-dev
	rm -rf dist
	$(BIN)/hatchling build -t wheel

release-check:  ## what would be released, in a clean environment outside the repository
	PYTHON=$(PYTHON) .ci/release-check

clean:
	rm -rf .venv .venv-oldest demo demo-regents build dist site
