# Functions for scripts that test the project in a separate Debian root. They need Debian 12 with debootstrap,
# and the rights of the user root.

# make_root FOLDER SUITE PACKAGE...: makes a minimal Debian with these packages unless the folder exists.
make_root() {
  local root=$1 suite=$2
  [[ ! -d $root ]] || return 0
  rm -rf "$root.part"
  mkdir -p "$(dirname "$root")"
  debootstrap --variant=minbase --include="$(IFS=,; echo "ca-certificates,${*:3}")" "$suite" "$root.part" \
    >"$root.log"
  # Adds the certificates that this machine trusts besides Debian's, for machines behind a proxy.
  mkdir -p "$root.part/usr/local/share/ca-certificates"
  cp -r /usr/local/share/ca-certificates/. "$root.part/usr/local/share/ca-certificates"
  chroot "$root.part" update-ca-certificates >>"$root.log" 2>&1
  # The root can be made again, so dpkg need not sync its files to the disk.
  echo force-unsafe-io >"$root.part/etc/dpkg/dpkg.cfg.d/unsafe-io"
  mv "$root.part" "$root"
}

# inside ROOT FOLDER COMMAND...: runs a command in a folder of the root. The mounts of the root exist only while
# the command runs.
inside() {
  local root
  root=$(realpath "$1")
  unshare --mount --pid --fork --mount-proc="$root/proc" \
    sh -c 'mkdir -p "$1/dev/shm" "$1/dev/pts" && mount -t tmpfs shm "$1/dev/shm" &&
      mount -t devpts -o newinstance,ptmxmode=0666 pts "$1/dev/pts" && exec chroot "$@"' - "$root" env -i HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    PATH=/usr/sbin:/usr/bin:/sbin:/bin PIP_CERT=/etc/ssl/certs/ca-certificates.crt \
    bash -c 'cd "$1" && shift && "$@"' - "${@:2}"
}
