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

## The gallery page, docs/gallery/README.md: the paper's printed figures, and those of the policies that come with the program.
FINGERS = hand_index_reach hand_middle_reach hand_ring_reach hand_little_reach hand_thumb_reach
HERE = --data target/gallery --out target/gallery
BOTH = --recording "mini=$$(echo target/gallery/mini/*)" "Its teachers=$$(echo target/gallery/teachers/*)" --episodes 20
PAPER = fig3b_radar fig3c_bars fig4a_smoothness fig4fgh_dimensionality fig6cd_tasks fig6ef_policies
gallery: setup
	rm -rf target/gallery
	$(PROGRAM) csi --task all --budget quick --policy mini $(HERE)
	$(PROGRAM) evaluate --task all --policy mini --episodes 20 $(HERE)
	$(PROGRAM) rollout --task $(FINGERS) baoding_p1_ccw --policy mini --episodes 20 --data target/gallery --out target/gallery/mini
	$(PROGRAM) rollout --task $(FINGERS) --policy expert:mini --episodes 20 --data target/gallery --out target/gallery/teachers
	$(PROGRAM) smoothness $(BOTH) --task $(FINGERS) $(HERE)
	$(PROGRAM) kinematics $(BOTH) $(HERE)
	$(PROGRAM) subspaces $(BOTH) --task $(FINGERS) $(HERE)
	$(PROGRAM) figures $(PAPER) --gallery --data target/gallery --runs target/gallery --out docs/gallery

setup:
	$(CARGO) build --release
	$(PROGRAM) setup
