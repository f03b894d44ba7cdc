# Every target sets up what it needs by itself, once (scripts/setup.sh); `make` alone lists them.
python := .venv/bin/python
# make test PYTHON=3.13 sets up and tests with that Python.
PYTHON ?=
export ANM_MJ_PYTHON := $(if $(PYTHON),python$(PYTHON),$(ANM_MJ_PYTHON))
# Files of a user's own in the checkout are none of the project's.
checked := anm_mj docs scripts tests typings
JOBS ?= 2
SCENE ?= home
STEPS ?= 500
SEED ?= 0

.DEFAULT_GOAL := help
.PHONY: help demo docs test test-all test-pythons test-bench test-ros test-browser check lint format types lock setup clean

help: ## List the targets.
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: setup ## Explore a furnished house and show the result (SCENE=home STEPS=500 SEED=0).
	@.venv/bin/anm-mj explore $(SCENE) --steps $(STEPS) --seed $(SEED)
	@command -v anm-mj > /dev/null || echo "For anm-mj in this shell: source .venv/bin/activate"

test: lint ## Check style, types (beside the tests), run the tests (JOBS=2); minutes.
	@$(python) -m pyright & types=$$!; \
		CHECKED_CALLS=some PYTHONDONTWRITEBYTECODE= $(python) -m pytest -n $(JOBS) -m "not slow"; tests=$$?; \
		wait $$types || { echo "The types are not in order: see above."; exit 1; }; exit $$tests

test-all: lint types ## The same with the slow tests.
	@$(python) -m pytest -n $(JOBS)

test-pythons: ## Test with every Python that is supported, each in a clone of its own; half an hour.
	@for version in 3.11 3.12 3.13; do \
		rm -rf build/python$$version && git clone -q . build/python$$version && \
		make -C build/python$$version test PYTHON=$$version || exit 1; \
	done

test-bench: setup ## Kill a comparison of 24 real runs, go on, compare the tables; some minutes.
	@$(python) -m pytest -m slow -k real_runs_resume tests/bench

test-ros: setup ## Test the robot over ROS 2, in real time, against a peer in Rust (cargo); minutes.
	@$(python) -m pytest tests/ros

test-browser: setup ## Test the pages in Chromium; screenshots in build/screenshots.
	@command -v chromium > /dev/null || { echo "There is no chromium here: apt install chromium"; exit 1; }
	@SCREENSHOTS=build/screenshots $(python) -m pytest tests/replay tests/viz

docs: setup ## Build the site of the documentation in build/site.
	@$(python) -m sphinx -q -W --keep-going -d build/doctrees docs build/site
	@echo "open build/site/index.html"

lint: setup ## Check style and format.
	@$(python) -m ruff check --quiet $(checked)
	@$(python) -m ruff format --check --quiet $(checked)

types: setup ## Check types.
	@$(python) -m pyright

format: setup ## Put the code into the project's format.
	@$(python) -m ruff check --fix --quiet $(checked)
	@$(python) -m ruff format --quiet $(checked)

lock: setup ## Pin the newest versions that pyproject.toml allows.
	@$(python) -m uv pip compile pyproject.toml --upgrade --all-extras --universal --python-version 3.11 \
		--no-emit-index-url --no-header --quiet --generate-hashes --output-file requirements.txt

setup: ## Set up what is missing: graphics libraries, virtual environment, pinned packages.
	@bash scripts/setup.sh

clean: ## Remove the virtual environment and caches; runs are kept.
	@rm -rf .venv .pytest_cache .ruff_cache .hypothesis build dist *.egg-info MUJOCO_LOG.TXT
	@find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +
