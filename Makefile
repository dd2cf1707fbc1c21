# `make demo` and `make test` do all the set-up themselves, in .venv, without root: demo what running needs,
# test the tests' extras, too.
OUT ?= runs/demo
DATA ?= $(CAMVID_DIR)
TWIN ?= far
TWIN_SEED ?= 0
PYTHON ?=
ARGS ?=
JOBS ?= 2
TIMES ?= 20

# Commands run from the root, so that a checkout in a path with spaces works.
BIN := .venv/bin

.PHONY: help setup setup-run demo test results nightly robust lint docs format clean

help:
	@echo 'make demo      search for the attributes of a rendered target (the twin); OUT=DIR (runs/demo), TWIN=near|far (far), TWIN_SEED=N (0)'
	@echo 'make test      the tests, without the slow ones; ARGS="-k name" goes to pytest; JOBS=N (2) at a time'
	@echo 'make results   every result of docs/results.md, from this commit; DATA=CAMVID ($$CAMVID_DIR), FACADES=LABELMEFACADE, STORE=FILE; hours'
	@echo 'make nightly   all tests but the next'
	@echo 'make robust    fault-injection tests: kills, full disks, damaged and hostile files; TIMES=N (20)'
	@echo 'make lint      ruff (rules, format), spelling and mypy'
	@echo 'make docs      the pages, into site/; a warning is an error'
	@echo 'make format    let ruff rewrite the code'
	@echo 'make setup     make .venv and install all into it (the others do what they need); PYTHON=...'
	@echo 'make clean     remove caches and .venv; runs/ stays'

setup:
	@PYTHON="$(PYTHON)" sh scripts/setup.sh test

setup-run:
	@PYTHON="$(PYTHON)" sh scripts/setup.sh

# The same command resumes after a kill, and does nothing after the end.
demo: setup-run
	@$(BIN)/python -m experiments.cityscapes --preset quick --out "$(OUT)" --twin "$(TWIN)" --twin-seed "$(TWIN_SEED)"
	@echo
	@echo 'The run is in $(OUT): open report.html; figures in summary.json, optimised attributes in attributes.json'

test: setup
	@$(BIN)/python -m pytest -n "$(JOBS)" --dist loadfile -m "not slow and not robust" --durations=20 $(ARGS)

results: setup
	@$(BIN)/python -m scripts.results $(if $(DATA),--data "$(DATA)") $(if $(FACADES),--facades "$(FACADES)") $(if $(STORE),--store "$(STORE)") --docs docs

# Compiled as users have it, see tests/conftest.py.
nightly: setup
	@XLA_FLAGS= $(BIN)/python -m pytest -n "$(JOBS)" --dist loadfile -m "not robust" $(ARGS)

robust: setup
	@ROBUST_TIMES="$(TIMES)" ROBUST_EXAMPLES=500 $(BIN)/python -m pytest tests/robustness $(ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/codespell --dictionary scripts/words.txt \
	    --ignore-multiline-regex '(?sm)^```.*?^```$$|````[^\n]*?````|`[^`\n]*`|\]\([^)]*\)|\{ #[^}]*\}|^:::[^\n]*' docs/*.md docs/*/*.md *.md examples/*/*.md
	$(BIN)/mypy

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo 'Open site/index.html'

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv build dist site .pytest_cache .mypy_cache .ruff_cache .hypothesis .jax_cache
	rm -rf -- *.egg-info
	find . -name __pycache__ -type d -not -path './runs/*' -prune -exec rm -rf {} +
