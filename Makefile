# make demo   set up, fly the default scenario, say where its report is
# make test   set up, run all tests
# Everything is installed into .venv; build requirements are installed once, so later builds are quick.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(shell find fmus orchestrator gains hil_bridge -type f \
  \( -name '*.c' -o -name '*.cpp' -o -name '*.hpp' -o -name '*.h' -o -name 'CMakeLists.txt' -o -name '*.json' \) \
  -o -path 'fmus/*.py' -o -path 'fmus/*.toml')

.PHONY: help demo test build lint format bench bars designs vcan c-table c-platforms platforms compatibility clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^# //p' Makefile | head -n 2
	@echo "make build | lint | format | bench | bars | designs | vcan | c-table | c-platforms | platforms | compatibility | clean"

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
build/typing/rotordx: Makefile
	@mkdir -p $@ && touch $@
	@for package in fmus gains orchestrator hil_bridge; do ln -sfn $(CURDIR)/$$package $@/$$package; done

CXX_FILES = $(shell find fmus orchestrator -name '*.cpp' -o -name '*.hpp' -o -name '*.c' -o -name '*.h')

lint: build $(VENV)/.lint build/typing/rotordx
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(CXX_FILES)
	cd build/typing && MYPYPATH=. $(CURDIR)/$(BIN)/mypy --config-file $(CURDIR)/pyproject.toml \
	  -p rotordx.fmus -p rotordx.gains -p rotordx.orchestrator -p rotordx.hil_bridge

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

# The full campaigns behind the figures of merit; their results are written to tests/bars/results.
bars: build $(VENV)/.test
	for campaign in fdie lab_x thau hinf kalman rho_adaptive; do $(BIN)/python -m tests.bars.$$campaign || exit 1; done

# The tests of the CAN bridge on a real SocketCAN vcan, inside user-mode Linux.
vcan: build $(VENV)/.test
	$(BIN)/python -m pytest -p no:xdist -o addopts= -q tests/can/test_vcan.py

# What the exported C takes on a Cortex-M7; the figures go into orchestrator/export.
c-table: build $(VENV)/.test
	$(BIN)/python -m tests.c_export.table

# Compilers for other platforms.
$(VENV)/.platforms: $(VENV)/.requirements
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $$($(BIN)/python -c \
	  "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['platforms'])")
	@touch $@

# The exported C for Windows, macOS and aarch64, and cppcheck of the largest diagnosers: minutes, more at the first time.
c-platforms: build $(VENV)/.test $(VENV)/.platforms
	$(BIN)/python -m pytest -m slow tests/c_export

# FMUs for other platforms, run by wine and qemu-user where these are installed: minutes, more at the first time. The
# differences from this platform's values are printed.
platforms: build $(VENV)/.test $(VENV)/.platforms
	$(BIN)/python -m pytest -m slow -rP --show-capture=stdout tests/swap/test_other_platforms.py

# CoFMUPy pins an older FMPy than ours: an environment of its own.
build/cofmupy/.installed:
	@echo "Installing CoFMUPy into build/cofmupy ..."
	@$(PYTHON) -m venv build/cofmupy
	@build/cofmupy/bin/python -m pip install --quiet --disable-pip-version-check cofmupy==1.0.0
	@touch $@

# Every FMU in every importer that pip installs, beside FMPy.
compatibility: build $(VENV)/.test build/cofmupy/.installed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --group compatibility
	$(BIN)/python -m tests.swap.compatibility

clean:
	rm -rf build $(VENV) results
