#!/bin/bash
# The job after all tasks of `lightpath submit slurm`, however these ended: writes the contact
# sheet, lists the frames that are missing or could not be rendered again, with the reason, and
# fails if there are any.
#
#   sbatch --dependency=afterany:ARRAY slurm-sheet.sh PROGRAM JOB FOLDER
#
# `submit` puts the arguments, quoted, into a second line, `set -- PROGRAM ...`. No name is read as a command.
set -u
exec "$1" batch "$2" -o "$3" --sheet-only ${SLURM_CPUS_PER_TASK:+--threads "$SLURM_CPUS_PER_TASK"}
