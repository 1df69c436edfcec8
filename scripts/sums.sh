#!/bin/sh
# Writes SHA256SUMS of the files of one version in a folder: sums.sh FOLDER VERSION
set -eu
cd "$1"
sums=$(find . -maxdepth 1 -type f -name "lightpath[-_]$2*" -printf '%P\n' | LC_ALL=C sort | xargs -d '\n' sha256sum --)
printf '%s\n' "$sums" | tee SHA256SUMS
