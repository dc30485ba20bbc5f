#!/usr/bin/env bash
# Ruckig 0.19.4, Synchronization.Phase (Python 3.11): a motion from rest to rest leaves its straight line, and no result says so.
#
# Phase synchronization is the option for straight lines: all axes follow one profile. Ruckig takes the profile of the axis that needs
# the most time at its own limits. Where that profile, scaled, breaks a limit of another axis (here the first axis is held by its
# velocity, the second by its acceleration), it falls back to synchronizing the times alone. The result is Working, as for every motion, and the
# path is an arc: beside an obstacle, a robot on a line that was checked for collisions leaves that line by centimetres. A profile on
# the line exists: that of one axis whose limits are the least of limit / distance over all axes.
#
# Seen on 2026-11-30, for a motion of (1, 1) rad with limits of velocity (1, 2), acceleration (10, 4) and jerk (1000, 1000):
#   phase: Working, 1.110 s, 0.051 rad off the line
#   one axis along the line: Working, 1.254 s, 0.000 rad off the line
#
# So time a straight piece as one axis, its length, whose limits are the least of limit / share, and put the axes on the line.
# Exit status: 0 while this is so, 1 if it has changed, 2 if an installation or the program failed, with its log. Needs Python 3.11
# and a package index; about 30 MB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d) || exit 2
trap 'rm -rf "$folder"' EXIT
failed() {
  cat "$folder/log" >&2
  echo "$1 failed, with the log above: it is not known whether this is so" >&2
  exit 2
}
python3.11 -m venv "$folder/venv" >"$folder/log" 2>&1 || failed "python3.11 -m venv"
"$folder/venv/bin/pip" install --quiet 'ruckig==0.19.4' >"$folder/log" 2>&1 || failed "pip install"
"$folder/venv/bin/python" - >"$folder/found" 2>"$folder/log" <<'PYTHON' || failed "the program"
import math

import ruckig


def plan(goal, velocity, acceleration, jerk):
    """Return the result and the trajectory from rest at zero to rest at the goal."""
    wanted = ruckig.InputParameter(len(goal))
    wanted.target_position = goal
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = velocity, acceleration, jerk
    wanted.synchronization = ruckig.Synchronization.Phase
    found = ruckig.Trajectory(len(goal))
    return ruckig.Ruckig(len(goal)).calculate(wanted, found), found


def tell(name, result, duration, places):
    """Print how far places leave the line through (1, 1)."""
    off = max(abs(x - y) / math.sqrt(2.0) for x, y in places)
    print(f"{name}: {result.name}, {duration:.3f} s, {off:.3f} rad off the line")


velocity, acceleration, jerk = [1.0, 2.0], [10.0, 4.0], [1000.0, 1000.0]
result, found = plan([1.0, 1.0], velocity, acceleration, jerk)
times = [found.duration * step / 1000 for step in range(1001)]
tell("phase", result, found.duration, [found.at_time(time)[0] for time in times])
# Both axes move by 1, so that the limits of the length are the least ones.
result, found = plan([1.0], [min(velocity)], [min(acceleration)], [min(jerk)])
times = [found.duration * step / 1000 for step in range(1001)]
tell("one axis along the line", result, found.duration, [found.at_time(time)[0] * 2 for time in times])
PYTHON
cat "$folder/found"
wanted=$'phase: Working, 1.110 s, 0.051 rad off the line\none axis along the line: Working, 1.254 s, 0.000 rad off the line'
[ "$(cat "$folder/found")" = "$wanted" ] || exit 1
