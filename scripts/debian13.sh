#!/usr/bin/env bash
# Tests the project in a Debian 13 root: the simulator must build, pass its tests and give the same points
# as on this machine, and the Python tests must pass with the wheel for Debian 13's Python:
#   sudo scripts/debian13.sh        (Debian 12 with debootstrap, after `make wheels`; 15 GB in build/roots)
# Runs ctest, pytest and `infrasim run`, with JOBS compilers at a time and FRAMES frames for each preset.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/roots.sh
work=build/debian13
root=build/roots/debian13
frames=${FRAMES:-20}
lidars=(configs/lidars/{livox_avia,helios_16,pandar_64,ruby_plus}.yaml)

# Runs a command in the root, in the copy of the source.
there() {
  inside $root /infrasim "$@"
}

copy_source() {
  mkdir -p $root/infrasim
  git ls-files -z --cached --others --exclude-standard | tar --null -T - -c | tar -x -C $root/infrasim
}

build_and_test() {
  there cmake -S . -B build/release -G Ninja -DCMAKE_BUILD_TYPE=Release -DINFRASIM_TESTS=ON \
    -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
  there cmake --build build/release -j "${JOBS:-1}"
  there ctest --test-dir build/release --output-on-failure --no-tests=error
}

# Simulates the same frames with both builds. Frames of earlier builds are removed first.
simulate() {
  local preset run
  rm -rf $root/infrasim/out $work/here
  for preset in paper datasheet; do
    run=(run configs/scenes/highway.yaml --lidar "${lidars[@]}" --preset "$preset"
      --frames "0:$frames" --fields --threads 1)
    there build/release/cpp/infrasim "${run[@]}" --out "out/$preset"
    .venv/bin/infrasim "${run[@]}" --out "$work/here/$preset"
  done
}

# Unpacks the wheel over the source, so that the source has the wheel's extension, binary and libraries.
python_tests() {
  .venv/bin/python -m zipfile -e dist/infrasim-*-cp313-*.whl $root/infrasim
  chmod +x $root/infrasim/pyinfra/bin/infrasim
  there ln -sfn ../../pyinfra/bin/infrasim .venv/bin/infrasim
  there .venv/bin/python -m pytest -n 2 --dist loadfile
}

make_root $root trixie
copy_source
there scripts/setup.sh build train exchange test
build_and_test
simulate
.venv/bin/python benchmarks/same_points.py $work/here $root/infrasim/out --out results/debian13.csv
python_tests
