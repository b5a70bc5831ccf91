"""Check a summary.json of `draco run` against what a run must reach. Exit 1 with one line a failure."""
import argparse
import json
import sys

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("summary")
parser.add_argument("--robots", type=int)
parser.add_argument("--merged", type=int)
parser.add_argument("--each-below-dead-reckoning", action="store_true")
parser.add_argument("--team-below", type=float, metavar="METRES")
parser.add_argument("--same-as", metavar="SUMMARY", help="equal but for the field 'timing'")
args = parser.parse_args()

with open(args.summary) as file:
    summary = json.load(file)
failures = []


def check(ok, message):
    if not ok:
        failures.append(message)


check(summary["schema"] == 1, "schema is not 1")
robots, team = summary["robots"], summary["team"]
if args.robots is not None:
    check(len(robots) == args.robots, f"{len(robots)} robots instead of {args.robots}")
if args.merged is not None:
    check(team["merged_robots"] == args.merged, f"{team['merged_robots']} merged robots instead of {args.merged}")
if args.each_below_dead_reckoning:
    for robot in robots:
        before, after = robot["ate_dead_reckoning_m"], robot["ate_m"]
        check(after < before, f"robot {robot['id']}: ATE {after} m is not below dead reckoning's {before} m")
if args.team_below is not None:
    check(team["ate_m"] < args.team_below, f"team ATE {team['ate_m']} m is not below {args.team_below} m")
if args.same_as is not None:
    with open(args.same_as) as file:
        other = json.load(file)
    summary.pop("timing")
    other.pop("timing")
    check(json.dumps(summary) == json.dumps(other), "two runs of the same command differ")

for failure in failures:
    print(f"{args.summary}: {failure}", file=sys.stderr)
print(f"{args.summary}: team ATE {team['ate_m']} m, {team['merged_robots']} merged, {len(failures)} failed checks")
sys.exit(1 if failures else 0)
