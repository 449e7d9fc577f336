#!/bin/sh
# Makes again what is committed of the scenes named, or of all of them:
#
#     sh branches/regenerate.sh fig7 fig8
#
# CONTIMPACT is the command to use, for example CONTIMPACT="nice python -m contimpact".
set -eu
cd "$(dirname "$0")"
[ $# -gt 0 ] || set -- */
for folder; do
    name=${folder%/}
    ${CONTIMPACT:-contimpact} run "$name/scene.toml" -o "$name"
    if grep -q '^\[simulate\]' "$name/scene.toml"; then
        ${CONTIMPACT:-contimpact} simulate "$name/scene.toml" -o "$name/simulation"
    fi
done
