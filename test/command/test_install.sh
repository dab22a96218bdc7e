#!/bin/bash
# An install space, moved to a folder of its own, runs by itself and as an ordinary user: its node, scripts, launch files and
# meshes give a verdict.
catnav=$1
build=$(cd "$(dirname "$catnav")/../../.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
DESTDIR=$folder cmake --install "$build" > "$folder/log" 2>&1 || { tail "$folder/log"; exit 1; }
cp "$(dirname "$0")"/../ros/tube.{yaml,obj} "$folder"
setup=$(find "$folder" -name setup.bash)
[ -n "$setup" ] || { echo "no setup.bash was installed"; exit 1; }

mkdir "$folder/ros"
ordinary=
if [ "$(id -u)" = 0 ]; then
    chown -R 65534:65534 "$folder"
    ordinary="setpriv --reuid 65534 --regid 65534 --clear-groups"
fi
# nothing of the build or of the caller's environment is to be had there
$ordinary env -i HOME="$folder" ROS_HOME="$folder/ros" PATH=/usr/bin:/bin ROS_HOSTNAME=localhost bash -c '
    . "$0" || exit 1
    [ "$(id -u)" != 0 ] || exit 1
    share=$(rospack find catnav) || exit 1
    case $share in "$1"/*) ;; *) echo "catnav is found in $share"; exit 1 ;; esac
    for program in catnav catnav_node; do
        if ldd "$share/../../lib/catnav/$program" | grep -E "not found|$2"; then exit 1; fi
    done
    "$share/../../lib/catnav/catnav" plan "$share/launch/scenes/snake.yaml" --out "$1/path.csv" || exit 1
    roslaunch --ros-args catnav demo.launch || exit 1
    # the port is any free one; call_plan.py ends the launch, as it is the only node that is not wanted for longer
    port=$(/usr/bin/python3 -c "import socket; s = socket.socket(); s.bind((\"localhost\", 0)); print(s.getsockname()[1])")
    export ROS_MASTER_URI=http://localhost:$port PYTHONUNBUFFERED=1
    roslaunch -p "$port" catnav demo.launch rviz:=false scene:="$1/tube.yaml" > "$1/said" 2>&1 &
    launch=$!
    for ((i = 0; i < 1200; i++)); do
        grep -aqE "call_plan.*(finished cleanly|has died)" "$1/said" && break
        kill -0 $launch 2> /dev/null || break
        sleep 0.1
    done
    kill -INT $launch 2> /dev/null
    wait $launch
    grep -aE "REACHED: every waypoint" "$1/said" || { cat "$1/said"; exit 1; }
' "$setup" "$folder" "$build"
