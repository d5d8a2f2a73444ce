# Two commands set up everything on a fresh Debian with Rust: `make demo` and `make test`.
# The recipes install what is missing (libhdf5, pkg-config, h5py and jsonschema for tests), as root or through sudo,
# and onnxruntime, ezdxf, gerbonara and pyvista from PyPI (some 900 MB under target/), which tests can do without.

SHELL := /bin/bash
STORE ?= store
JOBS ?= $(shell nproc)
export RUST_BACKTRACE ?= 1

.PHONY: demo test check fmt clippy doc deny build bench setup setup-test clean-store help

help:
	@echo "make demo    run pipelines/quickstart.yaml; figures and artifacts go to $(STORE)/"
	@echo "make test    run all tests"
	@echo "make check   formatting, lints, documentation, dependencies, layering"
	@echo "make bench   time the solver"

demo: build
	./target/release/deaflow run pipelines/quickstart.yaml --store $(STORE) --jobs $(JOBS)

build: setup
	cargo build --release --locked

test: setup setup-test
	cargo test --locked

check: setup fmt clippy doc deny
	cargo test --locked --test it layering

fmt:
	cargo fmt --check

clippy: setup
	cargo clippy --locked --all-targets -- -D warnings

doc: setup
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items

# The installed cargo-deny if there is one; else it is built once into target/tools.
deny:
	@tool=$$(command -v cargo-deny || echo target/tools/bin/cargo-deny); \
	if [ ! -x "$$tool" ]; then cargo install --locked --debug --no-default-features --version 0.20.2 --root target/tools cargo-deny; fi; \
	"$$tool" check licenses bans sources

bench: setup
	cargo bench --locked

setup:
	@.ci/install-missing build

setup-test:
	@.ci/install-missing test
