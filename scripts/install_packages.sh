#!/bin/sh
# Installs the Debian packages a list names and this machine lacks: as root or through sudo; else prints the one
# line that does it and exits 1. With everything present it touches neither apt nor the network.
missing=
for package in $(sed 's/#.*//' "$1"); do
    case $(dpkg-query -W -f='${Status}' "$package" 2>/dev/null) in
    *" ok installed") ;;
    *) missing="$missing $package" ;;
    esac
done
[ -n "$missing" ] || exit 0

install="apt-get install -y --no-install-recommends$missing"
if [ "$(id -u)" = 0 ]; then
    sudo=
elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || { [ -t 0 ] && sudo -v; }; }; then
    sudo=sudo
else
    echo "catnav needs packages that are not installed; as root, run:" >&2
    echo "apt-get update && $install" >&2
    exit 1
fi
echo "installing:$missing"
$sudo apt-get update -q && $sudo env DEBIAN_FRONTEND=noninteractive $install
