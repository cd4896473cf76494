# The commands of this project; each installs what it needs. `make` lists them.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

JOBS ?= $(shell nproc)
HOST := build/host
AGENT := firmware/agent/linux/ivfm-agent
# Arguments for the program that a target runs, e.g. make demo ARGS="--robots 3".
ARGS ?=

.PHONY: help
help: ## This list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

.PHONY: deps
deps: ## Install the Debian packages that are missing
	@toolchains/install-dependencies.sh

.PHONY: build
build: deps ## Configure and build everything for this machine
	@[[ -f $(HOST)/build.ninja ]] || cmake --preset host
	@cmake --build --preset host -j $(JOBS)

.PHONY: demo
demo: build ## Two robots explore a real building's corridor, all in software
	@$(HOST)/host/cli/ivfm demo --out out/demo $(ARGS)

.PHONY: test
test: build cross-replay ## Build everything, replay a recorded drive on two robots, run every test
	@ctest --preset host -j $(JOBS) $(ARGS)
	@tests/fuzz/run.sh 45
	@tests/replay/compare_targets.sh

.PHONY: bench
bench: build ## Measure the parts of a decision against MRPT, and decisions a second
	@for bench in $$(find $(HOST) -name '*_bench' -type f | sort); do \
	  echo "== $${bench##*/}"; $$bench $(ARGS); \
	done

.PHONY: fuzz
fuzz: deps ## Fuzz every decoder of bytes from outside, SECONDS_EACH=60
	@tests/fuzz/run.sh $(or $(SECONDS_EACH),60)

.PHONY: soak
soak: build ## 1,000 schedules of radio faults and kills, a million hostile datagrams, a day of traffic
	@IVFM_ATTACKS=1000000 $(HOST)/tests/nobody_in/nobody_in_test --gtest_brief=1
	@$(HOST)/tests/nothing_lost/nothing_lost_soak $(ARGS)
	@$(HOST)/tests/nothing_lost/memory_soak

.PHONY: hil
hil: deps ## Hardware in the loop: the packed robot on an emulated machine; faults and reaction times
	@[[ -f $(HOST)/build.ninja ]] || cmake --preset host >/dev/null
	@cmake --build --preset host -j $(JOBS) --target machine_simulator compare_maps ivfm
	@for preset in aarch64 x86_64; do \
	  toolchains/fetch_libsodium.sh $$preset; \
	  cmake --preset $$preset >/dev/null; \
	  cmake --build --preset $$preset -j $(JOBS) --target ivfm-agent can_bridge; \
	  packaging/pack.sh $$preset build/$$preset/$(AGENT) build/packages; \
	done
	@hil/run.py $(ARGS)

.PHONY: cross
cross: deps ## Build, test and pack the robot for aarch64, armhf, x86-64; build it for Cortex-M7
	@for preset in aarch64 armhf x86_64 cortex-m7; do \
	  toolchains/fetch_libsodium.sh $$preset; \
	  cmake --preset $$preset; \
	  cmake --build --preset $$preset -j $(JOBS); \
	done
	@for preset in aarch64 armhf; do ctest --preset $$preset -j $(JOBS); done
	@for preset in aarch64 armhf x86_64; do \
	  packaging/pack.sh $$preset build/$$preset/$(AGENT) build/packages; \
	  packaging/check_reproducible.sh $$preset build/packages; \
	done
	@lintian --fail-on error,warning build/packages/*.deb
	@for preset in aarch64 armhf; do \
	  cmake --build --preset $$preset --target agent_memory_table; \
	done

# The recorded drive must give the same bits on every processor.
.PHONY: cross-replay
cross-replay: deps
	@for preset in aarch64 armhf; do \
	  [[ -f build/$$preset/build.ninja ]] || cmake --preset $$preset; \
	  cmake --build --preset $$preset -j $(JOBS) --target replay_golden_test; \
	  qemu-$${preset/hf/}-static build/$$preset/tests/replay/replay_golden_test --gtest_brief=1; \
	done

.PHONY: train
train: build ## Train a policy and quantize it (hours; ARGS="--help" lists the options)
	@$(HOST)/host/trainer/ivfm-train --config host/trainer/recipes/default.toml --out out/train $(ARGS)

.PHONY: paper
paper: build ## Judge every policy as the paper does; writes docs/results.md (hours; goes on when stopped)
	@$(HOST)/host/cli/ivfm eval --paper --resume out/paper/episodes.csv --markdown docs/results.md \
	  --commit "$$(git describe --always --dirty)" $(ARGS)

.PHONY: format
format: deps ## Format every C++ source
	@toolchains/format.sh

.PHONY: lint
lint: build ## Check format and clang-tidy on what changed since origin/main; ARGS=--all for all
	@toolchains/format.sh --check
	@toolchains/lint.sh $(HOST) $(ARGS)

.PHONY: clean
clean: ## Remove what was built and written
	@rm -rf build out
