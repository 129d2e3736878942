#!/bin/sh
# Fill a folder with armd and everything it needs as wheels, to install from without a network.
#
#   deploy/wheelhouse.sh DIR                 for this machine's python3, or the one in $PYTHON
#   deploy/wheelhouse.sh --python 3.13 DIR   for another Python on the same kind of processor
set -eu

here=$(cd "$(dirname "$0")" && pwd)
pins=$here/../requirements.txt
python=${PYTHON:-python3}

fail() { printf 'armd: %s\n' "$*" >&2; exit 2; }

pip() { "$python" -I -m pip --quiet --disable-pip-version-check "$@"; }

own=$("$python" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])')
wanted=$own folder=''
while [ $# -gt 0 ]; do
    case $1 in
        --python) [ $# -gt 1 ] || fail "--python: found nothing, expected a version such as $own"
            wanted=$2; shift ;;
        -h | --help) sed -n '2,5s/^# \{0,1\}//p' "$0"; exit 0 ;;
        -*) fail "found $1, expected --python VERSION and a folder" ;;
        *) folder=$1 ;;
    esac
    shift
done
[ -n "$folder" ] || fail "found no folder to fill; see --help"
mkdir -p "$folder"
# From a copy: a build leaves files behind, which shall not lie in somebody's repository.
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
tar -C "$here/.." --exclude='./.*' --exclude=./build --exclude=./tests --exclude=./wheelhouse \
    -cf - . | tar -C "$copy" -xf -
rm -f "$folder"/armd-*.whl
# Its build puts the library of compiled functions into the wheel where there is a C++ compiler here:
# then a controller needs none. It is for one Python; without it a controller needs numba.
if [ "$wanted" = "$own" ]; then
    pip wheel --no-deps --wheel-dir "$folder" "$copy"
else
    ARMD_WITHOUT_LIBRARY=1 pip wheel --no-deps --wheel-dir "$folder" "$copy"
fi
# cobs comes as source alone. For another Python it is built without a compiler: that gives its
# version in pure Python, which runs on all of them.
if [ "$wanted" = "$own" ]; then
    pip wheel --no-deps --wheel-dir "$folder" --constraint "$pins" cobs
else
    CC=false pip wheel --no-deps --no-cache-dir --wheel-dir "$folder" --constraint "$pins" cobs
fi
set -- "$folder"/armd-*-none-any.whl
if [ ! -e "$1" ]; then set -- --no-deps --requirement "$here/controller.txt"; fi
pip download --dest "$folder" --find-links "$folder" --only-binary :all: --python-version "$wanted" \
    --constraint "$pins" "$@"
