# One environment in .venv, then everything from there. `make` alone lists what there is.

# A further package index for torch, e.g. PyTorch's builds without CUDA (see the README).
WHEEL_INDEX ?=

# The Python that makes .venv: 3.11, 3.12 or 3.13.
SUITABLE := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
PYTHON ?= $(shell for python in python3 python3.11 python3.12 python3.13; do \
	$$python -c '$(SUITABLE)' 2>/dev/null && echo $$python && break; done)

BIN := .venv/bin
INSTALLED := .venv/.installed
PIP := $(BIN)/python -m pip --disable-pip-version-check

# One test more at a time than there are cores, since some wait for processes that they started; each
# with one thread, and four at most, for their memory. Byte code is kept, also where the shell says not
# to: tests start a hundred processes, and each would compile the project anew.
WORKERS = $(shell cores=$$(getconf _NPROCESSORS_ONLN); echo $$((cores < 3 ? cores + 1 : 4)))
TESTS = PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

.PHONY: help venv lock demo test test-slow test-wallclock explore check compiled format lint bench results docs links \
	firmware mutants clean

help:
	@echo "make demo    simulate, train, export, check and fly a predictor: the main job"
	@echo "make test    the quick tests, in less than ten minutes on two cores"
	@echo "make test-slow       the longest searches, flights and trainings, for before a release"
	@echo "make test-wallclock  the tests that need real time, and so a quiet machine; up to three tries each"
	@echo "make explore the property tests on new random examples; elsewhere they are always the same"
	@echo "make check   what CI runs: format, lint, types, import rules, manual, all but slow tests, base install"
	@echo "make lint    the part of it that takes seconds"
	@echo "make format  put the code into its format"
	@echo "make bench   latency of the eight architectures, paced at 32 Hz"
	@echo "make results  the pages of results, from the records in docs/records, and the tables of effects"
	@echo "make docs    the manual as a site with search, in build/docs/html"
	@echo "make links   whether the manual's links to other sites lead anywhere; needs a network"
	@echo "make firmware  the UNO's sketch without the Arduino IDE, and how much of the chip it takes"
	@echo "make mutants   whether the tests notice each small change of the firmware's decisions"
	@echo "make venv    only the environment, in .venv"
	@echo "make lock    the versions and hashes of what make venv installs, after a change of pyproject.toml"
	@echo "make clean   remove the environment and what the tools cached"
	@echo "Settings: PYTHON=/path/to/python3, WHEEL_INDEX=URL of a further package index"

venv: $(INSTALLED)

# Every file that is installed has a hash in requirements.lock, but for torch: WHEEL_INDEX offers another
# build of it, with another hash. Its version is pinned; a CUDA build brings NVIDIA's libraries and triton
# along, without hashes, too.
$(INSTALLED): pyproject.toml requirements.lock constraints.txt
	@$(or $(PYTHON),false) -c '$(SUITABLE)' || { echo "No suitable Python: wakedeploy needs 3.11, \
	3.12 or 3.13; install one, or name it: make PYTHON=/path/to/python3.12"; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) cannot make virtual \
	environments; on Debian, Ubuntu and Raspberry Pi OS: sudo apt install python3-venv"; exit 2; }
	$(PYTHON) -m venv .venv
	$(PIP) install --require-hashes --only-binary :all: --requirement requirements.lock
	$(PIP) install --constraint constraints.txt $(if $(WHEEL_INDEX),--extra-index-url $(WHEEL_INDEX)) torch
	$(PIP) install --no-deps --no-build-isolation --editable .
	$(PIP) check
	@touch $@

lock:
	bash .ci/lock

demo: $(INSTALLED)
	$(BIN)/wakedeploy demo

test: $(INSTALLED)
	$(TESTS)

test-slow: $(INSTALLED)
	$(TESTS) -m 'slow and not wallclock'

test-wallclock: $(INSTALLED)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m 'wallclock and not slow' --reruns 2

explore: $(INSTALLED)
	$(TESTS) -m 'hypothesis and not slow and not wallclock' --hypothesis-profile explore

# What lints and what builds the manual takes one core each; then tests are compiled once, and not by each
# worker.
check:
	$(MAKE) --output-sync --jobs 2 lint docs compiled
	$(TESTS) -m '(not slow and not wallclock) or install'

compiled: $(INSTALLED)
	-@PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --collect-only -q >/dev/null

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lint: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(INSTALLED)
	$(BIN)/wakedeploy bench latency

results: $(INSTALLED)
	$(BIN)/python -m benchmarks.results

# Warnings are errors; no network. Always anew: pages are made of code and records, too.
docs: $(INSTALLED)
	$(BIN)/python -m sphinx -E -a -W --keep-going -q -c docs/site -d build/docs/doctrees docs build/docs/html

# Not a part of `make check`: other sites fail for reasons of their own.
links: $(INSTALLED)
	$(BIN)/python -m sphinx -E -a -q -b linkcheck -c docs/site -d build/docs/doctrees docs build/docs/links

firmware: $(INSTALLED)
	$(BIN)/python -m runtime.virtual.firmware_build

mutants: $(INSTALLED)
	$(BIN)/python tests/firmware/mutants.py --json docs/records/mutants.json

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis \
		.import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
