#!/usr/bin/env bash
# Newton 1.8.0, ModelBuilder.add_usd (Python 3.11): the target of a drive outside of its joint's limits becomes their middle.
#
# A spring with preload is a drive whose target stands outside of the limits, which UsdPhysics allows: at every position within
# them it pulls towards one end. Newton replaces such a target by the middle of the range, without a warning: the preload is gone,
# and the joint goes half way. A target within the limits is kept.
#
# Seen on 2026-11-29, for a joint with limits of 0 and 90 degrees:
#   target -100 degrees: 45.0
#   target 20 degrees: 20.0
#
# So write the nearest limit as the target, and the rest of the force, stiffness x distance / damping, as the target velocity, which
# add_usd(..., force_position_velocity_actuation=True) uses.
# Exit status: 0 while this is so, 1 if it has changed, 2 if an installation or the program failed, with its log. Needs Python 3.11
# and a package index; about 700 MB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d) || exit 2
trap 'rm -rf "$folder"' EXIT
failed() {
  cat "$folder/log" >&2
  echo "$1 failed, with the log above: it is not known whether this is so" >&2
  exit 2
}
python3.11 -m venv "$folder/venv" >"$folder/log" 2>&1 || failed "python3.11 -m venv"
"$folder/venv/bin/pip" install --quiet 'newton[importers]==1.8.0' >"$folder/log" 2>&1 || failed "pip install"
WARP_CACHE_PATH="$folder/cache" "$folder/venv/bin/python" - >"$folder/found" 2>"$folder/log" <<'PYTHON' || failed "the program"
import math
import warnings

import newton
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

warnings.simplefilter("error")


def read(target):
    """Return the target that Newton reads, degrees, or its warning."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    root = UsdGeom.Xform.Define(stage, "/hand").GetPrim()
    UsdPhysics.ArticulationRootAPI.Apply(root)
    for name in ("palm", "finger"):
        body = UsdGeom.Xform.Define(stage, f"/hand/{name}").GetPrim()
        UsdPhysics.RigidBodyAPI.Apply(body)
        UsdPhysics.MassAPI.Apply(body).CreateMassAttr(1.0)
    mount = UsdPhysics.FixedJoint.Define(stage, "/hand/mount")
    mount.CreateBody1Rel().SetTargets([Sdf.Path("/hand/palm")])
    joint = UsdPhysics.RevoluteJoint.Define(stage, "/hand/joint")
    joint.CreateBody0Rel().SetTargets([Sdf.Path("/hand/palm")])
    joint.CreateBody1Rel().SetTargets([Sdf.Path("/hand/finger")])
    joint.CreateLowerLimitAttr(0.0)
    joint.CreateUpperLimitAttr(90.0)
    drive = UsdPhysics.DriveAPI.Apply(joint.GetPrim(), "angular")
    drive.CreateStiffnessAttr(0.01)
    drive.CreateDampingAttr(0.001)
    drive.CreateTargetPositionAttr(target)
    builder = newton.ModelBuilder()
    try:
        builder.add_usd(stage)
    except Warning as warning:
        return f"warning: {warning}"
    index = next(i for i, label in enumerate(builder.joint_label) if label.endswith("joint"))
    return round(math.degrees(builder.joint_target_q[builder.joint_q_start[index]]), 3)


found = {target: read(target) for target in (-100, 20)}
print(f"newton {newton.__version__}, limits of 0 and 90 degrees")
for target, seen in found.items():
    print(f"target {target} degrees: {seen}")
PYTHON
sed -n '/^newton/,$p' "$folder/found"
wanted=$'target -100 degrees: 45.0\ntarget 20 degrees: 20.0'
[ "$(grep '^target' "$folder/found")" = "$wanted" ] || exit 1
