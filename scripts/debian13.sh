#!/usr/bin/env bash
# Proves that the simulator builds, passes its tests and gives the same points on Debian 13 as here, and
# that the Python tests pass there with the wheel of its Python:
#   sudo scripts/debian13.sh        (Debian 12 with debootstrap, after `make wheels`; 15 GB in build/roots)
# Runs ctest, pytest and `infrasim run` in a Debian 13 root; JOBS compilers at a time, FRAMES frames a preset.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/roots.sh
work=build/debian13
root=build/roots/debian13
frames=${FRAMES:-20}
lidars=(configs/lidars/{livox_avia,helios_16,pandar_64,ruby_plus}.yaml)

# In the root, in the copy of the source.
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

# The same frames by both; the folders must not hold those of an earlier build.
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

# The wheel's files over those of the source: its extension, its binary and their libraries.
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
