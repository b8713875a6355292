# Everything a contributor runs. Each target installs what it needs into .venv, and nothing outside this folder.

.NOTPARALLEL:
.DEFAULT_GOAL := help

VENV := .venv/bin
# Processes that run the tests, more than cores because many tests wait for a wire; with 0 they run in the order of the files, in one process.
WORKERS ?= 5
# Tests of ROS 2 mostly wait, and run beside the others.
ROS2_WORKERS ?= 2
# Tests start hundreds of processes, each of which would compile all of SOTER anew.
unexport PYTHONDONTWRITEBYTECODE
# What `make conform` judges.
ADAPTERS ?= kinematic pybullet zenoh soter.adapters.zenoh.harness:RoutedHarness mavlink mavsdk $(addprefix soter.adapters.mavlink.harness:,PlainHarness CopterHarness MavsdkCopterHarness) \
	soter_zmq.harness:ZmqHarness soter_lcm.harness:LcmHarness soter.adapters.ros2.harness:Ros2Harness
PYTHON_FOLDERS = $(wildcard soter sim tests examples benchmarks tools)

.PHONY: help
help: ## Say what there is
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

.PHONY: demo
demo: ## Ten simulated minutes of the surveillance mission, a picture of them, and a page that plays them
	@tools/demo.sh

.PHONY: test
test: ## Every deterministic test; without PYTEST_ARGS those of ROS 2 too
	@tools/env.sh test
ifdef PYTEST_ARGS
	$(VENV)/python -m pytest -n $(WORKERS) --dist worksteal $(PYTEST_ARGS)
else
	@$(MAKE) --no-print-directory test-ros2 >.venv/ros2-tests.txt 2>&1 & ros2=$$!; \
	$(VENV)/python -m pytest -n $(WORKERS) --dist worksteal; failed=$$?; \
	wait $$ros2 || failed=$$?; cat .venv/ros2-tests.txt; exit $$failed
endif

.PHONY: test-ros2
test-ros2: ## The tests of ROS 2, over real DDS on this host, in an environment of their own
	@tools/env.sh ros2
	@if [ -e .venv-ros2/stamp-ros2 ]; then \
		.venv-ros2/bin/python -m pytest -n $(ROS2_WORKERS) --dist worksteal -m rclpy tests/adapters/ros2 tests/sim/ros2 tests/benchmarks; \
	fi

.PHONY: test-autopilot
test-autopilot: ## Real ArduPilots built for SITL: make test-autopilot ARDUROVER=/path/to/ardurover ARDUCOPTER=...
	@test -x "$(ARDUROVER)$(ARDUCOPTER)" -o -x "$(ARDUROVER)" -a -x "$(ARDUCOPTER)" || \
		{ echo "ARDUROVER is '$(ARDUROVER)' and ARDUCOPTER '$(ARDUCOPTER)', allowed: programs built for SITL, at least one"; exit 2; }
	@tools/env.sh test
	ARDUROVER="$(ARDUROVER)" ARDUCOPTER="$(ARDUCOPTER)" $(VENV)/python -m pytest -s tests/autopilot $(PYTEST_ARGS)

.PHONY: test-distributed
test-distributed: ## Cut a robot of a mission in three processes off for 30 s, in network namespaces if permitted
	@tools/env.sh test
	$(VENV)/python tools/distribution.py $(DISTRIBUTION_ARGS)

.PHONY: check
check: lint types wheel-check docs test ## Everything a change must pass: lint, types, wheel, site, tests (imports too)

.PHONY: browser-test
browser-test: ## Open pages of recordings and campaigns in Chromium, at four sizes: play, scrub, jump, what overlaps
	@tools/env.sh test
	$(VENV)/python -m pytest -n 2 --dist worksteal $(wildcard tests/*/test_*browser.py) $(PYTEST_ARGS)

.PHONY: conform
conform: ## The whole conformance kit on every adapter that is here, one after the other; two hours (ADAPTERS="zenoh mavlink")
	@tools/env.sh test
	@tools/env.sh ros2
	@mkdir -p runs/conform; failed=0; for name in $(ADAPTERS); do \
		case $$name in *ros2*) bin=.venv-ros2/bin ;; *) bin=$(VENV) ;; esac; \
		record=runs/conform/$${name##*:}; rm -f $$record.json; \
		PYTHONPATH=examples/adapter-zmq:examples/adapter-lcm $$bin/soter conform $$name --json $$record.json >$$record.txt || \
			{ failed=1; grep -A 1 ^FAIL $$record.txt; }; \
		echo "$$name: $$(tail -n 1 $$record.txt)"; \
	done; exit $$failed

.PHONY: accept
accept: ## The campaigns behind docs/{evaluation,adversaries,faults}.md, tuned missions, corridors and random ones, and `make conform`; hours
	@tools/env.sh test
	@for name in evaluation adversaries faults; do \
		$(VENV)/soter campaign examples/campaigns/$$name.toml $(ACCEPT_ARGS) || exit 1; \
		$(VENV)/soter campaign report runs/$$name.sqlite --into docs/$$name.md || exit 1; \
	done
	@for name in tuned corridors random; do \
		$(VENV)/soter campaign examples/campaigns/$$name.toml $(ACCEPT_ARGS) || exit 1; \
	done
	@$(MAKE) --no-print-directory conform

.PHONY: listings
listings: ## Run every command that the pages print, as printed; an hour (LISTINGS_ARGS="docs/report.md --limit 60")
	@tools/env.sh test
	$(VENV)/python -m tools.listings $(LISTINGS_ARGS)

.PHONY: bench
bench: ## What the stack costs, as ratios measured in one run each (benchmarks/README.md)
	@tools/env.sh test
	@for name in startup stack_cost real_time_factor decision worlds scaling machine recording isolation mavlink_throughput zenoh_latency campaign search; do \
		$(VENV)/python benchmarks/$$name.py $(BENCH_ARGS) || exit 1; \
	done

.PHONY: bench-peers
bench-peers: ## A decision beside those of two other libraries, in an environment of its own (1.2 GB)
	@tools/env.sh test
	@test -x .venv-peers/bin/python || $(VENV)/python -m venv .venv-peers
	@.venv-peers/bin/python -m pip --quiet --disable-pip-version-check install -r benchmarks/peers-requirements.txt
	@.venv-peers/bin/python -m pip --quiet --disable-pip-version-check install --no-deps --editable .
	.venv-peers/bin/python benchmarks/peers.py $(BENCH_ARGS)

.PHONY: bench-ros2
bench-ros2: ## What the ROS 2 adapter adds to a message, in the environment of ROS 2
	@tools/env.sh ros2
	.venv-ros2/bin/python benchmarks/ros2_latency.py $(BENCH_ARGS)

.PHONY: lint
lint: ## Style and formatting
	@tools/env.sh check
	$(VENV)/ruff check
	$(VENV)/ruff format --check

.PHONY: types
types: ## Static types, strict
	@tools/env.sh check
	$(VENV)/mypy $(PYTHON_FOLDERS)

.PHONY: docs-check
docs-check: ## Only the tests that run the code in README.md and docs/
	@tools/env.sh test
	$(VENV)/python -m pytest tests/project/test_docs.py

.PHONY: wheel-check
wheel-check: ## Build wheel and source distribution and try them in a clean environment
	@tools/env.sh check
	$(VENV)/python tools/dist.py

.PHONY: install-check
install-check: ## Have pip and apt resolve what the pages install (REALLY=1 installs it, gigabytes of it)
	@tools/env.sh check
	$(VENV)/python tools/install_lines.py $(if $(REALLY),--really)

.PHONY: dist
dist: install-check ## What is released, in dist/: wheel and source distribution, checked and tried
	$(VENV)/python tools/dist.py --into dist

.PHONY: docs
docs: ## The pages of docs/ as a site in site/, which needs no network: open site/index.html
	@tools/env.sh docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/mkdocs build --strict

.PHONY: changelog
changelog: ## Show what changes/ will say of the next release
	@tools/env.sh check
	$(VENV)/towncrier build --draft --version next

.PHONY: release
release: ## Set the version everywhere and move changes/ into CHANGELOG.md: make release VERSION=0.2.0
	@tools/env.sh check
	$(VENV)/python tools/release.py "$(VERSION)"

.PHONY: lock
lock: ## Write requirements/*.txt anew from pyproject.toml (UPGRADE=1 takes the newest versions)
	@tools/lock.sh

.PHONY: clean
clean: ## Remove .venv and everything that tools and runs left behind
	rm -rf .venv .venv-ros2 .venv-peers .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist install log out site
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
