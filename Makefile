# Two commands, each from a fresh Debian-like machine with Rust:
#   make demo   set up, build, start a server, let a simulated robot map a room into it
#   make test   set up, build, test
# and for who changes the code:
#   make lint   format, clippy, docs, dependencies, spelling; types and style of the dashboard and of the
#               Python client; the files of deploy/
#   make web    the dashboard alone: `cargo build` takes it in
#   make fuzz   inputs that might break the readers of what comes from outside (tests/fuzz/README.md):
#               FUZZ_SECONDS, 300 by default, for each of nine targets

# Recorded scenes for the tests that want them; a test without its data says that it is skipped.
ORENX_TEST_DATA ?= ../shared/data
export ORENX_TEST_DATA := $(or $(realpath $(ORENX_TEST_DATA)),$(ORENX_TEST_DATA))

# One optimised profile for all, so that a fresh machine compiles the dependencies once.
CARGO_FLAGS := --release --locked

# The dashboard, and what it is made of.
WEB := clients/web
WEB_PAGE := $(WEB)/dist/index.html
WEB_SOURCES := $(shell find $(WEB)/src $(WEB)/build -type f) $(WEB)/index.html $(WEB)/vite.config.ts \
	$(WEB)/tsconfig.json $(WEB)/package.json $(WEB)/package-lock.json

.PHONY: demo test lint web fuzz setup setup-demo setup-test setup-lint setup-fuzz
.DEFAULT_GOAL := demo

demo: setup-demo $(WEB_PAGE)
	cargo run $(CARGO_FLAGS) -- demo --encoder static:target/encoders/static

# Where the encoders and the tools are that tests call. A test without these says that it is skipped.
test: export ORENX_TEST_ENCODERS := $(CURDIR)/target/encoders
test: export ORENX_TEST_TOOLS := $(CURDIR)/.venv/bin
# Mesa's layer that asks a display which GPU it is on: a test has none.
test: export NODEVICE_SELECT := 1
test: export ORENX_TEST_BROWSER := $(shell command -v chromium || echo /usr/bin/chromium)
test: setup-test $(WEB_PAGE)
	cd $(WEB) && npm test
	cargo test $(CARGO_FLAGS)
	ORENX_BIN=$(CURDIR)/target/release/orenx .venv/bin/python -m pytest -c clients/python/pyproject.toml \
		clients/python/tests deploy/tests

lint: setup-lint $(WEB_PAGE)
	cd $(WEB) && npm run check && npm run lint
	cargo fmt --check
	cargo fmt --check --manifest-path tests/fuzz/Cargo.toml
	cargo clippy $(CARGO_FLAGS) --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc $(CARGO_FLAGS) --no-deps --document-private-items
	target/tools/bin/cargo-deny --locked check bans licenses sources
	.venv/bin/typos
	cd clients/python && ../../.venv/bin/ruff check . ../../deploy && ../../.venv/bin/ruff format --check . ../../deploy
	cd clients/python && ../../.venv/bin/mypy
	deploy/lint

web: setup $(WEB_PAGE)

fuzz: setup-fuzz $(WEB_PAGE)
	tests/fuzz/run

# Tools come first, where they are not there yet.
$(WEB_PAGE): $(WEB_SOURCES) $(WEB)/node_modules/.package-lock.json
	cd $(WEB) && npm run build

$(WEB)/node_modules/.package-lock.json: $(WEB)/package-lock.json
	cd $(WEB) && npm ci --ignore-scripts && touch node_modules/.package-lock.json

setup:
	.ci/setup build

setup-demo:
	.ci/setup demo

setup-test:
	.ci/setup test

setup-lint:
	.ci/setup lint

setup-fuzz:
	.ci/setup fuzz
