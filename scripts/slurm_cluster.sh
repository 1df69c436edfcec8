#!/bin/bash
# A Slurm cluster on this machine, for tests: real daemons on loopback, no systemd, no cgroups.
#
#   scripts/slurm_cluster.sh up [NODES] [CPUS]      start it (as root); 3 nodes of 2 CPUs by default
#   eval "$(scripts/slurm_cluster.sh env)"          SLURM_CONF for sbatch, squeue, scontrol
#   scripts/slurm_cluster.sh kill-node N            node and its tasks die at once: a power failure
#   scripts/slurm_cluster.sh kill-slurmd N          only its daemon dies; the tasks continue
#   scripts/slurm_cluster.sh start-node N           bring it back
#   scripts/slurm_cluster.sh wait [SECONDS]         wait until no job is left
#   scripts/slurm_cluster.sh down                   stop all that it started, remove its folder
#
# Needs Debian's slurmctld, slurmd, slurm-client and munge. State is in $SLURM_CLUSTER (required).
# Ports start at $SLURM_CLUSTER_PORT (16817). Every node is a PID namespace of its own.
set -euo pipefail

folder=${SLURM_CLUSTER:?names the folder for the state of the cluster}
port=${SLURM_CLUSTER_PORT:-16817}
export SLURM_CONF=$folder/slurm.conf

die() {
    echo "slurm_cluster: $*" >&2
    exit 1
}

alive() {
    [ -s "$1" ] && kill -0 "$(cat "$1")" 2>/dev/null
}

# stop PIDFILE SIGNAL: sends the signal, and SIGKILL after ten seconds if the process still runs.
stop() {
    if alive "$1"; then
        local pid
        pid=$(cat "$1")
        kill "-$2" "$pid" 2>/dev/null || true
        for _ in $(seq 100); do
            kill -0 "$pid" 2>/dev/null || break
            sleep 0.1
        done
        kill -KILL "$pid" 2>/dev/null || true
    fi
    rm -f "$1"
}

# The first process of a node's namespace, and the slurmd in it.
node_init() {
    pgrep -P "$(cat "$folder/n$1.pid")"
}
node_slurmd() {
    local namespace pid
    namespace=$(readlink "/proc/$(node_init "$1")/ns/pid")
    for pid in $(pgrep -x slurmd); do
        if [ "$(readlink "/proc/$pid/ns/pid" 2>/dev/null)" = "$namespace" ]; then
            echo "$pid"
        fi
    done
}

start_node() {
    mkdir -p "$folder/spool.n$1"
    if alive "$folder/n$1.pid"; then
        [ -z "$(node_slurmd "$1")" ] || return 0
        setsid nsenter -t "$(node_init "$1")" --pid --mount slurmd -D -N "n$1" -f "$SLURM_CONF" \
            </dev/null >>"$folder/n$1.out" 2>&1 &
        return 0
    fi
    # If slurmd dies, the second process keeps the namespace and its tasks alive.
    # shellcheck disable=SC2016
    setsid unshare --pid --fork --kill-child --mount-proc \
        bash -c 'slurmd -D -N "$1" -f "$2" & wait; while :; do sleep 3600 & wait; done' \
        _ "n$1" "$SLURM_CONF" </dev/null >>"$folder/n$1.out" 2>&1 &
    echo $! >"$folder/n$1.pid"
}

configure() {
    local nodes=$1 cpus=$2 n
    cat >"$SLURM_CONF" <<CONF
ClusterName=local
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
# A requeued job may start again after cred_expire seconds (default 120).
AuthInfo=socket=$folder/munge/socket,cred_expire=5
CredType=cred/munge
SlurmctldPort=$port
SlurmctldPidFile=$folder/slurmctld.pid
SlurmctldLogFile=$folder/slurmctld.log
StateSaveLocation=$folder/state
SlurmdPidFile=$folder/slurmd.%n.pid
SlurmdSpoolDir=$folder/spool.%n
SlurmdLogFile=$folder/slurmd.%n.log
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc=$folder/jobcomp.txt
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=2,bf_interval=2,batch_sched_delay=0,sched_min_interval=0
SlurmctldTimeout=10
SlurmdTimeout=6
InactiveLimit=0
KillWait=2
MinJobAge=300
ReturnToService=2
JobRequeue=1
RebootProgram=/bin/true
CONF
    for n in $(seq "$nodes"); do
        echo "NodeName=n$n NodeHostname=$(hostname -s) NodeAddr=127.0.0.1 Port=$((port + n)) CPUs=$cpus" \
            "RealMemory=2000 State=UNKNOWN" >>"$SLURM_CONF"
    done
    echo "PartitionName=local Nodes=n[1-$nodes] Default=YES MaxTime=INFINITE State=UP" >>"$SLURM_CONF"
}

up() {
    local nodes=${1:-3} cpus=${2:-2} n program
    [ "$(id -u)" = 0 ] || die "needs root"
    for program in munged slurmctld slurmd sbatch unshare nsenter; do
        command -v $program >/dev/null || die "there is no $program"
    done
    mkdir -p "$folder/munge" "$folder/state"
    chmod 755 "$folder" "$folder/munge"
    chmod 700 "$folder/state"
    if ! alive "$folder/munge/munged.pid"; then
        [ -s "$folder/munge/key" ] ||
            (umask 077 && dd if=/dev/urandom of="$folder/munge/key" bs=128 count=1 status=none)
        rm -f "$folder/munge/socket"
        munged --key-file="$folder/munge/key" --socket="$folder/munge/socket" \
            --pid-file="$folder/munge/munged.pid" --log-file="$folder/munge/log" \
            --seed-file="$folder/munge/seed"
    fi
    configure "$nodes" "$cpus"
    alive "$folder/slurmctld.pid" || slurmctld -f "$SLURM_CONF" >>"$folder/slurmctld.out" 2>&1
    for n in $(seq "$nodes"); do
        start_node "$n"
    done
    for _ in $(seq 150); do
        # Without it, each sinfo waits for seconds.
        [ ! -s "$folder/slurmctld.pid" ] || alive "$folder/slurmctld.pid" ||
            die "slurmctld has ended: see $folder/slurmctld.log"
        if [ "$(sinfo -h -t idle -o %D 2>/dev/null || echo 0)" = "$nodes" ]; then
            sinfo
            return 0
        fi
        sleep 0.2
    done
    sinfo || true
    die "the nodes do not come up: see the logs in $folder"
}

down() {
    local file
    [ ! -f "$SLURM_CONF" ] || scancel -u root 2>/dev/null || true
    for file in "$folder"/n*.pid; do
        [ ! -e "$file" ] || stop "$file" KILL
    done
    stop "$folder/slurmctld.pid" TERM
    stop "$folder/munge/munged.pid" TERM
    rm -rf "$folder"
}

wait_for_jobs() {
    for _ in $(seq $((2 * ${1:-300}))); do
        [ -n "$(squeue -h -o %i)" ] || return 0
        sleep 0.5
    done
    squeue
    die "jobs are left"
}

case ${1:-} in
    up) up "${@:2}" ;;
    env) echo "export SLURM_CONF=$SLURM_CONF" ;;
    kill-node)
        kill -KILL "$(cat "$folder/n${2:?number of a node}.pid")"
        rm -f "$folder/n$2.pid"
        ;;
    kill-slurmd)
        pid=$(node_slurmd "${2:?number of a node}")
        [ -n "$pid" ] || die "n$2 has no slurmd"
        kill -KILL "$pid"
        ;;
    start-node) start_node "${2:?number of a node}" ;;
    wait) wait_for_jobs "${2:-300}" ;;
    down) down ;;
    *)
        sed -n '2,14p' "$0"
        exit 2
        ;;
esac
