# Each target sets up what it needs in .venv of this checkout: Python 3.11 to 3.14 and make suffice.
# Where another Python is wanted: make fly PYTHON=/path/to/python

PYTHON  ?= python3 python3.14 python3.13 python3.12 python3.11
BIN     := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input
LOCK     = $(BIN)/uv pip compile --universal --python-version 3.11 --quiet \
           --generate-hashes --only-binary :all: --emit-build-options --no-annotate \
           --custom-compile-command 'make lock' $(UPGRADE)

.PHONY: help fly test check paper pictures bench lock clean lint format types imports scenarios schema viewers
.DELETE_ON_ERROR:

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*  ## /  make \1\t/p' $(MAKEFILE_LIST)

fly: .venv/.ready  ## fly 60 s across the Jacksboro fault; leaves jacksboro.mcap
	@$(BIN)/hedgehop run scenarios/jacksboro.yaml

test: .venv/.ready  ## run the tests; narrow them with ARGS='-k terrain'
	@$(BIN)/python -m pytest --numprocesses 2 $(ARGS)

check: lint format types imports scenarios schema viewers  ## everything else CI asks for; -k goes on after a failure

lint: .venv/.checks
	$(BIN)/ruff check .

format: .venv/.checks
	$(BIN)/ruff format --check .

types: .venv/.checks
	$(BIN)/pyright

imports: .venv/.checks
	$(BIN)/lint-imports

scenarios: .venv/.ready
	@for scenario in scenarios/*.yaml benchmarks/*.yaml; do $(BIN)/hedgehop validate $$scenario || exit; done

schema: .venv/.ready
	@$(BIN)/hedgehop schema | diff scenarios/scenario.schema.json - > /dev/null || \
	  { echo 'scenarios/scenario.schema.json: out of date, write it with hedgehop schema' >&2; exit 1; }

viewers: .venv/.checks
	$(BIN)/python -m pytest -m viewers

paper: .venv/.ready  ## run the paper's studies again, in minutes: paper-report/report.html; ARGS= for the full run
	@$(BIN)/hedgehop paper $(if $(filter undefined,$(origin ARGS)),--quick,$(ARGS))

pictures: .venv/.checks  ## picture a flight as viewers show it; needs Vulkan, software suffices
	@$(BIN)/hedgehop run scenarios/jacksboro.yaml --out jacksboro.mcap
	@$(BIN)/python docs/pictures.py jacksboro.mcap docs

bench: .venv/.ready  ## measure speed: the figures of benchmarks/README.md
	@$(BIN)/python benchmarks/run_all.py $(ARGS)

lock: .venv/pyvenv.cfg  ## write the locked versions again; UPGRADE=--upgrade moves them to the newest
	@echo 'resolving for Python 3.11 and newer on every platform ...'
	@$(INSTALL) uv
	@$(LOCK) pyproject.toml --group build --group test --output-file requirements.txt
	@$(LOCK) --group lint --group viewers --constraint requirements.txt --output-file requirements-check.txt

clean:  ## remove .venv and caches; recordings stay
	rm -rf .venv .pytest_cache .hypothesis .ruff_cache .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# --- the environment: made once, renewed when the lock or pyproject.toml changes ---

.venv/.ready: .venv/pyvenv.cfg requirements.txt pyproject.toml
	@echo 'installing the locked packages into .venv (the first time about 250 MB, a minute or two) ...'
	@$(INSTALL) --require-hashes --requirement requirements.txt
	@echo 'installing hedgehop ...'
	@$(INSTALL) --no-deps --no-build-isolation --editable .
	@touch $@

.venv/.checks: .venv/.ready requirements-check.txt
	@echo 'installing ruff, pyright, import-linter and rerun into .venv (the first time about 300 MB) ...'
	@$(INSTALL) --require-hashes --requirement requirements-check.txt
	@touch $@

.venv/pyvenv.cfg:
	@for python in $(PYTHON) none; do \
	  "$$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' \
	    2> /dev/null && break; \
	done; \
	if [ "$$python" = none ]; then \
	  echo 'python: none of $(PYTHON) is Python 3.11 to 3.14, name one with PYTHON=/path/to/python' >&2; \
	  exit 1; \
	fi; \
	if ! "$$python" -c 'import ensurepip, venv' 2> /dev/null; then \
	  echo "$$python: its venv module is missing, install it (Debian, Ubuntu: apt install python3-venv)" >&2; \
	  exit 1; \
	fi; \
	echo "making .venv with $$("$$python" --version) ..."; \
	"$$python" -m venv --clear .venv || { rm -rf .venv; exit 1; }
