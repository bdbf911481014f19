# `make demo` and `make test` need nothing but python3 (3.10 to 3.13) with pip and venv, git and make: ROS 2 comes from PyPI.

PYTHON ?= $(shell for candidate in python3 python3.12 python3.13 python3.11 python3.10; do \
	$$candidate -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null \
	&& echo $$candidate && break; done)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PEERS := .venv-peers
PEER_PYTHON ?= $(shell for candidate in python3.13 python3.12 python3; do \
	$$candidate -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && echo $$candidate && break; done)
CORE_TESTS := $(BIN)/python -m pytest --timeout 300 -n 2 --dist worksteal
LIVE_TESTS := $(BIN)/python -m pytest --timeout 300

# The environment is its own world: a sourced /opt/ros must not leak into it, and its nodes talk to this machine only.
unexport PYTHONPATH LD_LIBRARY_PATH RMW_IMPLEMENTATION COLCON_PREFIX_PATH CMAKE_PREFIX_PATH
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help environment benchmark demo docs floors fuzz test test-all lint types clean

help:
	@echo "make demo      render two cameras, calibrate them offline and live"
	@echo "make lint      ruff check, ruff format --check, mypy --strict"
	@echo "make test      lint, tests, colcon build"
	@echo "make test-all  the same with the slow tests"
	@echo "make docs      the documentation as pages, build/docs/index.html"
	@echo "make benchmark this beside OpenCV, mrcal and others, in an environment of its own (Python 3.12 or newer)"
	@echo "make floors    sdist and wheel in empty environments, with the lowest and the newest versions"
	@echo "make fuzz      changed inputs through every door, MINUTES=10"
	@echo "make clean     remove the environment and everything built"

environment: $(READY)

$(READY): setup.py setup.cfg package.xml
	@test -n "$(PYTHON)" || { echo "Python 3.10 to 3.13 is needed and none was found: install one and run make PYTHON=python3.X"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "$(PYTHON) has no venv: install it with 'sudo apt-get install python3-venv' and run make again"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV) (a few minutes the first time)"
	@$(BIN)/python -m pip install --quiet --editable '.[ros,test]'
	@touch $@

demo: $(READY)
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/fisheye_ep_calib demo

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs build/docs
	@echo "open build/docs/index.html"

# OpenCV's wheels share one folder: the one with contributed modules is put there last.
benchmark: $(PEERS)/.ready
	$(PEERS)/bin/python benchmarks/peers/accuracy.py
	$(PEERS)/bin/python benchmarks/peers/cost.py
	$(PEERS)/bin/python benchmarks/peers/detection.py

$(PEERS)/.ready: setup.py benchmarks/peers/requirements.txt
	@test -n "$(PEER_PYTHON)" || { echo "Python 3.12 or newer is needed for mrcal: run make benchmark PEER_PYTHON=python3.X"; exit 1; }
	@$(PEER_PYTHON) -m venv $(PEERS)
	@$(PEERS)/bin/python -m pip install --quiet --editable .
	@for package in $$(cat benchmarks/peers/requirements.txt); do \
		$(PEERS)/bin/python -m pip install --quiet --no-deps --force-reinstall $$package || echo "left out: $$package"; done
	@touch $@

$(VENV)/.docs: $(READY)
	@$(BIN)/python -m pip install --quiet --editable '.[docs]'
	@touch $@

lint: types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

test: lint
	$(CORE_TESTS) -m "not slow and not live"
	$(LIVE_TESTS) -m "live and not slow"

test-all: lint
	$(CORE_TESTS) -m "not live"
	$(LIVE_TESTS) -m "live"

# Changed inputs through every door, MINUTES=… of them; what fails is kept in .fuzz/.
fuzz: $(READY)
	$(BIN)/python test/fuzz/run.py $(or $(MINUTES),10)

# Interpreters that are not here are left out with a line.
floors:
	@PYTHON="$(PYTHON)" .ci/floors

clean:
	rm -rf $(VENV) $(PEERS) .colcon build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
