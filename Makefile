# make demo   set up, fly the default scenario, say where its report is
# make test   set up, run all tests
# Everything is installed into .venv; build requirements are installed once, so later builds are quick.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(shell find fmus orchestrator gains -type f \
  \( -name '*.c' -o -name '*.cpp' -o -name '*.hpp' -o -name '*.h' -o -name 'CMakeLists.txt' -o -name '*.json' \) \
  -o -path 'fmus/*.py' -o -path 'fmus/*.toml')

.PHONY: help demo test build lint format bench bars designs clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^# //p' Makefile | head -n 2
	@echo "make build | lint | format | bench | bars | designs | clean"

demo: build
	@$(BIN)/rotordx run

test: build $(VENV)/.test
	$(BIN)/python -m pytest

# The environment: a Python that is new enough, a compiler, the build requirements.
$(VENV)/.requirements: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "rotordx needs Python 3.11 or newer; say which one with 'make PYTHON=python3.12 ...'." >&2; exit 1; }
	@for tool in cc c++; do command -v $$tool >/dev/null || \
	  { echo "rotordx needs a C and C++ compiler ('$$tool' was not found): install one, for example Debian's build-essential." >&2; exit 1; }; done
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing the requirements into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  $$($(BIN)/python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); print(*p['build-system']['requires'], *p['project']['dependencies'])")
	@touch $@

$(VENV)/.build: $(VENV)/.requirements $(SOURCES)
	@echo "Building the FMUs ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

$(VENV)/.test: $(VENV)/.requirements
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --group test
	@touch $@

$(VENV)/.lint: $(VENV)/.test
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --group lint
	@touch $@

build: $(VENV)/.build

# mypy sees the packages under the names they are imported by.
build/typing/rotordx:
	@mkdir -p $@
	@for package in fmus gains orchestrator; do ln -sfn $(CURDIR)/$$package $@/$$package; done

CXX_FILES = $(shell find fmus orchestrator -name '*.cpp' -o -name '*.hpp' -o -name '*.c' -o -name '*.h')

lint: build $(VENV)/.lint build/typing/rotordx
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(CXX_FILES)
	cd build/typing && MYPYPATH=. $(CURDIR)/$(BIN)/mypy --config-file $(CURDIR)/pyproject.toml \
	  -p rotordx.fmus -p rotordx.gains -p rotordx.orchestrator

format: $(VENV)/.lint
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CXX_FILES)

bench: build $(VENV)/.test
	$(BIN)/python -m tests.benchmarks.bench

# Packaged designs: identified from healthy simulated flights, or designed and proved.
designs: build
	$(BIN)/python -m rotordx.orchestrator.healthy_flights
	$(BIN)/python -m rotordx.gains.packaged

# The full campaign behind the figures of merit; its results are written to tests/bars/results.
bars: build $(VENV)/.test
	$(BIN)/python -m tests.bars.campaign

clean:
	rm -rf build $(VENV) results
