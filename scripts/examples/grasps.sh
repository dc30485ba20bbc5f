#!/bin/sh
# Grasps for a raw depth image from a policy server, with curl: POST /grasps.
#
#     graspbox serve-policy policies/depth
#     sh scripts/examples/grasps.sh depth.raw 480 640 615 615 320 240
#
# The file holds rows of little-endian uint16 millimetres; then rows, columns, and fx fy cx cy in pixels. GRASPBOX_URL
# names another server than http://127.0.0.1:8000, GRASPBOX_TOKEN its token. The answer is JSON; its entries are listed in
# graspbox.tools.remote.grasp_requests.
set -eu
if [ $# -ne 7 ]; then
    echo "usage: sh $0 FILE ROWS COLUMNS FX FY CX CY, such as depth.raw 480 640 615 615 320 240" >&2
    exit 2
fi
depth=$1 rows=$2 columns=$3 fx=$4 fy=$5 cx=$6 cy=$7

# printf is part of the shell, so that the length of its arguments has no limit.
printf '{"depth": {"data": "%s", "dtype": "<u2", "shape": [%d, %d]}, "intrinsics": [[%s, 0, %s], [0, %s, %s], [0, 0, 1]]}' \
    "$(base64 <"$depth" | tr -d '\n')" "$rows" "$columns" "$fx" "$cx" "$fy" "$cy" |
    curl --silent --show-error --fail-with-body --max-time 30 --data-binary @- \
        --header 'Content-Type: application/json' ${GRASPBOX_TOKEN:+--header "Authorization: Bearer $GRASPBOX_TOKEN"} \
        "${GRASPBOX_URL:-http://127.0.0.1:8000}/grasps"
