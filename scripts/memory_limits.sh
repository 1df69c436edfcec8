#!/bin/sh
# Renders a mesh in control groups with memory limits of many sizes. Each run must end with exit
# code 0 or 3; none may be killed.
# usage (root): scripts/memory_limits.sh LIGHTPATH MESH.ply [MIB...]
# Run it by hand before a release: CI has no control groups of its own.
set -eu
program=$1 mesh=$2
shift 2
[ $# -gt 0 ] || set -- 50 80 100 120 150 175 200 250 300 400 500 600 800
out=$(mktemp -d)
if [ -f /sys/fs/cgroup/cgroup.controllers ]; then
    group=/sys/fs/cgroup/lightpath limit=memory.max
    echo +memory > /sys/fs/cgroup/cgroup.subtree_control
else
    group=/sys/fs/cgroup/memory/lightpath limit=memory.limit_in_bytes
fi
mkdir -p "$group"
trap 'rm -rf "$out"; rmdir "$group"' EXIT
failed=0
for mib in "$@"; do
    echo $((mib << 20)) > "$group/$limit"
    for backend in bvh embree; do
        code=0
        sh -c 'echo $$ > "$0"; exec "$@"' "$group/cgroup.procs" "$program" render "$mesh" --backend "$backend" \
            --size 512x512 --spp 1 --quiet -o "$out/picture.exr" > /dev/null 2> "$out/said" || code=$?
        echo "$mib MiB, $backend: exit $code $(head -1 "$out/said")"
        case $code in 0 | 3) ;; *) failed=1 ;; esac
    done
done
exit $failed
