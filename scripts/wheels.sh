#!/usr/bin/env bash
# Makes a wheel for each Python, and tests it in a minimal Debian root with this Python:
#   sudo scripts/wheels.sh        (Debian 12 with debootstrap, after `make wheel`; 2 GB in build/roots)
# The binary in the root must write the same bytes as the build of this machine, and so must the bindings.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/roots.sh
roots=build/roots
wheels=dist
run=(run configs/scenes/highway.yaml --lidar configs/lidars/{livox_avia,helios_16,pandar_64,ruby_plus}.yaml
  --frames "0:${FRAMES:-20}" --fields --threads 1)

# Prints a command that runs Debian 13's Python 3.13 outside its root, with the libraries of the root. It
# builds with the compiler and the libraries of this machine. This compiler does not search the folder in
# which Debian has pyconfig.h, so the file is copied.
python_of_trixie() {
  local root python
  root=$(realpath $roots/headers)
  python=$root/usr/bin/python3.13-outside
  if [[ ! -e $python ]]; then
    cp "$root"/usr/include/{x86_64-linux-gnu/,}python3.13/pyconfig.h
    printf '#!/bin/sh\nexec %s --library-path %s --argv0 "$0" %s "$@"\n' \
      "$root/lib64/ld-linux-x86-64.so.2" "$root/usr/lib/x86_64-linux-gnu" "$root/usr/bin/python3.13" >"$python"
    chmod +x "$python"
  fi
  echo "$python"
}

wheel_of_trixie() {
  rm -rf build/wheel/raw313
  .venv/bin/python -m pip --python "$(python_of_trixie)" wheel -qq . --no-deps -w build/wheel/raw313 \
    --build-constraint scripts/constraints.txt
  .venv/bin/python scripts/bundle.py build/wheel/raw313/*.whl $wheels
}

# try_wheel SUITE TAG: installs the wheel with this tag in a new environment of the root, and tests it.
try_wheel() {
  local root=$roots/$1
  make_root "$root" "$1" python3 python3-venv
  rm -rf "$root/try"
  mkdir "$root/try"
  cp -r $wheels/infrasim-*-"$2"-*.whl configs scripts/same_frames.py "$root/try"
  inside "$root" /try python3 -m venv env
  inside "$root" /try bash -c 'env/bin/pip install -qq infrasim-*.whl'
  inside "$root" /try env/bin/infrasim "${run[@]}" --out data
  diff -r --exclude summary.csv $roots/here "$root/try/data"
  inside "$root" /try env/bin/python same_frames.py configs data
}

make_root $roots/headers trixie python3 libpython3.13-dev
wheel_of_trixie
rm -rf $roots/here
.venv/bin/infrasim "${run[@]}" --out $roots/here
try_wheel bookworm cp311
try_wheel trixie cp313
ls -l $wheels/*.whl
