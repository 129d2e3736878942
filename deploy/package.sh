#!/bin/sh
# Make a Debian package that carries armd and all it needs, and installs it by install.sh.
#
#   deploy/package.sh DIR                 for this machine's python3, or the one in $PYTHON
#   deploy/package.sh --python 3.13 DIR   for a Debian with another Python
#
# Prints the package's path: DIR/armd_VERSION_ARCHITECTURE.deb
set -eu

here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}

fail() { printf 'armd: %s\n' "$*" >&2; exit 2; }

wanted=$("$python" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])') folder=''
while [ $# -gt 0 ]; do
    case $1 in
        --python) [ $# -gt 1 ] || fail "--python: found nothing, expected a version such as $wanted"
            wanted=$2; shift ;;
        -h | --help) sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 0 ;;
        -*) fail "found $1, expected --python VERSION and a folder" ;;
        *) folder=$1 ;;
    esac
    shift
done
[ -n "$folder" ] || fail "found no folder for the package; see --help"
command -v dpkg-deb >/dev/null || fail "found no dpkg-deb, expected a Debian"
umask 022
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
chmod 755 "$tree"
install -d "$tree/DEBIAN" "$tree/usr/lib/armd/wheelhouse"
cp -R "$here" "$here/../requirements.txt" "$tree/usr/lib/armd/"
for name in client debian packaging package.sh wheelhouse.sh; do
    rm -r "$tree/usr/lib/armd/deploy/$name"
done
"$here/wheelhouse.sh" --python "$wanted" "$tree/usr/lib/armd/wheelhouse"
# Of a version in the making, the tilde sorts before the release.
version=$(ls "$tree/usr/lib/armd/wheelhouse" | sed -n 's/^armd-\([^-]*\)-.*/\1/p' | sed 's/\.dev/~dev/')
architecture=$(dpkg --print-architecture)
install -m 755 "$here/debian/postinst" "$here/debian/prerm" "$here/debian/postrm" "$tree/DEBIAN"
cat >"$tree/DEBIAN/control" <<END
Package: armd
Version: $version
Architecture: $architecture
Maintainer: the armd project <armd@localhost>
Section: science
Priority: optional
Depends: python3 (>= $wanted), python3 (<< ${wanted%.*}.$((${wanted#*.} + 1))), python3-venv, systemd, udev
Installed-Size: $(du -sk "$tree/usr" | cut -f1)
Description: driver of articulated measuring arms
 Encoders and temperatures in, corrected probe points out, as a guarded service. Carries everything
 it needs as Python wheels and installs them under /opt/armd.
END
mkdir -p "$folder"
package=$folder/armd_${version}_$architecture.deb
# Wheels are compressed already.
dpkg-deb --root-owner-group -Znone --build "$tree" "$package.part" >/dev/null
mv "$package.part" "$package"
echo "$package"
