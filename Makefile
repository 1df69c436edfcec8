# lightpath. `make render` and `make test` work as the first and only command after `git clone`.

SCENE  ?= scenes/still-life.json
OUT    ?= out/$(basename $(notdir $(SCENE)))
PREFIX ?= /usr/local
ARGS   ?=
# Seconds for each study of `make report`.
REPORT_SECONDS ?= 40
# Folder of the Embree that `install` copies, if it exists.
EMBREE ?= vendor/embree

CARGO_TARGET_DIR ?= target
BINARY ?= $(CARGO_TARGET_DIR)/release/lightpath
# A program of the same version that runs here, for the man page and completions.
SPEAKER ?= $(BINARY)
# One profile for all targets, so that nothing is compiled twice.
FLAGS  := --locked --release
# A Python module takes its symbols from the Python that loads it. PyO3 would link it with a library
# that Debian's python3 does not bring.
export PYO3_BUILD_EXTENSION_MODULE := 1
# Where setup puts Rust when the system's own is too old.
export PATH := $(or $(CARGO_HOME),$(HOME)/.cargo)/bin:$(PATH)

.PHONY: help setup build render test python wheel bench report lint docs install uninstall dist portable clean

help: ## this list
	@echo 'make TARGET, where TARGET is'
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  \1	\2/p' Makefile | expand -t 12
	@echo 'Example: make render SCENE=scenes/spot.json ARGS="--spp 16"'

setup: ## install what is missing (Rust, a linker, Embree 4), with a reason for each
	@scripts/setup.sh

build: setup ## compile target/release/lightpath
	cargo build $(FLAGS)

render: build ## render SCENE (scenes/still-life.json) to OUT.exr and OUT.png (out/still-life)
	@mkdir -p $(dir $(OUT))
	$(BINARY) render $(SCENE) -o $(OUT) $(ARGS)

test: setup python ## all tests, Python's included
	@# One thread more than processors, as tests of farms wait.
	failed=0; \
	export RUST_TEST_THREADS=$${RUST_TEST_THREADS:-$$(($$(nproc) + 1))}; \
	RUSTC_WRAPPER='$(CURDIR)/scripts/rustc_of_tests.sh' \
	    cargo test $(FLAGS) --lib --test '*' --no-fail-fast $(ARGS) || failed=1; \
	cargo test $(FLAGS) --doc $(ARGS) || failed=1; \
	exit $$failed

python: setup ## the Python package and its tests, in a virtual environment under target/
	scripts/python.sh test

wheel: setup ## a wheel of the Python package in target/wheels/, tested in a fresh environment (MACHINE=aarch64: cross-built)
	scripts/python.sh wheel

bench: setup ## the benchmarks
	cargo bench --locked --benches $(ARGS)

report: build ## measure the shipped scenes: docs/reports/, README's numbers (some 4 minutes; REPORT_SECONDS=300 for longer)
	scripts/report.py --seconds $(REPORT_SECONDS) $(BINARY)

lint: ## format, clippy, the library without Embree, shell scripts: no warnings; all lock files up to date
	@scripts/setup.sh lint
	@for folder in fuzz benches/ply_readers benches/tinybvh; do \
	    cargo metadata --locked --format-version 1 --manifest-path $$folder/Cargo.toml >/dev/null || \
	        { echo "refresh it: cargo update --workspace --manifest-path $$folder/Cargo.toml"; exit 1; }; \
	done
	cargo fmt --all --check
	@for folder in fuzz benches/ply_readers benches/tinybvh; do \
	    cargo fmt --check --manifest-path $$folder/Cargo.toml || exit 1; \
	done
	cargo clippy $(FLAGS) --workspace --all-targets -- -D warnings
	@# The fuzz targets use the library without Embree. Clippy would check both a second time.
	CARGO_TERM_COLOR=never cargo check $(FLAGS) --manifest-path fuzz/Cargo.toml --target-dir $(CARGO_TARGET_DIR) 2>&1 | \
	    awk '{ print } /^(warning|error)/ { bad = 1 } /^ *Finished/ { done = 1 } END { exit bad || !done }'
	shellcheck scripts/*.sh farm/*.sh .ci/run .ci/beside

docs: setup ## the API documentation, no warnings
	RUSTDOCFLAGS='-D warnings' cargo doc $(FLAGS) --no-deps

# Not `install: build`, and no rule that builds: `sudo make install` must not compile as root.
install: ## copy program, Embree (if it is in vendor/), guide, examples, man page, completions to PREFIX
	@[ -x "$(BINARY)" ] || { echo 'found no $(BINARY): run `make build` first, or set BINARY=PROGRAM' >&2; exit 2; }
	BINARY="$(BINARY)" SPEAKER="$(SPEAKER)" EMBREE="$(EMBREE)" scripts/install.sh "$(DESTDIR)$(PREFIX)"

uninstall: ## remove the program, its folders, man page and completions from PREFIX
	set -e; for path in bin/lightpath lib/lightpath share/doc/lightpath share/lightpath share/man/man1/lightpath.1 \
	    share/bash-completion/completions/lightpath share/zsh/site-functions/_lightpath \
	    share/fish/vendor_completions.d/lightpath.fish; do rm -rf "$(DESTDIR)$(PREFIX)/$$path"; done

dist: build ## a .deb and a relocatable tarball in target/dist/
	scripts/dist.sh

portable: build ## static programs for x86-64 and aarch64, one for glibc 2.28, their SBOM and sums, in target/dist/
	scripts/portable.sh

clean: ## remove compiled and rendered files (not vendor/)
	cargo clean
	rm -rf out
