#!/usr/bin/env bash
# Makes the wheel for this Python in dist, and tests it in a clean environment outside the source tree.
# The compiler options are those of the preset `dev`. With ccache and UNITY=ON, the wheel therefore has
# the same compiled objects as the tested build.
set -euo pipefail
cd "$(dirname "$0")/.."
try=$PWD/build/wheel-env

rm -rf build/wheel dist "$try"
CXX=c++ .venv/bin/python -m pip wheel -qq . --no-deps -w build/wheel/raw --no-build-isolation \
  -Ccmake.build-type=RelWithDebInfo -Ccmake.define.CMAKE_CXX_FLAGS_RELWITHDEBINFO="-O3 -g1" \
  -Ccmake.define.CMAKE_COMPILE_WARNING_AS_ERROR=ON -Cinstall.strip=true
wheel=$PWD/$(.venv/bin/python scripts/bundle.py build/wheel/raw/*.whl dist)
.venv/bin/python -m venv --without-pip "$try"
.venv/bin/python -m pip --python "$try/bin/python" install -qq --no-compile -c scripts/constraints.txt \
  "infrasim @ file://$wheel#sha256=$(sha256sum "$wheel" | cut -c1-64)"

cd /
package=$("$try/bin/python" -c 'import pyinfra; print(*pyinfra.__path__)')
# The wheel must contain all libraries except those that every Linux has.
if ldd "$package"/_core*.so "$package/bin/infrasim" |
  grep -vE "^/|/infrasim\.libs/|linux-vdso|ld-linux|lib(c|m|gcc_s|stdc\+\+)\.so"; then
  echo "wheel: the libraries above are missing in the wheel" >&2
  exit 1
fi
"$try/bin/infrasim" --version
"$try/bin/python" -c "import pyinfra, pyinfra._core as core; assert core.version() == pyinfra.__version__"
"$try/bin/python" -c "from pyinfra.viz.viewer.page import library; library()"
# The package must run a detector without PyTorch, and find scenes, LiDARs and detectors by name.
"$try/bin/python" - <<'EOF'
import sys
import pyinfra as pi
frames = pi.simulate(pi.load_scene("highway"), pi.load_lidar("helios_16"), range(0, 20, 10))
assert len(pi.detect("generalist", frames)) > 0
assert "torch" not in sys.modules
EOF
# The wheel must contain the sample recording: imports it, detects boxes and draws the view, in a new folder.
recording=$(mktemp -d)
(
  cd "$recording"
  "$try/bin/pyinfra" import sample --out rec
  "$try/bin/pyinfra" detect rec --out boxes
  "$try/bin/pyinfra" view rec --pred boxes --out view.html
)
rm -r "$recording"
ls "$package/configs"
du -sm "$try"
ls -l "$wheel"
