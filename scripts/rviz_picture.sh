#!/bin/bash
# scripts/rviz_picture.sh OUT.png [SCENE] [VIEW]: a scene as rviz shows it, without a display; SCENE as demo.launch takes
# it, by default the demo's, VIEW by default its own of launch/rviz, else the demo's. Run where build/devel/setup.bash
# has been sourced. The picture is taken two seconds after the plan has ended.
set -u
out=$(realpath "$1")
scene=${2:-liver}
view=${3:-$scene}
[ -e "$(dirname "$0")/../launch/rviz/$view.rviz" ] || view=demo
log=$(mktemp)
export out scene view log LIBGL_ALWAYS_SOFTWARE=1 ROS_HOSTNAME=localhost
export ROS_MASTER_URI=http://localhost:$((12000 + $$ % 2000))

xvfb-run -a -s '-screen 0 1200x900x24' bash -c '
    roslaunch -p "${ROS_MASTER_URI##*:}" catnav demo.launch scene:="$scene" view:="$view" > "$log" 2>&1 &
    launch=$!
    until grep -q "call_plan.*finished cleanly\|call_plan.*has died" "$log" || ! kill -0 $launch 2>/dev/null; do
        sleep 0.5
    done
    sleep 2
    import -window root "$out"
    kill -INT $launch
    wait $launch'
grep -a "steps, .* replans" "$log" | tail -1
rm -f "$log"
[ -s "$out" ]
