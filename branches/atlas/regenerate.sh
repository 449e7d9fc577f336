#!/bin/sh
# Makes the ghost atlas again, or goes on with it: an hour on one process.
#
# CONTIMPACT is the command to use, STORE the store, which is not committed.
set -eu
cd "$(dirname "$0")"
store=${STORE:-atlas.sqlite}
for study in A5 s05 A5_curves s05_curves; do
    ${CONTIMPACT:-contimpact} study "$study.toml" -o "$store"
done
${CONTIMPACT:-contimpact} atlas "$store" -o maps --study A5 --study s05
${CONTIMPACT:-contimpact} export "$store" -o tables --format csv.gz --digits 12 --columns \
    scene,beta,r,status,event,branch,label,ghost,notation,word,becomes,value,stable,physical,criticality,origin,low,high,low_end,high_end,source,target,mechanism,grazing,doubling,fold,curve,kind,first,second,first_value,second_value,missed
