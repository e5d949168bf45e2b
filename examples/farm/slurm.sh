#!/bin/sh
# Runs a job on a cluster of Slurm, and waits for its end: sh slurm.sh [JOB.json]
#
# gelato -submit writes a batch script for each step and submits it. The last step waits for those before it, and so do
# we, by a job that depends on all of them.
set -e
job=${1:-job.json}
gelato -submit slurm "$job" > out/submitted
cat out/submitted
ids=$(cut -d ' ' -f 2 out/submitted | paste -sd :)
srun --quiet --dependency="afterany:$ids" --ntasks 1 true
# A task with errors has another exit status than 0.
failed=$(scontrol show job --oneliner | awk -v ids=":$ids:" '
    { split($0, words, " "); id = state = ""
      for (i in words) {
          if (words[i] ~ /^ArrayJobId=/) id = substr(words[i], 12)
          if (words[i] ~ /^JobId=/ && id == "") id = substr(words[i], 7)
          if (words[i] ~ /^JobState=/) state = substr(words[i], 10)
      }
      if (index(ids, ":" id ":") && state != "COMPLETED") failed++ }
    END { print failed + 0 }')
echo "$failed tasks failed"
test "$failed" -eq 0
