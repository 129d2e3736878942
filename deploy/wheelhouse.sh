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
pip wheel --no-deps --wheel-dir "$folder" "$copy"
# With numba, setuptools and a C++ compiler here, the compiled functions go into the wheel, by this
# very source: then a controller needs no compiler. Without, it needs numba, an extra of armd.
extra='[offline]'
if [ "$wanted" = "$own" ]; then
    "$python" -I -m pip --quiet --disable-pip-version-check install --no-deps --target "$copy/as" \
        "$folder"/armd-*.whl
    if PYTHONPATH=$copy/as "$python" -m armd.daemon.ahead --into "$copy/armd"; then
        rm "$folder"/armd-*.whl
        pip wheel --no-deps --wheel-dir "$folder" "$copy"
        extra=''
    fi
    rm -rf "$copy/as"
fi
# cobs comes as source alone. For another Python it is built without a compiler: that gives its
# version in pure Python, which runs on all of them.
if [ "$wanted" = "$own" ]; then
    pip wheel --no-deps --wheel-dir "$folder" --constraint "$pins" cobs
else
    CC=false pip wheel --no-deps --no-cache-dir --wheel-dir "$folder" --constraint "$pins" cobs
fi
pip download --dest "$folder" --find-links "$folder" --only-binary :all: --python-version "$wanted" \
    --constraint "$pins" "$(echo "$folder"/armd-*.whl)$extra"
