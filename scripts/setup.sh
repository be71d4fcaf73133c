#!/usr/bin/env bash
# Installs the missing packages of the named groups:
#   scripts/setup.sh build test dev
# A group is a group of scripts/apt-packages.txt, an extra of pyproject.toml, or both.
# `build` has the package's own requirements and comes first. `compile` is the part of `build` that
# compiling needs.
set -euo pipefail
cd "$(dirname "$0")/.."
constraints=scripts/constraints.txt

install_system_packages() {
  local missing=() group name only debian sudo=()
  debian=$(. /etc/os-release && echo "${VERSION_ID:-}")
  while read -r group name only; do
    [[ " ${*/#compile/build} " == *" $group "* && ${only:-$debian} == "$debian" ]] || continue
    dpkg-query -W -f '${Status}' "$name" 2>/dev/null | grep -q 'ok installed' || missing+=("$name")
  done < <(grep -v '^#' scripts/apt-packages.txt)
  [[ ${#missing[@]} -gt 0 ]] || return 0

  local install=(apt-get install -y --no-install-recommends "${missing[@]}")
  if [[ $(id -u) != 0 ]]; then
    if ! sudo -n true 2>/dev/null && ! { [[ -t 0 ]] && command -v sudo >/dev/null; }; then
      echo "setup: missing system packages: ${missing[*]}" >&2
      echo "setup: install them as root, then try again: ${install[*]}" >&2
      exit 1
    fi
    sudo=(sudo)
  fi
  echo "setup: installing ${#missing[@]} system packages: ${missing[*]}"
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive "${install[@]}" </dev/null >/dev/null
}

# Prints the first python3 that is new enough and can build extensions and environments.
find_python() {
  local python
  for python in python3 /usr/bin/python3 python3.11 python3.12 python3.13; do
    "$python" 2>/dev/null - <<'EOF' && echo "$python" && return
import ensurepip, pathlib, sys, sysconfig
header = pathlib.Path(sysconfig.get_path("include"), "Python.h")
sys.exit(not (sys.version_info >= (3, 11) and header.exists()))
EOF
  done
  echo "setup: no Python >= 3.11 with its headers and venv was found" >&2
  return 1
}

# Prints the requirements of a group from pyproject.toml.
requirements() {
  .venv/bin/python - "$1" <<'EOF'
import pathlib, sys, tomllib
config = tomllib.loads(pathlib.Path("pyproject.toml").read_text())
project, group = config["project"], sys.argv[1]
tools = config["build-system"]["requires"]
groups = {"compile": tools, "build": tools + project["dependencies"]}
print(*groups.get(group, project["optional-dependencies"].get(group, [])), sep="\n")
EOF
}

# Python compiles what is imported when it is first imported, which is a small part.
pip_install() {
  .venv/bin/python -m pip install -qq --no-compile -c $constraints --build-constraint $constraints "$@"
}

# Installs PyTorch's CPU build if pip is configured with an index or a folder that has it. PyPI has only
# the CUDA build, which pip would otherwise choose because its hash is in the constraints.
install_torch_for_cpu() {
  pip_install "$(sed -n 's/^\(torch==[0-9.]*\) .*/\1+cpu/p' $constraints)" 2>/dev/null ||
    echo "setup: pip finds no CPU build of PyTorch; the build on PyPI includes CUDA"
}

make_environment() {
  "$(find_python)" -m venv --clear .venv
  # The source tree is importable without installing the package.
  pwd >"$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/infrasim.pth"
  # The system's pip does not read hashes of constraints, so pip and its hashes are passed as requirements.
  sed -n '/^pip==/,/[^\\]$/p' $constraints | .venv/bin/python -m pip install -qq -r /dev/stdin
  touch .venv/.setup
}

# Links the commands of the source tree beside its Python.
link_commands() {
  ln -sfn ../../build/dev/cpp/infrasim .venv/bin/infrasim
  printf '#!/bin/sh\nexec "${0%%/*}/python" -P -m pyinfra "$@"\n' >.venv/bin/pyinfra
  chmod +x .venv/bin/pyinfra
}

install_python_packages() {
  local group wanted state
  state=$(cat "$0" pyproject.toml $constraints | sha256sum)
  for group in "$@"; do
    [[ $state != "$(cat ".venv/.setup-$group" 2>/dev/null)" ]] || continue
    [[ -e .venv/.setup ]] && .venv/bin/python -c '' || make_environment
    wanted=$(requirements "$group")
    if [[ $wanted ]]; then
      echo "setup: installing the Python packages of '$group'"
      [[ $wanted != *torch* ]] || install_torch_for_cpu
      pip_install -r /dev/stdin <<<"$wanted"
    fi
    echo "$state" >".venv/.setup-$group"
  done
}

install_system_packages "$@"
install_python_packages "$@"
link_commands
