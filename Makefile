# `make` lists the targets. Each target sets up the virtual environment first, if necessary.
# ARGS="..." passes options on: make bohb-cartpole ARGS="--seed 1"

PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3.13 || echo python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
ARGS ?=
EXTRAS ?=
TASK ?= CartPole-v0

.DEFAULT_GOAL := help
.PHONY: help setup lock bohb-cartpole bohb-acrobot nes nes-cartpole nes-acrobot experiments-cartpole experiments-acrobot runs ui test check docs bench format clean

help: ## List the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /|/' | column -t -s '|'

setup: $(INSTALLED) ## Set up the virtual environment; EXTRAS="mujoco box2d" adds packages for tasks
	@for extra in $(EXTRAS); do $(BIN)/python -m pip install --quiet --constraint constraints.txt \
		"gymnasium[$$extra]" || exit 1; done

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Python 3.11 to 3.13 is needed, $(PYTHON) is {v[0]}.{v[1]}: make PYTHON=...")'
	@echo "setting up $(VENV), once; this takes about 2 minutes on 2 cores"
	@echo "  1 of 2: all packages except PyTorch, some seconds"
	@# An interruption leaves a Python without pip; the next call replaces it.
	@$(BIN)/python -m pip --version > /dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@grep -vE '^torch==' constraints.txt > $(VENV)/others.txt
	@# uv is several times faster than pip, which is the fallback. Both compile all bytecode, because
	@# with PYTHONDONTWRITEBYTECODE every process would compile its imports.
	@command -v uv > /dev/null || $(BIN)/python -m pip install --quiet --no-deps $$(grep -E '^uv==' constraints.txt) || true
	@$$(command -v uv || echo $(BIN)/uv) pip install --quiet --compile-bytecode --python $(BIN)/python --no-deps --requirement $(VENV)/others.txt \
		|| $(BIN)/python -m pip install --quiet --no-deps --requirement $(VENV)/others.txt
	@# As a path: in the parent folder, a folder named bilevel would hide a finder's module.
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --config-settings \
		editable_mode=compat --editable .
	@$(BIN)/python -m compileall -q bilevel search_spaces cluster benchmarks tests
	@echo "  2 of 2: PyTorch, 200 MB, while the agents' kernels are compiled, 1 to 2 minutes"
	@# By pip, whose configuration may select a build without CUDA. The kernels do not need PyTorch.
	@$(BIN)/python -m pip install --quiet --no-deps $$(grep -E '^torch==' constraints.txt) & \
		installing=$$!; $(BIN)/python -m bilevel.compile && wait $$installing
	@$(BIN)/python -c 'import torch' 2> /dev/null || { \
		echo "  this build of PyTorch needs the libraries of CUDA: installing them, some GB"; \
		$(BIN)/python -m pip install --quiet $$(grep -E '^torch==' constraints.txt); }
	@touch $@

lock: $(INSTALLED) ## Resolve the dependencies and pin them in constraints.txt
	@(sed '/^[^#]/,$$d' constraints.txt; $(BIN)/uv pip compile --quiet --universal --upgrade \
		--all-extras --no-annotate --no-header pyproject.toml \
		| grep -vE '^(cuda|netifaces|nvidia|triton)') > constraints.new
	@mv constraints.new constraints.txt

bohb-cartpole: $(INSTALLED) ## BOHB over NES on CartPole-v0, local Ray, results in MLflow
	@$(BIN)/bilevel bohb CartPole-v0 $(ARGS)

bohb-acrobot: $(INSTALLED) ## The same on Acrobot-v1
	@$(BIN)/bilevel bohb Acrobot-v1 $(ARGS)

nes: $(INSTALLED) ## One NES run on any task: make nes TASK=MountainCarContinuous-v0
	@$(BIN)/bilevel nes $(TASK) $(ARGS)

nes-cartpole: $(INSTALLED) ## One NES run on CartPole-v0: an SE in minutes
	@$(BIN)/bilevel nes CartPole-v0 $(ARGS)

nes-acrobot: $(INSTALLED) ## The same on Acrobot-v1
	@$(BIN)/bilevel nes Acrobot-v1 $(ARGS)

experiments-cartpole: $(INSTALLED) ## The paper's experiments on CartPole-v0, and their report
	@$(BIN)/bilevel experiment all CartPole-v0 $(ARGS)

experiments-acrobot: $(INSTALLED) ## The same on Acrobot-v1
	@$(BIN)/bilevel experiment all Acrobot-v1 $(ARGS)

runs: $(INSTALLED) ## All runs so far: state, progress, best score
	@$(BIN)/bilevel runs $(ARGS)

ui: $(INSTALLED) ## The MLflow UI on these runs
	@$(BIN)/bilevel ui $(ARGS)

# Compile the kernels first, or every test process would compile changed kernels.
# Three processes on two cores: while one test waits for a process, another one computes.
test: check ## Format, lint, types, and all tests
	@$(BIN)/python -m bilevel.compile
	@$(BIN)/python -m pytest --numprocesses 3 --dist loadfile --no-loadscope-reorder $(ARGS)

check: $(INSTALLED) ## Format, lint, types and imports
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/ruff check --quiet .
	@$(BIN)/mypy --num-workers auto bilevel search_spaces cluster tests benchmarks
	@$(BIN)/lint-imports --no-logo

docs: $(INSTALLED) ## The documentation as a site in docs/_build, without a network
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -b html docs docs/_build
	@echo "open docs/_build/index.html"

bench: $(INSTALLED) ## All speed measurements in turn, on a quiet machine; rewrites results and tables
	@for measurement in speed.products speed.inner_loop speed.vector_env speed.real_env speed.cost speed.startup tracking readme; do \
		$(BIN)/python -m benchmarks.$$measurement || exit 1; \
	done

format: $(INSTALLED) ## Format and sort imports
	@$(BIN)/ruff check --fix --quiet .
	@$(BIN)/ruff format --quiet .

clean: ## Remove the virtual environment and caches (not the runs)
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache *.egg-info
