# Two commands, each from a fresh Debian-like machine with Rust:
#   make demo   set up, build, start a server, let a simulated robot map a room into it
#   make test   set up, build, test
# and for who changes the code:
#   make lint   format, clippy, docs, dependencies, spelling, the Python client, the files of deploy/

# Recorded scenes for the tests that want them; a test without its data says that it is skipped.
ORENX_TEST_DATA ?= ../shared/data
export ORENX_TEST_DATA := $(or $(realpath $(ORENX_TEST_DATA)),$(ORENX_TEST_DATA))

# One optimised profile for all, so that a fresh machine compiles the dependencies once.
CARGO_FLAGS := --release --locked

.PHONY: demo test lint setup setup-demo setup-test setup-lint
.DEFAULT_GOAL := demo

demo: setup-demo
	cargo run $(CARGO_FLAGS) -- demo --encoder static:target/encoders/static

# Where the encoders and the tools are that tests call. A test without these says that it is skipped.
test: export ORENX_TEST_ENCODERS := $(CURDIR)/target/encoders
test: export ORENX_TEST_TOOLS := $(CURDIR)/.venv/bin
# Mesa's layer that asks a display which GPU it is on: a test has none.
test: export NODEVICE_SELECT := 1
test: setup-test
	cargo test $(CARGO_FLAGS)
	ORENX_BIN=$(CURDIR)/target/release/orenx .venv/bin/python -m pytest -c clients/python/pyproject.toml \
		clients/python/tests deploy/tests

lint: setup-lint
	cargo fmt --check
	cargo clippy $(CARGO_FLAGS) --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc $(CARGO_FLAGS) --no-deps --document-private-items
	target/tools/bin/cargo-deny --locked check bans licenses sources
	.venv/bin/typos
	cd clients/python && ../../.venv/bin/ruff check . ../../deploy && ../../.venv/bin/ruff format --check . ../../deploy
	cd clients/python && ../../.venv/bin/mypy
	deploy/lint

setup:
	.ci/setup build

setup-demo:
	.ci/setup demo

setup-test:
	.ci/setup test

setup-lint:
	.ci/setup lint
