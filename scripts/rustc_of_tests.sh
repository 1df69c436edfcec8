#!/bin/sh
# Compiles tests without optimisation, and all else as told: `make test` calls it instead of rustc
# (RUSTC_WRAPPER). Optimising tests takes longer than they run. Integration tests test the library and
# the program as users have them; unit tests compile the library once more, not optimised.
for argument; do
    [ "$argument" != --test ] || exec "$@" -C opt-level=0 -C codegen-units=64 -C debug-assertions=on
done
exec "$@"
