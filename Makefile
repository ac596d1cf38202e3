# Needs Python 3.11 or later with venv, and make. Everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What a user needs is installed; what tests and developers need, too.
READY := $(VENV)/.ready
TOOLS := $(VENV)/.ready-dev
# The Pythons that both lists of requirements must install on without a compiler.
PYTHONS := 3.11 3.12 3.13 3.14
# Tests start hundreds of processes, and each would compile our modules anew, for 0.2 s.
unexport PYTHONDONTWRITEBYTECODE
# A process for each core, up to four: each may take some GiB.
SIDE_BY_SIDE := -n auto --maxprocesses 4 --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help demo test long faults lint validate full readme keys docs wheel bench masters gallery requirements clean

help: ## List the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

$(READY): pyproject.toml requirements/run.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	    || { echo "domesim needs Python 3.11 or later; name one: make PYTHON=python3.12" >&2; exit 1; }
	@echo "Setting up $(VENV) (once; a few minutes)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --upgrade pip
	@$(BIN)/python -m pip install --quiet -r requirements/run.txt
	@$(BIN)/python -m pip install --quiet --no-deps --editable .
	@touch $@

$(TOOLS): $(READY) requirements/dev.txt
	@echo "Adding what tests and developers need to $(VENV) (once; a few minutes)"
	@$(BIN)/python -m pip install --quiet -r requirements/dev.txt
	@touch $@

demo: $(READY) ## Set up, compensate the bundled night scene, name the page to open
	@$(BIN)/domesim demo --out out/demo

test: $(TOOLS) ## Set up and run the tests, but for long ones
	@$(BIN)/python -m pytest $(SIDE_BY_SIDE)

long: $(TOOLS) ## The long tests: as thorough as a change deserves before it lands
	@$(BIN)/python -m pytest $(SIDE_BY_SIDE) -m long

faults: $(TOOLS) ## Harm running shows in every way, and tell what is lost (five to ten minutes)
	@$(BIN)/python -m validation.faults

lint: $(TOOLS) ## Style, types and import contracts
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@printf '%s\n' linux darwin win32 | xargs -P 3 -I '{}' \
	    $(BIN)/mypy --platform '{}' --cache-dir .mypy_cache/'{}'
	@$(BIN)/lint-imports

validate: $(TOOLS) ## What may be believed: quick experiments and their report
	@$(BIN)/domesim validate --quick --out out/validation

full: $(TOOLS) ## Renew the published figures that are older than their code (hours), or those of ONLY=NAME,...
	@$(BIN)/python -m validation.renew $(ONLY)

readme: $(TOOLS) ## Write README and docs anew, with figures that are published or of FROM=results.json
	@$(BIN)/python -m validation.readme $(FROM)

keys: $(TOOLS) ## Write docs/scene-keys.md anew
	@$(BIN)/python -m domesim.scene.reference > docs/scene-keys.md

docs: $(TOOLS) ## The site: out/docs/index.html (a minute or two)
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

bench: $(TOOLS) ## Cost of the solvers: FFTs, iterations, certified gaps
	@$(BIN)/domesim bench --out out/bench

masters: $(TOOLS) ## Render the bundled masters anew (minutes)
	@$(BIN)/python -m scenes.artwork.night --out scenes/masters/night.exr

gallery: $(TOOLS) ## Render the pictures of docs/theatres.md anew (half an hour)
	@$(BIN)/python -m validation.gallery docs/theatres

requirements: $(TOOLS) ## Compile the exact versions anew; each Python must get them without a compiler
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	    --upgrade pyproject.toml -o requirements/run.txt
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	    --upgrade --extra dev --extra docs --constraint requirements/run.txt pyproject.toml \
	    -o requirements/dev.txt
	@set -e; for list in run dev; do for python in $(PYTHONS); do \
	    $(BIN)/uv pip compile --quiet --only-binary :all: --python-version $$python \
	        --python-platform x86_64-manylinux_2_28 requirements/$$list.txt >/dev/null; \
	done; done

clean: ## Remove what the other targets made
	rm -rf $(VENV) out build dist docs/api docs/gallery docs/commands.md .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
