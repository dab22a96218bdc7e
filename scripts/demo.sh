#!/bin/sh
# scripts/demo.sh CATNAV FOLDER: the demo scene run, its picture made, and what there is to look at named.
catnav=$1
out=$2
here=$(dirname "$0")
scene=$here/../launch/scenes/liver.yaml

mkdir -p "$out"
rm -rf "$out/frames" "$out/report.json" "$out/picture.png"
"$catnav" run "$scene" --report "$out/report.json" --frames "$out/frames"
status=$?

picture="/usr/bin/python3 $here/picture.py $scene $out"
if [ -e "$out/report.json" ]; then
    LIBGL_ALWAYS_SOFTWARE=1 xvfb-run -a -s '-screen 0 1280x1024x24' $picture || status=1
    /usr/bin/python3 - "$out/report.json" <<'PRINT'
import json, sys
verdict = json.load(open(sys.argv[1]))['verdict']
print(f"verdict: {verdict['code']}: {verdict['message']}")
PRINT
fi
for what in "report: report.json" "picture: picture.png" "frames (ParaView): frames/frames.pvd"; do
    [ -e "$out/${what##*: }" ] && echo "${what%: *}: $out/${what##*: }"
done

if [ -n "${DISPLAY:-}" ]; then
    bash -c '. "$0"/build/devel/setup.bash && roslaunch catnav demo.launch' "$(cd "$here/.." && pwd)"
fi
exit $status
