# `make help` lists the targets; every target sets up .venv by itself (scripts/setup.sh).

SHELL := /bin/bash
unexport PYTHONDONTWRITEBYTECODE  # with it each process of the tests compiles all of karma anew
MAKEFLAGS += --no-print-directory
PY := .venv/bin/python
WORKERS ?= 2
SEED ?= 29
HASHED := $(wildcard $(foreach name,short_term scene_graph recall program prompt perceive goals \
	policies tasks draw,tests/*/test_$(name).py))
CORE_TESTS = $(addprefix tests/,agent bench cli goals household journal loading memory models world \
	test_layers.py test_plugins.py test_packaging.py)
SHARED_TESTS = $(shell grep -lE 'SHARED|\bshared\b' tests/test_*.py tests/*/test_*.py tests/*/*/test_*.py)

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-core check hashed format scenes planner tool-planner paper airgap docs server clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1|/p' Makefile | column -t -s '|' 2>/dev/null \
		|| sed -n 's/^\([a-z-]*\):.*## /  make \1: /p' Makefile

setup: ## make .venv: pinned packages, llama.cpp built from source once, this package
	@bash scripts/setup.sh

demo: setup ## run the small evaluation of eval/demo.toml
	@echo "demo: karma eval eval/demo.toml --fresh"
	@.venv/bin/karma eval eval/demo.toml --fresh

test: setup ## check, then all tests; those of the reference data last, where it is
	@$(MAKE) -j 2 --output-sync=target check hashed
	@echo "test: everything as where the reference data is not, $(WORKERS) workers, some minutes"
	@KARMA_SHARED=/nowhere PYTHONHASHSEED=0 OMP_NUM_THREADS=1 $(PY) -m pytest -n $(WORKERS) --dist worksteal
	@echo "test: what reads the reference data (KARMA_SHARED, else ../shared)"
	@PYTHONHASHSEED=0 OMP_NUM_THREADS=1 $(PY) -m pytest -n $(WORKERS) --dist worksteal -m shared $(SHARED_TESTS)

test-core: setup ## the tests of the core alone, without plug-ins, kills and wheels
	@KARMA_SHARED=/nowhere PYTHONHASHSEED=0 OMP_NUM_THREADS=1 $(PY) -m pytest -n $(WORKERS) --dist worksteal \
		$(CORE_TESTS)

hashed: setup
	@echo "test: what has golden answers, under another hash seed"
	@PYTHONHASHSEED=4242 OMP_NUM_THREADS=1 $(PY) -m pytest -n 0 -qq -r fE $(HASHED)

check: setup ## names of test files, format, lint, types, layers
	@echo "check: two test files of one name cannot be collected together"
	@! find tests -name 'test_*.py' -printf '%f\n' | sort | uniq -d | grep .
	@echo "check: ruff format" && $(PY) -m ruff format --check --quiet .
	@echo "check: ruff" && $(PY) -m ruff check --quiet .
	@echo "check: layers" && .venv/bin/lint-imports --no-logo >.venv/layers.log \
		|| { cat .venv/layers.log; exit 1; }
	@echo "check: mypy" && $(PY) -m mypy --no-error-summary

format: setup ## write what `check` asks for where ruff can
	@$(PY) -m ruff format . && $(PY) -m ruff check --fix .

scenes: setup ## draw the rooms in karma/world/scenes again; equal seeds give equal bytes
	@$(PY) scripts/make_scenes.py --seed $(SEED)

planner: setup ## draw what karma-mini was tuned on, tune, merge; many hours without a GPU; resumes
	@$(PY) scripts/planner_data.py examples --folder runs/planner
	@.venv/bin/karma models tune runs/planner/examples.jsonl.gz runs/planner/tuned --plain --watch runs/planner/watched.jsonl.gz --seed 37
	@echo "planner: what trained karma-nano from nothing went; its card names the commit that still has it"

tool-planner: setup ## draw chats of tool mode and tune Qwen2.5-Coder-0.5B on them within 12 minutes on a GPU; resumes
	@$(PY) scripts/planner_data.py trajectories --folder runs/tools
	@.venv/bin/karma models tune runs/tools/chats.jsonl.gz runs/tools/tuned --base qwen2.5-coder-0.5b --rate 5e-4 --minutes 10 --watch runs/tools/watched.jsonl.gz --seed 41

paper: setup ## every table and figure of the paper with the nano models; resumes
	@bash scripts/reproduce.sh

airgap: setup ## the demo where no network interface is, and traced; needs unshare, and strace
	@bash scripts/airgap.sh

docs: setup ## the API reference, from the docstrings, in build/api; opens no network
	@$(PY) scripts/make_reference.py build/api

server: setup ## build llama.cpp's own server, an extra: 11 minutes on 2 cores, once
	@bash scripts/build_llama_server.sh

clean: ## remove caches and build leftovers; keeps .venv, runs/ and the wheel cache
	@rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	@find karma tests scripts -name __pycache__ -type d -prune -exec rm -rf {} +
