#!/usr/bin/env bash
# Makes this Python's wheel in build/wheel and tries it in a clean environment, away from the source tree.
set -euo pipefail
cd "$(dirname "$0")/.."
try=$PWD/build/wheel-env

rm -rf build/wheel "$try"
.venv/bin/python -m pip wheel -qq . --no-deps -w build/wheel/raw --build-constraint scripts/constraints.txt
wheel=$PWD/$(.venv/bin/python scripts/bundle.py build/wheel/raw/*.whl build/wheel)
.venv/bin/python -m venv --without-pip "$try"
.venv/bin/python -m pip --python "$try/bin/python" install -qq --no-compile -c scripts/constraints.txt \
  "infrasim @ file://$wheel#sha256=$(sha256sum "$wheel" | cut -c1-64)"

cd /
package=$("$try/bin/python" -c 'import pyinfra; print(*pyinfra.__path__)')
# All libraries are the wheel's but those that each Linux has.
if ldd "$package"/_core*.so "$package/bin/infrasim" |
  grep -vE "^/|/infrasim\.libs/|linux-vdso|ld-linux|lib(c|m|gcc_s|stdc\+\+)\.so"; then
  echo "wheel: needs the system's libraries above" >&2
  exit 1
fi
"$try/bin/infrasim" --version
"$try/bin/python" -c "import pyinfra, pyinfra._core as core; assert core.version() == pyinfra.__version__"
"$try/bin/python" -c "from pyinfra.viz.viewer.page import library; library()"
ls "$package/configs"
ls -l "$wheel"
