# On a fresh Debian with Rust: `make demo`, `make test`. What is missing is installed, as root or through sudo:
# libhdf5 and pkg-config to build, h5py to test.

SHELL := /bin/bash
STORE ?= store
JOBS ?= $(shell nproc)
export RUST_BACKTRACE ?= 1

# Where `make install` puts things. Packagers set DESTDIR.
PREFIX ?= /usr/local
PROGRAM ?= target/release/deaflow
BIN := $(DESTDIR)$(PREFIX)/bin
SHARE := $(DESTDIR)$(PREFIX)/share
BASH_FILE := $(SHARE)/bash-completion/completions/deaflow
ZSH_FILE := $(SHARE)/zsh/site-functions/_deaflow
FISH_FILE := $(SHARE)/fish/vendor_completions.d/deaflow.fish

.PHONY: help demo build wheel schema install uninstall test test-all check fmt clippy doc deny bench

help:
	@echo "make demo      run pipelines/quickstart.yaml; figures and artifacts go to $(STORE)/"
	@echo "make install   install the program, its manual pages and completions below $(PREFIX)"
	@echo "make uninstall remove them"
	@echo "make wheel     build the Python package, install it into a new environment and try it"
	@echo "make test      run the tests"
	@echo "make test-all  also let other programs read what is written: installs some 1.4 GB"
	@echo "make check     formatting, lints, documentation, dependencies, layering"
	@echo "make bench     time the solver"

demo: build
	./target/release/deaflow run pipelines/quickstart.yaml --store $(STORE) --jobs $(JOBS)

build:
	@.ci/install-missing build
	cargo build --release --locked --bin deaflow
	@$(MAKE) --no-print-directory schema

wheel:
	.ci/wheel

# Editors complete and check the files in pipelines/ by these schemas; the program prints them, so they are not in the repository.
schema:
	@mkdir -p pipelines/schema
	./target/release/deaflow schema > pipelines/schema/pipeline.json
	./target/release/deaflow schema scene > pipelines/schema/scene.json

# Root installs what somebody else has built: nothing is built anew here.
install: $(PROGRAM)
	install -D -m 755 $(PROGRAM) $(BIN)/deaflow
	mkdir -p $(SHARE)/man/man1 $(dir $(BASH_FILE)) $(dir $(ZSH_FILE)) $(dir $(FISH_FILE))
	$(BIN)/deaflow man $(SHARE)/man/man1
	$(BIN)/deaflow completions bash > $(BASH_FILE)
	$(BIN)/deaflow completions zsh > $(ZSH_FILE)
	$(BIN)/deaflow completions fish > $(FISH_FILE)

uninstall:
	rm -f $(BIN)/deaflow $(BASH_FILE) $(ZSH_FILE) $(FISH_FILE)
	rm -f $(SHARE)/man/man1/deaflow.1 $(SHARE)/man/man1/deaflow-*.1

target/release/deaflow:
	$(MAKE) build

test:
	@.ci/install-missing test
	cargo test --locked

test-all:
	@.ci/install-missing test-all
	DEAFLOW_READERS=all cargo test --locked

# All tests are built here: the library and its own tests are compiled side by side so, and not one after the other. Where
# RUSTC_WORKSPACE_WRAPPER is .ci/rustc, lints and documentation are checked by that build; benches are built for this.
WRAPPED := $(filter %.ci/rustc,$(RUSTC_WORKSPACE_WRAPPER))
check: fmt $(if $(WRAPPED),,clippy doc) deny
	@.ci/install-missing build
	cargo test --locked --no-run $(if $(WRAPPED),--all-targets)
	cargo test --locked --test it layering

fmt:
	cargo fmt --check

clippy:
	@.ci/install-missing build
	cargo clippy --locked --all-targets -- -D warnings

doc:
	@.ci/install-missing build
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items

# The installed cargo-deny if there is one; else it is built once into target/tools.
deny:
	@tool=$$(command -v cargo-deny || echo target/tools/bin/cargo-deny); \
	if [ ! -x "$$tool" ]; then env -u RUSTC_WORKSPACE_WRAPPER cargo install --locked --debug --no-default-features --version 0.20.2 --root target/tools cargo-deny; fi; \
	"$$tool" check licenses bans sources

bench:
	@.ci/install-missing build
	cargo bench --locked
