#!/bin/sh
# Runs a job with the command of Open Job Description on this machine: sh openjd.sh [JOB.json [TASKS AT ONCE]]
#
# gelato -submit writes the template, which a queue such as Deadline Cloud accepts as it is. On this machine the steps
# run one after the other. Each task is a run of its own, so that several run at once and one that fails is tried again.
set -e
template=$(gelato -submit openjd "${1:-job.json}")
openjd check "$template"
python3 - "$template" > out/steps <<'END'
import json, sys
for step in json.load(open(sys.argv[1]))["steps"]:
    task = step["parameterSpace"]["taskParameterDefinitions"][0]
    print(step["name"], task["range"].split("-")[1])
END
while read -r step last
do
    echo "step $step, tasks 0 to $last"
    seq 0 "$last" | xargs -P "${2:-2}" -I TASK sh -c '
        run() { openjd run "$1" --step "$2" -tp Task=TASK > "out/$2.TASK.log" 2>&1; }
        run "$1" "$2" || run "$1" "$2" || { tail "out/$2.TASK.log"; exit 1; }' run "$template" "$step"
done < out/steps
echo "all tasks are done"
