# Needs Python 3.11 or later with venv, and make. Everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Tests start hundreds of processes, and each would compile our modules anew, for 0.2 s.
unexport PYTHONDONTWRITEBYTECODE
# A process for each core, up to four: each may take some GiB.
SIDE_BY_SIDE := -n auto --maxprocesses 4 --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help demo test long faults lint validate readme schema keys docs wheel bench masters gallery requirements clean

help: ## List the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

$(READY): pyproject.toml requirements/dev.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	    || { echo "domesim needs Python 3.11 or later; name one: make PYTHON=python3.12" >&2; exit 1; }
	@echo "Setting up $(VENV) (once; a few minutes)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --upgrade pip
	@$(BIN)/python -m pip install --quiet -r requirements/dev.txt
	@$(BIN)/python -m pip install --quiet --no-deps --editable .
	@touch $@

demo: $(READY) ## Set up, compensate the bundled night scene, name the page to open
	@$(BIN)/domesim demo --out out/demo

test: $(READY) ## Set up and run the tests, but for long ones
	@$(BIN)/python -m pytest $(SIDE_BY_SIDE)

long: $(READY) ## The long tests: as thorough as a change deserves before it lands
	@$(BIN)/python -m pytest $(SIDE_BY_SIDE) -m long

faults: $(READY) ## Harm running shows in every way, and tell what is lost (five to ten minutes)
	@$(BIN)/python -m validation.faults

lint: $(READY) ## Style, types and import contracts
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

validate: $(READY) ## What may be believed: quick experiments and their report
	@$(BIN)/domesim validate --quick --out out/validation

readme: $(READY) ## Write the figures of README and docs anew, from out/full (domesim validate --out out/full)
	@$(BIN)/python -m validation.readme out/full/results.json

schema: $(READY) ## Write the schema of results.json anew
	@$(BIN)/python -m validation.report > validation/results.schema.json

keys: $(READY) ## Write docs/scene-keys.md anew
	@$(BIN)/python -m domesim.scene.reference > docs/scene-keys.md

docs: $(READY) ## The site: out/docs/index.html (a minute or two)
	@$(BIN)/python -m sphinx -q -W --keep-going -c docs . out/docs
	@echo "Open out/docs/index.html"

wheel: ## Build the package, and try it in an empty environment and folder (minutes)
	@rm -rf out/wheel && mkdir -p out/wheel/empty
	@$(PYTHON) -m venv out/wheel/env
	@out/wheel/env/bin/python -m pip install --quiet --upgrade pip
	@out/wheel/env/bin/python -m pip wheel --quiet --no-deps --wheel-dir out/wheel .
	@out/wheel/env/bin/python -m pip install --quiet out/wheel/*.whl
	@cd out/wheel/empty && ../env/bin/domesim demo --out demo \
	    && ../env/bin/domesim validate --quick --only closed_form --out validation

bench: $(READY) ## Cost of the solvers: FFTs, iterations, certified gaps
	@$(BIN)/domesim bench --out out/bench

masters: $(READY) ## Render the bundled masters anew (minutes)
	@$(BIN)/python -m scenes.artwork.night --out scenes/masters/night.exr

gallery: $(READY) ## Render the pictures of docs/theatres.md anew (half an hour)
	@$(BIN)/python -m validation.gallery docs/theatres

requirements: $(READY) ## Compile the exact versions anew
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	    --upgrade pyproject.toml -o requirements/run.txt
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	    --upgrade --extra dev --extra docs pyproject.toml -o requirements/dev.txt

clean: ## Remove what the other targets made
	rm -rf $(VENV) out build dist docs/api docs/gallery docs/commands.md .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
