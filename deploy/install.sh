#!/bin/sh
# Install armd on an arm controller, from the folder this script stands in.
#
#   sudo deploy/install.sh                     from PyPI
#   sudo deploy/install.sh --wheelhouse DIR    without a network; DIR was filled elsewhere by
#                                              deploy/wheelhouse.sh
#   sudo deploy/install.sh --uninstall         removes it; configuration and recordings stay
#   sudo deploy/install.sh --uninstall --purge removes those too
#
# Running it again upgrades: what is there already is left or replaced, never doubled. The new one is
# built beside the old, which goes on running; if it cannot be built, or its service does not start,
# the old one stays. Where systemd is not running, as when an image is being made, it is only enabled
# and starts with the machine.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
venv=/opt/armd # a link to the one in use
a=$venv.a b=$venv.b
pins=$here/../requirements.txt
units=/usr/local/lib/systemd/system
rules=/usr/local/lib/udev/rules.d
networks=/usr/local/lib/systemd/network
users=/usr/local/lib/sysusers.d
bash=/usr/local/share/bash-completion/completions
zsh=/usr/local/share/zsh/site-functions
fish=/usr/local/share/fish/vendor_completions.d
man=/usr/local/share/man/man1

say() { printf 'armd: %s\n' "$*"; }
fail() { printf 'armd: %s\n' "$*" >&2; exit 2; }

usage() { sed -n '2,14s/^# \{0,1\}//p' "$0"; }

booted() { [ -d /run/systemd/system ]; }

running() {
    if booted; then
        systemctl list-units --plain --no-legend 'armd.service' 'armd@*.service' \
            'armd-bridge@*.service' | cut -d' ' -f1
    fi
}

reload() {
    if booted; then systemctl daemon-reload; fi
    if [ -S /run/udev/control ]; then udevadm control --reload; fi
    if booted; then # what is there already gets what the rules say now
        udevadm trigger --subsystem-match=tty --subsystem-match=usb-serial --action=add
        udevadm trigger --subsystem-match=misc --sysname-match=cpu_dma_latency --action=add
    fi
}

uninstall() {
    for unit in $(running); do systemctl stop "$unit"; done
    systemctl disable --quiet armd.service 2>/dev/null || true
    system_files | while read -r file; do rm -f "$file"; done
    rm -f /usr/local/bin/armd
    remove_folders "$venv/made"
    rm -rf "$venv" "$a" "$b" "$venv.before" /var/cache/armd \
        /var/cache/armd-bridge /var/cache/private/armd-bridge
    # Instances enabled by hand leave links that lead nowhere now.
    find /etc/systemd/system \( -name 'armd@*.service' -o -name 'armd-bridge@*.service' \) \
        -type l -delete
    reload
    awake=/dev/cpu_dma_latency # without its rule, udev leaves it as it is
    if [ -e $awake ]; then chown root:root $awake; chmod 600 $awake; fi
    systemctl reset-failed 'armd*' 2>/dev/null || true
    if [ "$purge" = yes ]; then
        rm -rf /etc/armd /var/lib/armd /var/lib/armd-bridge /var/lib/private/armd-bridge
        if getent passwd armd >/dev/null; then userdel armd; fi
        say "removed, with its configuration and recordings"
    else
        say "removed; /etc/armd and /var/lib/armd* stay (--purge takes them too)"
    fi
}

# -I: root runs nothing that lies in the present folder or that the environment names.
pip() { "$new/bin/python" -I -m pip --quiet --disable-pip-version-check "$@"; }

unfinished='' copy='' saved='' half_way=no
clean_up() {
    if [ $half_way = yes ]; then put_back; fi
    for folder in "$unfinished" "$copy" "$saved"; do rm -rf ${folder:+"$folder"}; done
}

build() {
    case $(readlink "$venv" || true) in
        "$a") new=$b ;;
        *) new=$a ;;
    esac
    unfinished=$new
    rm -rf "$new"
    "$python" -I -m venv "$new"
    if [ -n "$wheelhouse" ]; then
        # armd itself always anew: its version number need not have changed.
        pip install --no-index --find-links "$wheelhouse" --force-reinstall --no-deps armd
        # A wheel for any processor has no compiled functions in it: numba compiles them.
        set -- "$wheelhouse"/armd-*-none-any.whl
        if [ -e "$1" ]; then
            pip install --no-index --find-links "$wheelhouse" --constraint "$pins" armd
        else
            pip install --no-index --find-links "$wheelhouse" --constraint "$pins" --no-deps \
                --requirement "$here/controller.txt"
        fi
    else
        # From a copy: a build leaves files behind, which shall not lie in somebody's repository.
        copy=$(mktemp -d)
        tar -C "$here/.." --exclude='./.*' --exclude=./build -cf - . | tar -C "$copy" -xf -
        # Its build makes the library of compiled functions, where there is a C++ compiler: into the
        # environment, where the service can neither change nor lose it.
        pip install --constraint "$pins" "$copy"
    fi
    # What it would compile for root stays out of root's home.
    NUMBA_CACHE_DIR=$new/check "$new/bin/python" -I -m armd.daemon.start_check ||
        fail "$new: found commands that do not start; the old version stays"
    rm -rf "$new/help" && mkdir "$new/help"
    say_help armd completion bash
    say_help _armd completion zsh
    say_help armd.fish completion fish
    say_help armd.1 man
    rm -rf "$new/check"
}

# What a shell completes and `man armd` shows: written to the file $1. armd is as good without it.
say_help() {
    file=$new/help/$1
    shift
    if ! NUMBA_CACHE_DIR=$new/check "$new/bin/python" -I -m armd "$@" >"$file"; then
        say "armd $*: found an error; what it prints is not installed" >&2
        rm "$file"
    fi
}

# What is installed beside the program, and is put back with it.
system_files() {
    printf '%s\n' "$units/armd.service" "$units/armd@.service" "$units/armd-bridge@.service" \
        "$rules/70-armd.rules" "$rules/71-armd-awake.rules" "$networks/80-armd-can.network" \
        "$users/armd.conf" "$bash/armd" "$zsh/_armd" "$fish/armd.fish" "$man/armd.1" \
        "$units/armd.service.d/armd-compiles.conf" "$units/armd@.service.d/armd@-compiles.conf"
}

# Their folders that this machine has not got yet are ours to remove: noted beside the program.
note_folders() {
    if [ -e "$venv/made" ]; then cat "$venv/made"; fi
    system_files | while read -r file; do
        folder=${file%/*}
        while [ ! -d "$folder" ]; do echo "$folder"; folder=${folder%/*}; done
    done
}

remove_folders() {
    if [ -e "$1" ]; then
        sort -ru "$1" | while read -r folder; do # inner ones first
            rmdir "$folder" 2>/dev/null || true  # only if nobody else has anything there
        done
    fi
}

save() {
    note_folders >"$new/made"
    saved=$(mktemp -d) old=$(readlink "$venv" || true)
    system_files | while read -r file; do
        if [ -e "$file" ]; then cp -p "$file" "$saved/${file##*/}"; fi
    done
    half_way=yes
}

put_back() {
    system_files | while read -r file; do
        if [ -e "$saved/${file##*/}" ]; then
            mkdir -p "${file%/*}" # of a drop-in: it may have gone
            cp -p "$saved/${file##*/}" "$file"
        else
            rm -f "$file"
        fi
    done
    remove_folders "$new/made"
    half_way=no
    reload
}

point_to() { # in one step: there is always a program
    ln -sfn "$1" "$venv.link"
    if [ -d "$venv" ] && [ ! -L "$venv" ]; then # of before there was a link
        mv "$venv" "$venv.before"
        old=$venv.before
    fi
    mv -T "$venv.link" "$venv"
    mkdir -p /usr/local/bin
    ln -sfn "$venv/bin/armd" /usr/local/bin/armd
}

# The units forbid machine code that was written to memory; what numba compiles is such.
may_compile() {
    if "$new/bin/python" -I -c 'import importlib.util as i, sys; sys.exit(not i.find_spec("numba"))'
    then
        install -D -m 644 "$here/compiles.conf" "$units/armd.service.d/armd-compiles.conf"
        install -D -m 644 "$here/compiles.conf" "$units/armd@.service.d/armd@-compiles.conf"
    else
        rm -f "$units/armd.service.d/armd-compiles.conf" "$units/armd@.service.d/armd@-compiles.conf"
        rmdir "$units/armd.service.d" "$units/armd@.service.d" 2>/dev/null || true
    fi
}

install_system() {
    install -D -m 644 "$here/sysusers.conf" "$users/armd.conf"
    systemd-sysusers "$users/armd.conf"
    install -d -m 750 -o root -g armd /etc/armd
    install -D -m 644 "$here/armd.service" "$units/armd.service"
    install -D -m 644 "$here/armd@.service" "$units/armd@.service"
    install -D -m 644 "$here/armd-bridge@.service" "$units/armd-bridge@.service"
    install -D -m 644 "$here/udev/70-armd.rules" "$rules/70-armd.rules"
    install -D -m 644 "$here/udev/71-armd-awake.rules" "$rules/71-armd-awake.rules"
    install -D -m 644 "$here/network/80-armd-can.network" "$networks/80-armd-can.network"
    may_compile
    for file in "$bash/armd" "$zsh/_armd" "$fish/armd.fish" "$man/armd.1"; do
        if [ -e "$new/help/${file##*/}" ]; then
            install -D -m 644 "$new/help/${file##*/}" "$file"
        else
            rm -f "$file"
        fi
    done
    reload
    systemctl enable --quiet armd.service
}

# As the service's user, whose the cache is.
ahead() {
    CACHE_DIRECTORY=/var/cache/armd STATE_DIRECTORY=/var/lib/armd \
        setpriv --reuid=armd --regid=armd --clear-groups env -u NUMBA_CACHE_DIR \
        "$new/bin/python" -I -m armd.compiled.ahead "$@"
}

# For this processor and the arms that are configured, while the old one still runs: the first start
# then finds everything compiled.
compile_ahead() {
    install -d -m 750 -o armd -g armd /var/cache/armd
    set --
    for file in /etc/armd/armd.toml /etc/armd/*/armd.toml; do
        if [ -e "$file" ]; then set -- "$@" "$file"; fi
    done
    ahead "$@" || say "not compiled ahead: the first start takes longer"
}

roll_back() {
    say "the new one does not start; going back to the old one" >&2
    point_to "$old"
    put_back
    for unit in $1; do systemctl restart "$unit" || true; done
    fail "found a service that does not start ($2), expected it to; the old one runs again"
}

start() {
    if ! booted; then say "installed; it starts with the machine"; return; fi
    if [ ! -e /etc/armd/armd.toml ] && [ -z "$(running)" ]; then
        say "installed; describe the arm in /etc/armd/armd.toml, then: systemctl start armd"
        return
    fi
    active=$(running)
    for unit in $active armd.service; do
        if ! systemctl restart "$unit"; then
            if [ -n "$old" ] && [ -n "$active" ]; then roll_back "$active" "$unit"; fi
            fail "$unit: found a service that does not start; see: journalctl -u $unit"
        fi
    done
    say "installed and started; see: armd status"
}

wheelhouse='' action=install purge=no
while [ $# -gt 0 ]; do
    case $1 in
        --wheelhouse) [ $# -gt 1 ] || fail "--wheelhouse: found nothing, expected a folder"
            wheelhouse=$2; shift ;;
        --uninstall) action=uninstall ;;
        --purge) purge=yes ;;
        -h | --help) usage; exit 0 ;;
        *) usage >&2; fail "found $1, expected one of the options above" ;;
    esac
    shift
done
[ "$(id -u)" = 0 ] || fail "run it as root: it makes a user and installs a service"
command -v systemctl >/dev/null || fail "found no systemctl, expected a machine with systemd"
if [ "$action" = uninstall ]; then uninstall; exit; fi
[ -z "$wheelhouse" ] || [ -d "$wheelhouse" ] || fail "$wheelhouse: found no such folder"
python=${PYTHON:-python3}
"$python" -I -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
    fail "$python: expected Python 3.11 or newer with venv (Debian: apt install python3-venv)"
"$python" -I -c 'import sys; sys.exit(sys.base_prefix.startswith(("/home/", "/root/")))' ||
    fail "$python: found a Python in somebody's home, where the service sees nothing; expected" \
        "the system's: PYTHON=/usr/bin/python3 $0"
umask 022
trap clean_up EXIT
build
save
install_system
compile_ahead
point_to "$new"
half_way=no
start
ahead --tidy || true # the old one, had it come back, would have needed what it had compiled
unfinished=''
for spare in "$a" "$b" "$venv.before"; do
    if [ "$spare" != "$new" ]; then rm -rf "$spare"; fi
done
