#!/bin/bash
# Starts a Slurm of one machine and does to it what happens to clusters. Each line says how a run ended, whether its digests are those of a
# local run, and whether its store is sound. Needs root and: apt-get install slurm-wlm munge slurm-client. It writes /etc/slurm/slurm.conf.
#
#   tests/cluster.sh [target/release/deaflow]
set -u
deaflow=$(realpath "${1:-target/release/deaflow}")
here=$(realpath "$(dirname "$0")")
work=$(mktemp -d)
cd "$work" || exit 1

cat > p.yaml <<'END'
version: 1
name: cluster
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5.25 kV }
  effects: {}
stages:
  small:    { kind: sample, family: small-grid, count: 3000, seed: 1 }
  solved:   { kind: solve, needs: [small], elements_per_cell: 2 }
  balanced: { kind: balance, needs: [solved], bins: 20, range: [0 mm, 2.5 mm], target: 100, symmetry: d4, seed: 4 }
END
cat > cluster.yaml <<'END'
version: 1
executor: slurm
defaults: { workers: 2, threads: 1 }
END

up() {
    mkdir -p state spool /etc/slurm /run/munge
    sed "s#@HOST@#$(hostname)#; s#@DIR@#$work#; s#@ARRAY@#$1#" "$here/cluster/slurm.conf" > /etc/slurm/slurm.conf
    chown -R munge:munge /run/munge /var/log/munge /var/lib/munge 2>/dev/null
    chmod 755 /run/munge
    munge -n > /dev/null 2>&1 || su -s /bin/sh munge -c /usr/sbin/munged
    slurmctld -f /etc/slurm/slurm.conf && sleep 2
    slurmd -f /etc/slurm/slurm.conf -N "$(hostname)" && sleep 2
    scontrol update nodename="$(hostname)" state=resume > /dev/null 2>&1
    srun true
}
down() { pkill -x slurmd; pkill -x slurmctld; sleep 1; rm -rf state spool; }
trap 'pkill -f "$deaflow worker"; down; cd /; mountpoint -q "$work/full" && umount "$work/full"; rm -rf "$work"' EXIT

# A command and no function: what is killed is deaflow and no shell around it.
run=("$deaflow" run p.yaml --profile cluster.yaml --quiet --store)
exec 2>> said
bad=0
# None where there is no plan.
digests() { "$deaflow" plan p.yaml --store "$1" --json | grep -o '"digest": *"[0-9a-f]*"'; }
# Until so many records are there.
records() { while [ "$(find "$1/records" -type f 2>/dev/null | wc -l)" -lt "$2" ]; do sleep 0.1; done; }
arrays() { squeue --noheader --array --format=%j | sort -u; }
begin() { store=$1; start=$(date +%s.%N); }
# What became of a store: WORDS CODE
tell() {
    seconds=$(echo "$(date +%s.%N) - $start" | bc)
    same="digests differ"; [ -n "$wanted" ] && [ "$(digests "$store")" = "$wanted" ] && same="same digests"
    sound="not sound"; "$deaflow" fsck --store "$store" > /dev/null 2>&1 && sound="sound"
    if [ "$2" != 0 ] || [ "$same" != "same digests" ] || [ "$sound" != sound ]; then bad=1; fi
    printf '%-44s exit %s  %5.1f s  %s, %s\n' "$1" "$2" "$seconds" "$same" "$sound"
    while [ -n "$(squeue --noheader)" ]; do sleep 0.2; done
}

begin local; "$deaflow" run p.yaml --store local --quiet --jobs 2; code=$?
wanted=$(digests local)
tell "one process, two threads" $code
up 1001 || { echo "no Slurm"; exit 1; }

begin hand
for _ in 1 2; do "$deaflow" worker p.yaml --store hand --quiet --jobs 1 & done; wait
"$deaflow" run p.yaml --store hand --quiet; tell "two workers by hand" $?

begin calm; "${run[@]}" calm; tell "Slurm" $?

begin submitter; "${run[@]}" submitter & pid=$!; records submitter 20; kill -9 $pid; wait $pid 2>/dev/null
"${run[@]}" submitter; tell "submitter killed, another goes on" $?

begin worker; "${run[@]}" worker & pid=$!; records worker 20; pkill -9 -n -f "$deaflow worker"; wait $pid; tell "worker killed" $?

begin cancel; "${run[@]}" cancel & pid=$!; records cancel 20; scancel --me; wait $pid; tell "scancel of all" $?

begin two; "${run[@]}" two & pid=$!; "${run[@]}" two; code=$?; wait $pid; tell "two submitters" $code

begin stop; "${run[@]}" stop & pid=$!; records stop 20; kill -INT $pid; wait $pid; code=$?
while [ -n "$(squeue --noheader)" ]; do sleep 0.2; done
"${run[@]}" stop; tell "interrupt (exit $code), and again" $?

mkdir full; mount -t tmpfs -o size=3m tmpfs full
begin full/store; "${run[@]}" full/store; code=$?
mount -o remount,size=500m full
"${run[@]}" full/store; tell "disk full (exit $code), and enlarged" $?
umount full

begin node; "${run[@]}" node & pid=$!; records node 20
scontrol update nodename="$(hostname)" state=down reason=test; sleep 5
scontrol update nodename="$(hostname)" state=resume; wait $pid; tell "node lost and back" $?

down; up 1
begin array; "${run[@]}" array; tell "arrays of one task" $?
exit $bad
