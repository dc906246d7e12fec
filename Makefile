# Needs Python 3.11 or newer with pip, nothing else.  Everything is installed into .venv, once.

PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python

# Small matrices: more BLAS threads than one per process cost time instead of saving it.
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help demo test check format bench docs results-ch4 golden fuzz clean

help:  ## say what there is
	@grep -E '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## /  make \1\t/' | expand -t 20

demo: $(VENV)/.installed  ## import a sample recording, place its blocks, check it, look at it, export it again
	$(VENV)/bin/ecat demo

test: $(VENV)/.installed-test  ## run the tests
	$(PY) -m pytest -n logical --maxprocesses 8

check: $(VENV)/.installed-dev  ## lint, format, types, import walls
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m pyright
	$(VENV)/bin/lint-imports --no-logo

format: $(VENV)/.installed-dev  ## format the code and mend what the linter can mend
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

bench: $(VENV)/.installed-test  ## measure the speed of the parts
	@for script in $(filter-out benchmarks/results_%,$(wildcard benchmarks/[a-z]*.py)); do echo "== $$script"; $(PY) $$script || exit 1; done

docs: $(VENV)/.installed  ## write docs/cli.md, the README's formats, schemas/ and web/openapi.json anew from the code
	$(PY) -m ecat.cli.reference > docs/cli.md.new && mv docs/cli.md.new docs/cli.md
	$(PY) -m ecat.cli.reference README.md
	$(PY) -m ecat.schemas
	$(PY) -m ecat.web.openapi > web/openapi.json.new && mv web/openapi.json.new web/openapi.json

results-ch4: $(VENV)/.installed-dev  ## train the recognisers of thesis chapter 4 and ours, and print the table (EXPORTS, RUN, RESULTS)
	$(PY) benchmarks/results_ch4.py $(or $(EXPORTS),../shared/data/actions_ch4/xml) --run $(or $(RUN),build/results-ch4) \
		$(or $(RESULTS),--hidden 64 --epochs 20 --rate 0.5)

golden: $(VENV)/.installed-test  ## accept what the code writes now as the expected output of the tests
	$(PY) -m pytest --update-golden

fuzz: $(VENV)/.installed-test  ## feed broken files to every reader for an hour (SECONDS_TO_FUZZ)
	$(PY) -m tests.fuzz --seconds $(or $(SECONDS_TO_FUZZ),3600)

clean:  ## remove what the tools made, .venv too
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A .venv made by another tool is used as it is, also one without pip: pip is then borrowed from $(PYTHON).
PIP = $$($(PY) -c 'import pip' 2>/dev/null && echo $(PY) -m pip || echo $(PYTHON) -m pip --python $(PY))
INSTALL = @echo 'installing into $(VENV) (once)'; $(PIP) install --quiet --disable-pip-version-check --editable

# One whose interpreter is gone (moved, or upgraded away) is made anew, and what was installed in it forgotten.
$(shell $(PY) -c '' 2>/dev/null || rm -f $(VENV)/.installed*)

# ensurepip is missing from the Python of some distributions.
.PHONY: venv
venv:
	@$(PY) -c '' 2>/dev/null || { \
	  $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo 'ecat needs Python 3.11 or newer; try: make PYTHON=python3.11 ...' >&2; exit 1; }; \
	  $(PYTHON) -m venv --clear $$($(PYTHON) -c 'import ensurepip' 2>/dev/null || echo --without-pip) $(VENV); }

# The stamps keep a second run from asking pip again; a changed pyproject.toml asks again.
$(VENV)/.installed: pyproject.toml | venv
	$(INSTALL) '.'
	@touch $@

$(VENV)/.installed-test: pyproject.toml | venv
	$(INSTALL) '.[test]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-dev: pyproject.toml | venv
	$(INSTALL) '.[dev]'
	@touch $@ $(VENV)/.installed $(VENV)/.installed-test
