#!/bin/sh
# Makes the ghost atlas again, or goes on with it: two hours on one process.
#
# CONTIMPACT is the command to use, STORE the store, which is not committed.
set -eu
cd "$(dirname "$0")"
store=${STORE:-atlas.sqlite}
contimpact=${CONTIMPACT:-contimpact}
for study in A5 s05 A5_curves s05_curves A5_survey s05_survey A5_transitions; do
    $contimpact study "$study.toml" -o "$store"
done
$contimpact atlas "$store" -o maps --study A5-transitions --quantity bound --orbit 2:1
for kind in csv png; do
    mv "maps/A5-transitions-bound.$kind" "maps/A5-transitions-2_1-bound.$kind"
done
$contimpact atlas "$store" -o maps --study A5-transitions --quantity bound
$contimpact atlas "$store" -o maps --study A5-survey --study s05-survey --quantity bistability
$contimpact atlas "$store" -o maps --study A5 --study s05 --quantity ends --quantity distance \
    --quantity mechanism
$contimpact export "$store" -o tables --digits 12 --table scenes --table events \
    --table branches --table transitions --table curves --table codimension_two \
    --study A5 --study s05 --study A5-curves --study s05-curves --columns \
    scene,beta,r,status,event,branch,label,ghost,notation,word,becomes,value,stable,physical,criticality,origin,low,high,low_end,high_end,source,target,mechanism,grazing,doubling,fold,curve,kind,first,second,first_value,second_value,missed
$contimpact export "$store" -o tables --digits 12 --table intervals \
    --study A5-survey --study s05-survey --columns \
    scene,beta,r,branch,notation,low_derived,high_derived,low_end,high_end
$contimpact export "$store" -o tables --digits 9 --table attractors \
    --study A5-transitions --columns scene,beta,r,value,notation,word,period
python3 ../../tools/pack.py .
