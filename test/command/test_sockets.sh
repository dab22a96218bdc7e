#!/bin/bash
# The command and the node open no socket of their own (what ROS opens is in its libraries), and the command runs as an
# ordinary user; test_install.sh has the node do so.
catnav=$1
node=$(dirname "$catnav")/catnav_node
for program in "$catnav" "$node"; do
    calls=$(nm -D --undefined-only "$program" | grep -wE 'socket|socketpair|bind|listen|accept4?|connect|sendto|recvfrom|getaddrinfo')
    [ -z "$calls" ] || { echo "$program calls $calls"; exit 1; }
done
if [ "$(id -u)" = 0 ]; then
    folder=$(mktemp -d)
    chmod 755 "$folder"
    cp "$catnav" "$CATNAV_TEST_DATA/meshes/tetra.obj" "$folder"
    setpriv --reuid 65534 --regid 65534 --clear-groups "$folder/catnav" check "$folder/tetra.obj" > "$folder/said" 2>&1
    said=$?
    cat "$folder/said"
    rm -rf "$folder"
    [ $said = 0 ] || exit 1
fi
