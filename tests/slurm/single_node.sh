#!/bin/sh
# A SLURM of one node, this machine, for tests; needs root and Debian's slurm-wlm and munge.
#   single_node.sh start FOLDER     daemons with everything they write in FOLDER, which is empty and belongs to root
#   single_node.sh stop FOLDER
# Beside FOLDER it makes one link, /run/slurm/conf/slurm.conf, where SLURM looks last: Snakemake's executor takes
# SLURM_CONF away from its jobs. It refuses where there is a SLURM already.
set -eu
what=$1
folder=$2
export SLURM_CONF="$folder/slurm.conf"

link=/run/slurm/conf/slurm.conf

start() {
    if [ -e /etc/slurm/slurm.conf ] || [ -e "$link" ]; then
        echo "there is a SLURM on this machine already: /etc/slurm/slurm.conf or $link" >&2
        exit 1
    fi
    cores=$(nproc)
    memory=$(awk '/MemTotal/ { print int($2 / 1024 * 0.9) }' /proc/meminfo)
    chmod 755 "$folder"
    mkdir -p "$folder/munge" "$folder/state" "$folder/spool"
    dd if=/dev/urandom of="$folder/munge/key" bs=128 count=1 2>/dev/null
    chmod 400 "$folder/munge/key"
    cat > "$SLURM_CONF" <<END
ClusterName=labkit
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=${LABKIT_SLURM_PORT:-26817}
SlurmdPort=$((${LABKIT_SLURM_PORT:-26817} + 1))
AuthType=auth/munge
AuthInfo=socket=$folder/munge/socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=2
MinJobAge=3600
ReturnToService=2
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cores RealMemory=$memory State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
    mkdir -p "${link%/*}"
    ln -s "$SLURM_CONF" "$link"
    munged --force --socket="$folder/munge/socket" --key-file="$folder/munge/key" --pid-file="$folder/munge/pid" \
        --log-file="$folder/munge/log" --seed-file="$folder/munge/seed"
    slurmctld -f "$SLURM_CONF"
    slurmd -f "$SLURM_CONF"
    waited=0
    until sinfo -h -o %T 2>/dev/null | grep -q idle; do
        waited=$((waited + 1))
        if [ "$waited" -gt 60 ]; then
            echo "no node of this SLURM became idle; see $folder/*.log" >&2
            exit 1
        fi
        sleep 1
    done
}

stop() {
    [ "$(readlink "$link")" != "$SLURM_CONF" ] || rm "$link"
    for file in slurmd.pid slurmctld.pid munge/pid; do
        [ ! -s "$folder/$file" ] || kill "$(cat "$folder/$file")" 2>/dev/null || true
    done
}

case $what in
    start) start ;;
    stop) stop ;;
    *) echo "give start or stop and a folder" >&2; exit 2 ;;
esac
