# The few commands worth remembering. Everything needs Rust (rust-toolchain.toml names the version), a linker (Debian:
# `gcc` and `libc6-dev`), Python 3 with pip, and a network the first time. No CMake, no clang.

CARGO ?= cargo
PROGRAM = $(CARGO) run --release --quiet --

.PHONY: demo test check bench gallery setup

## A sketch of the control-subspace curves of every task, from nothing: build, fetch physics and models, run.
demo: setup
	$(PROGRAM) csi --task all --budget quick

## All tests. Physics is fetched first, because the tests step it.
test: setup
	$(CARGO) test --release

## What has to be clean before a change is proposed.
check: test
	$(CARGO) fmt --check
	$(CARGO) clippy --release --all-targets -- -D warnings
	$(CARGO) bench -- --quick

## Throughput of policy, physics and analysis on this machine.
bench:
	$(CARGO) bench

## The gallery page, docs/gallery/README.md: the paper's printed figures, and runs that need nothing but `setup`.
gallery: setup
	rm -rf target/gallery
	$(PROGRAM) csi --data target/gallery --task myosuite_elbow_pose --out target/gallery
	$(PROGRAM) evaluate --data target/gallery --task myosuite_elbow_pose --episodes 20 --out target/gallery
	$(PROGRAM) figures fig3b fig3c --gallery --data target/gallery --runs target/gallery --out docs/gallery

setup:
	$(CARGO) build --release
	$(PROGRAM) setup
