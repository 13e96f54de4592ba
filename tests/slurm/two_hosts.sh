#!/bin/sh
# Two hosts on this computer, for tests: network namespaces nodea and nodeb, joined by a cable; needs root and iproute2.
#   two_hosts.sh start | stop FOLDER
#   two_hosts.sh slurm FOLDER                SLURM on both, Debian's slurm-wlm and munge, with all its files in FOLDER
#   two_hosts.sh on [-x] HOST COMMAND...     runs a command on a host, as ssh does
set -eu
what=$1
shift

start() {
    for name in nodea nodeb; do
        ip netns add "$name"
        ip -n "$name" link set lo up
        mkdir -p "/etc/netns/$name"
        printf '127.0.0.1 localhost\n10.77.0.1 nodea\n10.77.0.2 nodeb\n' > "/etc/netns/$name/hosts"
    done
    ip -n nodea link add cable netns nodea type veth peer name cable netns nodeb
    ip -n nodea addr add 10.77.0.1/24 dev cable
    ip -n nodeb addr add 10.77.0.2/24 dev cable
    ip -n nodea link set cable up
    ip -n nodeb link set cable up
}

slurm() {
    folder=$1
    chmod 755 "$folder"
    mkdir -p "$folder/munge" "$folder/state" "$folder/nodea" "$folder/nodeb"
    dd if=/dev/urandom of="$folder/munge/key" bs=128 count=1 2>/dev/null
    chmod 400 "$folder/munge/key"
    cat > "$folder/slurm.conf" <<END
ClusterName=labkit
SlurmctldHost=nodea
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge/socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/%n.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=pmi2
SelectType=select/linear
NodeName=nodea,nodeb CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
    echo CgroupPlugin=cgroup/v1 > "$folder/cgroup.conf"  # a namespace sees no cgroups to detect
    export SLURM_CONF="$folder/slurm.conf"
    munged --force --socket="$folder/munge/socket" --key-file="$folder/munge/key" --pid-file="$folder/munge/pid" \
        --log-file="$folder/munge/log" --seed-file="$folder/munge/seed"
    on nodea slurmctld
    on nodea slurmd -N nodea
    on nodeb slurmd -N nodeb
    waited=0
    until [ "$(on nodea sinfo -h -N -o %T 2>/dev/null | grep -c idle)" = 2 ]; do
        waited=$((waited + 1))
        if [ "$waited" -gt 120 ]; then
            echo "the nodes of this SLURM did not become idle; see $folder/*.log" >&2
            exit 1
        fi
        sleep 1
    done
}

stop() {
    [ ! -s "$1/munge/pid" ] || kill "$(cat "$1/munge/pid")" 2>/dev/null || true
    for name in nodea nodeb; do
        ip netns pids "$name" 2>/dev/null | xargs -r kill -9 2>/dev/null || true
        ip netns del "$name" 2>/dev/null || true
        rm -rf "/etc/netns/$name"
    done
}

on() {
    [ "$1" != -x ] || shift
    host=$1
    shift
    ip netns exec "$host" unshare --uts sh -c "hostname $host; exec $*"
}

case $what in
    start) start ;;
    slurm) slurm "$1" ;;
    stop) stop "$1" ;;
    on) on "$@" ;;
    *) echo "give start, stop, or on and a host" >&2; exit 2 ;;
esac
