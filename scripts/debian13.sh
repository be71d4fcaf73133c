#!/usr/bin/env bash
# Proves that the simulator builds, passes its tests and gives the same points on Debian 13 as here:
#   sudo scripts/debian13.sh        (Debian 12 with debootstrap, after `make build`; 5 GB in build/debian13)
# Runs ctest and `infrasim run` in a Debian 13 root; JOBS compilers at a time, FRAMES frames a preset.
set -euo pipefail
cd "$(dirname "$0")/.."
work=build/debian13
root=$work/root
frames=${FRAMES:-20}
lidars=(configs/lidars/{livox_avia,helios_16,pandar_64,ruby_plus}.yaml)

# In the root, in the copy of the source; mounts end with the command.
inside() {
  unshare --mount --pid --fork --mount-proc="$PWD/$root/proc" \
    chroot "$root" env HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    PATH=/usr/sbin:/usr/bin:/sbin:/bin bash -c 'cd /infrasim && "$@"' - "$@"
}

make_root() {
  rm -rf "$root.part"
  debootstrap --variant=minbase trixie "$root.part" >"$work/debootstrap.log"
  # What this machine trusts besides Debian's certificates, for one behind a proxy.
  mkdir -p "$root.part/usr/local/share/ca-certificates"
  cp -r /usr/local/share/ca-certificates/. "$root.part/usr/local/share/ca-certificates"
  # Nothing in there needs to survive a power cut.
  echo force-unsafe-io >"$root.part/etc/dpkg/dpkg.cfg.d/unsafe-io"
  mv "$root.part" "$root"
}

copy_source() {
  mkdir -p "$root/infrasim"
  git ls-files -z --cached --others --exclude-standard | tar --null -T - -c | tar -x -C "$root/infrasim"
}

build_and_test() {
  inside scripts/setup.sh build
  inside cmake -S . -B build/release -G Ninja -DCMAKE_BUILD_TYPE=Release -DINFRASIM_TESTS=ON \
    -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
  inside cmake --build build/release -j "${JOBS:-1}"
  inside ctest --test-dir build/release --output-on-failure --no-tests=error
}

# The same frames by both; the folders must not hold those of an earlier build.
simulate() {
  local preset run
  rm -rf "$root/infrasim/out" "$work/here"
  for preset in paper datasheet; do
    run=(run configs/scenes/highway.yaml --lidar "${lidars[@]}" --preset "$preset"
      --frames "0:$frames" --fields --threads 1)
    inside build/release/cpp/infrasim "${run[@]}" --out "out/$preset"
    .venv/bin/infrasim "${run[@]}" --out "$work/here/$preset"
  done
}

mkdir -p "$work"
[[ -d $root ]] || make_root
copy_source
build_and_test
simulate
.venv/bin/python benchmarks/same_points.py "$work/here" "$root/infrasim/out" --out results/debian13.csv
