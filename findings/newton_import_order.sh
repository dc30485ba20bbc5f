#!/usr/bin/env bash
# Newton 1.8.0, ModelBuilder.add_usd (Python 3.11): couplings of joints are lost if a stage was opened before Newton was imported.
#
# Newton registers the schema NewtonMimicAPI when it is imported, and USD reads its registry at its first stage. A program that
# opens a stage with pxr before it imports Newton gets a model without the coupling, and without a warning. PhysxMimicJointAPI on
# the same joint does not help: it is skipped where NewtonMimicAPI is written. Alone it is read in both orders.
#
# Seen on 2026-11-29, joints that follow another one:
#   newton first, NewtonMimicAPI: 1
#   stage first, NewtonMimicAPI: 0
#   stage first, both schemas: 0
#   stage first, PhysxMimicJointAPI: 1
#
# So import newton at the top of the program, before anything uses pxr.
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
cat >"$folder/follow.py" <<'PYTHON'
import sys

order, schemas = sys.argv[1], sys.argv[2].split(",")
if order == "newton":
    import newton
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

stage = Usd.Stage.CreateInMemory()
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
UsdPhysics.ArticulationRootAPI.Apply(UsdGeom.Xform.Define(stage, "/hand").GetPrim())
for name in ("palm", "left", "right"):
    body = UsdGeom.Xform.Define(stage, f"/hand/{name}").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(body)
    UsdPhysics.MassAPI.Apply(body).CreateMassAttr(1.0)
UsdPhysics.FixedJoint.Define(stage, "/hand/mount").CreateBody1Rel().SetTargets([Sdf.Path("/hand/palm")])
for name in ("left", "right"):
    joint = UsdPhysics.RevoluteJoint.Define(stage, f"/hand/{name}_joint")
    joint.CreateBody0Rel().SetTargets([Sdf.Path("/hand/palm")])
    joint.CreateBody1Rel().SetTargets([Sdf.Path(f"/hand/{name}")])
    joint.CreateLowerLimitAttr(0.0)
    joint.CreateUpperLimitAttr(90.0)
follower, leader = stage.GetPrimAtPath("/hand/right_joint"), [Sdf.Path("/hand/left_joint")]
if "NewtonMimicAPI" in schemas:
    follower.AddAppliedSchema("NewtonMimicAPI")
    follower.CreateRelationship("newton:mimicJoint", custom=False).SetTargets(leader)
if "PhysxMimicJointAPI" in schemas:
    follower.AddAppliedSchema("PhysxMimicJointAPI:rotX")
    follower.CreateRelationship("physxMimicJoint:rotX:referenceJoint", custom=False).SetTargets(leader)
    follower.CreateAttribute("physxMimicJoint:rotX:gearing", Sdf.ValueTypeNames.Float, custom=False).Set(-1.0)
if order == "stage":
    import newton
builder = newton.ModelBuilder()
builder.add_usd(stage)
print(sum(leader >= 0 for leader in builder.joint_mimic_joint))
PYTHON
"$folder/venv/bin/pip" show newton usd-core newton-usd-schemas >"$folder/packages" 2>"$folder/log" || failed "pip show"
grep -E '^(Name|Version)' "$folder/packages" | paste -sd ' '
status=0
while read -r order schemas wanted; do
  found=$(WARP_CACHE_PATH="$folder/cache" "$folder/venv/bin/python" "$folder/follow.py" "$order" "$schemas" 2>"$folder/log" | tail -1) ||
    failed "the program ($order first, $schemas)"
  echo "$order first, $schemas: $found"
  [ "$found" = "$wanted" ] || status=1
done <<'CASES'
newton NewtonMimicAPI 1
stage NewtonMimicAPI 0
stage NewtonMimicAPI,PhysxMimicJointAPI 0
stage PhysxMimicJointAPI 1
CASES
exit $status
