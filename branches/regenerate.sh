#!/bin/sh
# Makes again what is committed of the scenes named, or of all of them but the atlas, which takes
# an hour:
#
#     sh branches/regenerate.sh fig7 fig8
#
# CONTIMPACT is the command to use, for example CONTIMPACT="nice python -m contimpact". Tables are
# compressed and pictures reduced at the end; pictures that no page shows are removed.
set -eu
cd "$(dirname "$0")"
[ $# -gt 0 ] || set -- */scene.toml
for folder; do
    name=${folder%/scene.toml}
    name=${name%/}
    if [ "$name" = atlas ]; then
        sh atlas/regenerate.sh
        continue
    fi
    ${CONTIMPACT:-contimpact} run "$name/scene.toml" -o "$name"
    if grep -q '^\[simulate\]' "$name/scene.toml"; then
        ${CONTIMPACT:-contimpact} simulate "$name/scene.toml" -o "$name/simulation"
    fi
done
python3 ../tools/pack.py "$@"
