# Needs Python 3.11 or later and make, nothing else: every target makes .venv from the lock first.

# The newest that runs and can make an environment; a name alone says neither (pyenv's shims, Debian
# without python3-venv). Not read before .venv is made.
PYTHON ?= $(shell for python in python3.13 python3.12 python3.11 python3; do \
	"$$python" -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' \
	2>/dev/null && echo "$$python" && break; done)
# Where uv is there it installs, being faster (docs/benchmarks.md); pip does what uv cannot, e.g.
# where only pip's configuration names a mirror. UV= does without.
UV ?= $(shell command -v uv)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Independent packages that tests compare with; some are GPL, so training never installs them.
REFERENCES := $(VENV)/.references

# make train STEPS=20000 RUN=first ACTORS=2 ARGS="--set seed=7"
CONFIG ?= configs/lndrl.yaml
RUN ?= first
STEPS ?=
ACTORS ?=
ARGS ?=
# Processes that share the tests; PYTEST goes to pytest, e.g. PYTEST="-k amcl".
WORKERS ?= 2
PYTEST ?=

.PHONY: help install references train train-all test check docs format schemas clean lock

help:
	@echo "make install   .venv with the exact versions of requirements.lock"
	@echo "make references   what only tests, types and docs need (some GPL)"
	@echo "make train     train; STEPS=20000 RUN=first ACTORS=2; a run that exists is continued"
	@echo "make train-all   train every method of the paper's table; STEPS=20000 for short runs"
	@echo "make test      all tests; PYTEST=\"-k amcl\" for some"
	@echo "make check     format, lint, types, pages, tests: what every change must pass"
	@echo "make docs      the documentation as a site, build/docs/site/index.html"
	@echo "make format    format the code"
	@echo "make schemas   rewrite configs/schemas, when a key comes or changes"
	@echo "make clean     remove caches and builds, keep .venv and runs"
	@echo "make lock      rewrite requirements.lock from what pyproject.toml allows today"

# $(call fill,WHAT): put WHAT into .venv.
fill = $(if $(UV),$(UV) pip install --quiet --python $(BIN)/python $(1) || )$(BIN)/python -m pip install --quiet $(1)

install: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(or $(PYTHON),$(error no Python from 3.11 on runs here; install one or say make PYTHON=...)) -m venv $(VENV)
	$(call fill,--requirement requirements.lock)
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

$(REFERENCES): $(STAMP) tests/references/requirements.lock
	$(call fill,--no-deps --requirement tests/references/requirements.lock)
	@touch $@

references: $(REFERENCES)

train: install
	$(BIN)/lndrl train $(CONFIG) --run $(RUN) $(if $(STEPS),--steps $(STEPS)) \
		$(if $(ACTORS),--actors $(ACTORS)) $(if $(wildcard runs/$(RUN)),--resume) $(ARGS)

train-all: install
	$(BIN)/lndrl train-all $(if $(STEPS),--steps $(STEPS)) $(if $(ACTORS),--actors $(ACTORS)) $(ARGS)

test: install references
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(PYTEST)

check: install references
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m docs.site
	$(MAKE) --no-print-directory test

# What editors check the files in configs by; to be renewed when a key comes or changes.
schemas: install
	mkdir -p configs/schemas
	for kind in configuration scenario sweep bench calibration robot metrics; do \
		$(BIN)/lndrl config schema $$kind > configs/schemas/$$kind.json || exit 1; done

# Strictly: a link or anchor that leads nowhere is an error. Nothing is asked of a network.
docs: install references
	$(BIN)/python -m docs.site

format: install
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

clean:
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -exec rm -rf {} +
	rm -rf build dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache

# Local version tags and packages of one accelerator stay out: the lock serves every machine.
lock: install
	$(BIN)/python -m pip install --quiet --upgrade --upgrade-strategy eager --editable ".[dev]"
	{ sed -n '/^#/p' requirements.lock; $(BIN)/python -m pip freeze --exclude-editable \
		| sed 's/+[a-z0-9.]*$$//' | grep -v -i -E '^(nvidia-|cuda-|triton|pip==)' \
		| grep -v -i -x -F -f tests/references/requirements.lock; } > requirements.lock.new
	mv requirements.lock.new requirements.lock
