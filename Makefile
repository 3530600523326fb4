# Two commands are all a newcomer needs: `make picture` and `make test`. Both make .venv first, and install again only when
# pyproject.toml or constraints.txt have changed. Needs make and Python 3.11 or newer.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-compile -c constraints.txt
# pip would need half a minute for bytecode: it is written in the background, beside what comes next
BYTECODE := (nice -n 19 $(BIN)/python -m compileall -q $(VENV)/lib > /dev/null 2>&1 &)
# uv installs in a fifth of pip's time; where it does not get through to its index, pip does what it can do
UV := $(BIN)/uv pip install --quiet --python $(BIN)/python -c constraints.txt
JOBS ?= 2
ARGS ?=

.PHONY: help navigate picture test test-all check unit all docs pictures coverage compiled bench constraints pins lowest wheel try-wheel licences firmware emulator forget clean
.DEFAULT_GOAL := help
.NOTPARALLEL:

help:
	@echo "make navigate [ARGS='--rig ideal']  the main job: the ball goes from ring 1 to ring 5"
	@echo "make picture                        the same on the rig toy, drawn into runs/first.png"
	@echo "make test                           check, then unit: about four minutes on two cores"
	@echo "make test-all                       check, then all tests: about twenty minutes"
	@echo "make check                          formatting, lint, types, import contracts"
	@echo "make unit [ARGS='-k map']           the tests, without slow ones and those in real time"
	@echo "make all [ARGS='-k map']            all tests"
	@echo "make coverage                       the tests, and the lines they reach: 95 % or more"
	@echo "make bench [ARGS=--quick]           measure, write BENCHMARKS.md and docs/history.json"
	@echo "make constraints                    pin the newest versions of everything in constraints.txt"
	@echo "make pins                           compare constraints.txt with what is installed and needed"
	@echo "make licences                       check the licences of all dependencies"
	@echo "make lowest                         tests with the lowest versions that pyproject.toml allows"
	@echo "make wheel                          dist/*.whl"
	@echo "make try-wheel                      the wheel in an empty environment: the commands of README"
	@echo "make firmware                       for the board, into build/firmware/ (needs Debian packages)"
	@echo "make emulator                       firmware and simulated board into build/ (needs Debian packages)"
	@echo "make docs                           the documentation as a site, build/docs/index.html"
	@echo "make pictures                       the pictures of README and docs anew"
	@echo "make forget                         compile anew what Numba has compiled"
	@echo "make clean                          remove .venv and what was built"
	@echo "Another Python: make PYTHON=python3.12 ..."

$(VENV)/made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "mazeplan needs Python 3.11 or newer; '$(PYTHON)' is: $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "Name another one: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || { \
	  echo "this Python has no venv; on Debian or Ubuntu: apt install python3-venv" >&2; exit 1; }
	@echo "making $(VENV)"; $(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/installed: $(VENV)/made pyproject.toml constraints.txt
	@echo "installing mazeplan (a minute or so, most of it download)"
	@$(PIP) uv && $(UV) -e . || $(PIP) -e .
	@$(BYTECODE)
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	@echo "installing the tools for the documentation"
	@$(PIP) -e '.[docs]'
	@$(BYTECODE)
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	@echo "installing the test tools"
	@$(PIP) -e '.[dev,learn]'
	@$(BYTECODE)
	@touch $@

navigate: $(VENV)/installed
	$(BIN)/mazeplan navigate --from ring1 --to ring5 $(ARGS)

picture: $(VENV)/installed
	@mkdir -p runs
	$(BIN)/mazeplan navigate --from ring1 --to ring5 --rig toy --log runs/first.mcap --force $(ARGS)
	$(BIN)/mazeplan map show --log runs/first.mcap -o runs/first.png --force

test: compiled check unit

test-all: compiled check all

check: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --threads $(JOBS)
	$(BIN)/lint-imports

# Tests start hundreds of programs. Where the environment forbids to write bytecode, each would compile the package anew,
# half a second every time.
unit all coverage compiled: export PYTHONDONTWRITEBYTECODE =

# one BLAS thread a worker: more of them fight over the same cores
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest

# the tests of a newcomer: those marked slow or realtime belong to `all`
unit: $(VENV)/installed-dev
	$(PYTEST) -n $(JOBS) --dist worksteal -m 'not realtime and not slow' $(ARGS)

# realtime tests go by the clock on the wall and run alone (status 5: the given ARGS select none of them)
all: $(VENV)/installed-dev
	@$(MAKE) --no-print-directory emulator || echo "without them the tests of the board are skipped"
	$(PYTEST) -n $(JOBS) --dist worksteal -m 'not realtime' $(ARGS)
	$(PYTEST) -m realtime $(ARGS) || [ $$? -eq 5 ]

# apart, as counting lines makes the tests half as long again
coverage: $(VENV)/installed-dev
	rm -f .coverage .coverage.*
	$(PYTEST) -n $(JOBS) --dist worksteal -m 'not realtime' --cov --cov-report=term --cov-fail-under=95 $(ARGS)

# Numba's share, two minutes on one core the first time, beside the checks, which need the other
compiled: $(VENV)/installed-dev
	@(for rig in toy ideal; do OMP_NUM_THREADS=1 $(BIN)/mazeplan navigate --rig $$rig; done > /dev/null 2>&1 &)

# warnings are errors: a link, a name or a picture that is not there
docs: $(VENV)/installed-docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "build/docs/index.html"

pictures: $(VENV)/installed
	@mkdir -p build
	$(BIN)/mazeplan navigate --rig toy --seed 3 --log build/run.mcap --force
	$(BIN)/mazeplan map show --labels --log build/run.mcap -o docs/run.png --force
	$(BIN)/mazeplan map show --labels --route -o docs/map.png --force
	$(BIN)/mazeplan navigate --map detour --start-angle 120 --seed 3 --log build/detour.mcap --force
	$(BIN)/mazeplan map show detour --labels --route --log build/detour.mcap -o docs/detour.png --force
	$(BIN)/python tools/draw_camera.py

bench: $(VENV)/installed
	OMP_NUM_THREADS=1 $(BIN)/python tools/bench.py $(ARGS)

constraints: $(VENV)/installed
	$(BIN)/python tools/pin.py > $(VENV)/constraints.txt
	mv $(VENV)/constraints.txt constraints.txt

pins: $(VENV)/installed-dev
	$(BIN)/python tools/check_pins.py

licences: $(VENV)/installed-dev
	$(BIN)/python tools/licences.py

# An environment of its own, and Numba's share in a place of its own: another version of Numba throws away what is
# compiled. Old packages beside new ones warn of each other, so warnings of what is deprecated are no errors here.
LOWEST := build/lowest
LOWEST_TESTS := tests/control tests/maze tests/behavior tests/logs tests/core tests/cli/test_main.py tests/test_contract.py \
  tests/learning/test_gp_training.py
lowest: $(VENV)/installed
	@mkdir -p build
	$(BIN)/python tools/lowest.py > $(LOWEST).txt
	[ -e $(LOWEST)/bin/python ] || $(PYTHON) -m venv $(LOWEST)
	$(LOWEST)/bin/python -m pip --disable-pip-version-check install --quiet -c $(LOWEST).txt -e '.[dev,learn]'
	NUMBA_CACHE_DIR=$(CURDIR)/build/lowest-numba OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= \
	  $(LOWEST)/bin/python -m pytest -n $(JOBS) --dist worksteal -W default::DeprecationWarning \
	  -m 'not realtime and not slow' $(LOWEST_TESTS) $(ARGS)

wheel: $(VENV)/installed-dev
	$(BIN)/python -m build --wheel

try-wheel: $(VENV)/installed-dev
	$(BIN)/python tools/try_wheel.py --python $(PYTHON)

# what they need is named in one line, and not each missing header in many
firmware:
	@command -v avr-gcc > /dev/null || { \
	  echo "the firmware needs, on Debian or Ubuntu: sudo apt-get install gcc-avr avr-libc" >&2; exit 1; }
	@$(MAKE) --no-print-directory -s -C tools/firmware OUT=$(CURDIR)/build/firmware

emulator:
	@missing=; command -v avr-gcc > /dev/null || missing="gcc-avr avr-libc"; \
	  [ -e /usr/include/simavr/sim_avr.h ] || missing="$$missing simavr libsimavr-dev"; \
	  [ -e /usr/include/libelf.h ] || missing="$$missing libelf-dev"; \
	  command -v $(CC) > /dev/null || missing="$$missing gcc libc6-dev"; \
	  [ -z "$$missing" ] || { echo "the emulator needs, on Debian or Ubuntu: sudo apt-get install $$missing" >&2; exit 1; }
	@$(MAKE) --no-print-directory -s -C tools/firmware OUT=$(CURDIR)/build/firmware
	@$(MAKE) --no-print-directory -s -C tools/emulator OUT=$(CURDIR)/build/emulator

# Numba compiles a function anew when its own file changes, but not when a function that it calls does.
forget:
	find mazeplan -name '*.nb[ci]' -delete

clean:
	rm -rf $(VENV) build dist htmlcov .coverage .coverage.* .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
