#!/bin/sh
# Times public finite-element codes and ours on the same patterns, one core, one run: benches/peers/run.sh [WORKDIR]
#
# scikit-fem comes from PyPI into a virtual environment. DOLFINx comes from Debian's packages into a Debian root of its
# own (debootstrap; needs root and about 2 GB), because they bring another HDF5 that would get in the way of building
# deaflow. Where that is not possible DOLFINx is left out, and the output says so.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
work=${1:-${TMPDIR:-/tmp}/deaflow-peers}
mkdir -p "$work"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1

[ -x "$work/venv/bin/python" ] || python3 -m venv "$work/venv"
"$work/venv/bin/python" -c 'import skfem' 2>/dev/null || "$work/venv/bin/pip" install -q scikit-fem
"$work/venv/bin/python" "$here/membrane.py" "$work/patterns.npy" 4

root="$work/debian"
if [ "$(id -u)" = 0 ] && [ ! -e "$root/.ready" ]; then
    command -v debootstrap >/dev/null || apt-get install -y -q debootstrap
    [ -e "$root/etc/apt/sources.list" ] || debootstrap --variant=minbase bookworm "$root" http://deb.debian.org/debian
    chroot "$root" sh -c 'DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends python3-dolfinx-real'
    touch "$root/.ready"
fi

(cd "$here" && cargo bench -q --bench peers -- "$work/patterns.npy") >"$work/results.jsonl"
if [ -e "$root/.ready" ]; then
    mkdir -p "$root/peers"
    cp "$here/membrane.py" "$here/dolfinx_peer.py" "$work/patterns.npy" "$root/peers/"
    chroot "$root" env HOME=/root OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONPATH=/peers \
        python3 /peers/dolfinx_peer.py /peers/patterns.npy >>"$work/results.jsonl"
else
    echo "DOLFINx is left out: it needs root and debootstrap" >&2
fi
"$work/venv/bin/python" "$here/scikit_fem.py" "$work/patterns.npy" >>"$work/results.jsonl"
"$work/venv/bin/python" "$here/compare.py" <"$work/results.jsonl"
