#!/bin/sh
# Makes .venv and installs the project into it; returns at once where that is done already.
# With an argument, such as test, that extra, too; without one, what running needs.
# PYTHON=... names the interpreter. Needs no root. Every failure is one line on stderr.
set -eu
cd "$(dirname "$0")/.."

say() { printf '%s\n' "$*"; }
fail() {
    printf 'setup: %s\n' "$*" >&2
    exit 1
}

new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null </dev/null; }

# What the environment was made from. It differs when it has to be made or brought up to date:
# other requirements, a checkout that was moved (an environment cannot be), another Python.
fingerprint() {
    cat pyproject.toml constraints.txt | cksum
    pwd -P
    .venv/bin/python -c 'import sys; print(sys.version)'
}

extra=${1:-}
run=.venv/.installed-from # what running needs is there
stamp=$run${extra:+-$extra}
busy=.venv/.installing # there while an install runs; left behind by one that was cut short

done_already() { [ -f "$stamp" ] && [ "$(fingerprint 2>/dev/null)" = "$(cat "$stamp")" ]; } # an extra brings all of it

if done_already; then exit 0; fi

# One set-up at a time: `make demo` and `make test` may be started side by side.
(: >>.setup.lock) 2>/dev/null || fail "cannot write to $(pwd): check its permissions and the free space"
exec 9>>.setup.lock
if command -v flock >/dev/null 2>&1; then
    flock -n 9 || {
        say "setup: another set-up of this checkout is running; waiting for it"
        flock 9
    }
    if done_already; then exit 0; fi
fi

usable=no
if [ -x .venv/bin/python ] && [ ! -e "$busy" ] && new_enough .venv/bin/python &&
    .venv/bin/python -m pip --version >/dev/null 2>&1 </dev/null; then
    usable=yes
    # Scripts in an environment hold its absolute path.
    if [ -f "$run" ] && [ "$(sed -n 2p "$run")" != "$(pwd -P)" ]; then usable=no; fi
fi

if [ "$usable" = no ]; then
    if [ -n "${PYTHON:-}" ]; then
        command -v "$PYTHON" >/dev/null 2>&1 || fail "PYTHON=$PYTHON: no such program"
        new_enough "$PYTHON" || fail "PYTHON=$PYTHON is not a Python 3.11 or newer"
        python=$PYTHON
    else
        python=
        for candidate in python3 python3.13 python3.12 python3.11 python3.14 python; do
            if command -v "$candidate" >/dev/null 2>&1 && new_enough "$candidate"; then
                python=$candidate
                break
            fi
        done
        [ -n "$python" ] || fail "no Python 3.11 or newer found: install python3 (Debian, Ubuntu: apt-get install python3 python3-venv), or name one with PYTHON=/path/to/python3.12"
    fi
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    "$python" -c 'import ensurepip, venv' 2>/dev/null </dev/null || {
        case $("$python" -c 'import os, sys; print(os.path.realpath(sys.executable))') in
        "$(readlink -f "$(command -v python3)" 2>/dev/null)") package=python3-venv ;;
        *) package=python$version-venv ;;
        esac
        fail "$python (Python $version) lacks the venv module: install $package (Debian, Ubuntu: apt-get install $package)"
    }
    say "setup: making .venv with Python $version"
    log=$("$python" -m venv --clear .venv 2>&1) || fail "$python -m venv .venv failed: $log"
fi

: >"$busy" 2>/dev/null || fail "cannot write to .venv: check its permissions and the free space"
size="1.4 GB on disk"
[ -z "$extra" ] || size="2.6 GB on disk"
say "setup: installing the project ${extra:+with the extra $extra }into .venv: $size, one to five minutes the first time"
.venv/bin/python -m pip install --quiet --no-input --disable-pip-version-check \
    -c constraints.txt -e ".${extra:+[$extra]}" </dev/null ||
    fail "pip could not install the requirements (its message is above); the same command tries again from a clean .venv"
fingerprint >"$run"
[ -z "$extra" ] || fingerprint >"$stamp"
rm -f "$busy"
say "setup: done"
