#!/bin/bash
# A task of `lightpath submit slurm`: the frames FIRST to LAST of a batch, by the task's number.
#
#   sbatch --array=0-N slurm-frames.sh PROGRAM JOB FOLDER FRAMES FRAMES_PER_TASK
#
# `submit` puts the arguments, quoted, into a second line, `set -- PROGRAM ...`. No name is read as a command.
# A task may run twice, also at the same time. Every frame gets its name when it is complete, and
# --resume keeps those that are there. The processors of the task win over the limit of the job.
set -u
program=$1 job=$2 folder=$3 frames=$4 per_task=$5
first=$((SLURM_ARRAY_TASK_ID * per_task))
end=$((first + per_task < frames ? first + per_task : frames))
child=
trap 'if [ -n "$child" ]; then kill -TERM "$child"; fi' TERM USR1
"$program" batch "$job" -o "$folder" --range "$first..$end" --resume --progress plain \
    ${SLURM_CPUS_PER_TASK:+--threads "$SLURM_CPUS_PER_TASK"} &
child=$!
status=0
wait "$child" || status=$?
# A signal ends the first wait; the program then finishes what it must.
while kill -0 "$child" 2>/dev/null; do
    status=0
    wait "$child" || status=$?
done
case $status in
    # Some inputs are bad: another try would not help. The last job lists them and fails.
    1) exit 0 ;;
    # Disk full, out of memory, a signal, killed by the kernel for its memory: three more tries.
    3 | 129 | 130 | 131 | 137 | 143 | 152)
        if [ "${SLURM_RESTART_COUNT:-0}" -lt 3 ]; then
            scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" && sleep 60
        fi
        ;;
esac
exit "$status"
