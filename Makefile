# Every target first makes the environment in .venv ready (.build/environment.py says when it is).
PYTHON ?= python3
DECK ?= inputs/lapping_25x32.nml

# The caller's own Python settings must not leak into the environment.
unexport PYTHONPATH PYTHONHOME

# Meson and Ninja are found by name, so the environment has to lead the search path.
ACTIVATED := PATH="$(CURDIR)/.venv/bin:$$PATH"

NEED_PYTHON := Lapwing needs Python 3.11 or newer, as in: make PYTHON=python3.13

.DEFAULT_GOAL := help
.PHONY: help env run test test-full test-hurt test-slurm lint lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile
	@echo "  PYTHON=... (>= 3.11) chooses the interpreter, FC=... the Fortran compiler,"
	@echo "  DECK=... the deck that make run takes."

env: ## make .venv ready: compiler, dependencies, the package itself
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON): not found; $(NEED_PYTHON)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "$(PYTHON) is too old; $(NEED_PYTHON)" >&2; exit 1; }
	@$(PYTHON) .build/environment.py

run: env ## run the shipped deck; it writes into results/
	@$(ACTIVATED) lapwing run $(DECK)

test: env ## style, Fortran and Python tests
	@$(ACTIVATED) python .build/run_tests.py

test-full: env ## the same and the long ones
	@$(ACTIVATED) python .build/run_tests.py --full

test-hurt: env ## kills, damage, full disks, lost workers: in full counts, told as they come
	@$(ACTIVATED) python -m pytest -s -m "full or not full" tests/test_robustness.py \
	    tests/studies/map/test_map.py tests/studies/map/test_map_deck.py tests/test_executors.py \
	    tests/commands/test_decks_side_by_side.py tests/studies/critical/test_trial_records.py

test-slurm: env ## a job array of a real Slurm, started here as root (four minutes)
	@$(ACTIVATED) python tests/slurm.py

lint: env ## style of the Python and Fortran sources
	@$(ACTIVATED) python .build/run_tests.py --lint

lock: ## pin the newest dependencies in .build/requirements.txt
	@$(PYTHON) -m venv build/lock && build/lock/bin/python -m pip install -q uv
	@build/lock/bin/uv pip compile -q --upgrade --universal --python-version 3.11 \
	    --fork-strategy fewest --generate-hashes --custom-compile-command 'make lock' \
	    --group build --group test --group lint pyproject.toml -o .build/requirements.txt

clean: ## remove the environment and all that was built, but no results
	rm -rf .venv build .hypothesis
