# Each target does its own set-up; see `make setup`.
PYTHON := .venv/bin/python
FUZZ_SECONDS := 60
# Of `make dataset`: frames of a scene (5000 are all), the LiDARs' preset, where to.
FRAMES := 5000
PRESET := paper
OUT := data/$(PRESET)
# ON: several sources are compiled at a time, in half the processor time, as for the wheel. OFF: each
# source is compiled alone, as in `make lint-cpp`, which finds a missing include.
UNITY := ON
# OFF: the site is built without running the gallery's scripts.
GALLERY := ON
# Objects that were compiled before, also for the wheel, come from ccache if it is installed.
export CMAKE_CXX_COMPILER_LAUNCHER = $(shell command -v ccache)
export CCACHE_BASEDIR := $(CURDIR)
export CCACHE_NOHASHDIR := 1
export CCACHE_DEPEND := 1

# A build type's configure step, with more options and UNITY if given; pybind11 comes from the
# virtual environment.
configure = cmake --preset $(1) $(2) -DCMAKE_UNITY_BUILD=$(or $(3),$(UNITY)) -DPython_EXECUTABLE=$(CURDIR)/$(PYTHON) \
	-Dpybind11_DIR=$$($(PYTHON) -m pybind11 --cmakedir) >build/$(1)-configure.log 2>&1 \
	|| { cat build/$(1)-configure.log; exit 1; }

# Of `make results`: files of results/ (all if empty), and how many parts run side by side.
FILES :=
JOBS := 1

.PHONY: setup build demo dataset generalist debian13 test lint lint-cpp stubs reference results tables docs viewer bench wheel wheels hashes sanitize fuzz test-nightly attack nightly clean
.NOTPARALLEL:

build:
	@scripts/setup.sh build
	@mkdir -p build
	@$(call configure,dev)
	cmake --build --preset dev

setup: build
	scripts/setup.sh train exchange test dev

# The pretrained detector on four LiDARs at a junction. Neither tests nor benchmarks are built, -O2
# compiles in a fifth less time than -O3 (same frames, some 3 % slower), and Python packages are
# downloaded while the compiler runs. FULL=1 repeats the study's small benchmark.
ifdef FULL
demo: build
	@scripts/setup.sh train
	$(PYTHON) -m reproduction demo --out out/demo_full
	$(PYTHON) -m pyinfra benchmark configs/benchmarks/demo.yaml --tier smoke --work out/demo_full/work --out out/demo_full/results
	$(PYTHON) -m pyinfra report out/demo_full/results --tier smoke --data out/demo_full/work/data/highway_paper --sections reproduction.report --out out/demo_full/report.html
else
demo:
	@scripts/setup.sh compile
	@mkdir -p build
	@[ -e build/dev/build.ninja ] || { $(call configure,dev,-DINFRASIM_TESTS=OFF -DINFRASIM_BENCHMARKS=OFF \
		-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O2,ON); }
	@scripts/setup.sh build & packages=$$!; \
		cmake --build --preset dev --target infrasim_cli _core && wait $$packages
	$(PYTHON) -m pyinfra demo --out out/demo
endif

# About 29 GB; a stopped one goes on.
dataset: build
	$(PYTHON) -m reproduction dataset --frames $(FRAMES) --preset $(PRESET) --out $(OUT)

# The model that comes with the package: calibrates the weights of version 3, in some 20 minutes of one core.
generalist: build
	@scripts/setup.sh train
	$(PYTHON) -m reproduction pack_generalist generalist-3

# A wheel for each Python, each tried in a Debian with that Python alone. As root on Debian 12; 2 GB in build/roots.
wheels: build wheel
	scripts/wheels.sh

# The C++ tests and, with the wheel, the Python tests. As root on Debian 12; 15 GB in build/roots.
debian13: wheels
	scripts/debian13.sh

test: build
	@scripts/setup.sh train exchange test
	ctest --preset dev --no-tests=error -E 'nightly_'
	$(PYTHON) -m pytest -n 2 --dist loadfile --no-loadscope-reorder

lint:
	@scripts/setup.sh build train exchange dev
	.venv/bin/pre-commit run --all-files --show-diff-on-failure
	.venv/bin/mypy

# clang-tidy for the C++ sources and their tests, which takes minutes and seldom finds anything.
lint-cpp:
	@scripts/setup.sh build dev
	@mkdir -p build
	@$(call configure,dev,-B build/tidy,OFF)
	$(PYTHON) .venv/bin/run-clang-tidy.py -quiet -hide-progress -p build/tidy \
		-clang-tidy-binary .venv/bin/clang-tidy '$(CURDIR)/(build/tidy/)?(cpp|bindings|tests/cpp)/.*'

stubs: build
	@scripts/setup.sh test
	.venv/bin/pybind11-stubgen pyinfra._core -o .

# The script of the 3-D view, which is checked in; needs Node.js 18 or newer with npm.
viewer:
	cd viewer && npm ci --ignore-scripts && npm run build

# Every configuration key, from the code that reads it.
reference: build
	@scripts/setup.sh train
	$(PYTHON) scripts/reference.py

# Every file of results/ that is out of date. LIST=1 only prints what it takes; a stopped one goes on.
results: build
	@scripts/setup.sh train exchange test bench
	$(PYTHON) -m reproduction results $(FILES) --jobs $(JOBS) $(if $(LIST),--list)

# The tables of the pages, from results/*.csv.
tables:
	@scripts/setup.sh build
	$(PYTHON) -m reproduction tables

# The documentation site with current tables: build/docs/index.html.
docs: build tables
	@scripts/setup.sh train docs
	GALLERY=$(GALLERY) MPLBACKEND=agg .venv/bin/sphinx-build -q -W --keep-going -b html -d build/doctrees docs build/docs
	@echo "build/docs/index.html"

# Writes out/speed.csv; to record a measurement: benchmarks/run.py --out results/speed.csv.
# AGAINST=DIR only compares with the build of another checkout, and writes out/speed_against.csv.
bench: build
	@scripts/setup.sh bench
	$(PYTHON) benchmarks/run.py $(if $(AGAINST),--against $(AGAINST))

# One wheel, which brings its libraries.
wheel:
	@scripts/setup.sh build wheel
	scripts/wheel.sh

# SHA-256 of every pin of scripts/constraints.txt, after one changed.
hashes:
	@scripts/setup.sh build
	$(PYTHON) scripts/hashes.py

sanitize:
	@scripts/setup.sh build
	cmake --preset sanitize
	cmake --build --preset sanitize
	ctest --preset sanitize --no-tests=error

# Each target, each reader of Python, and the functions of the extension together, for FUZZ_SECONDS; the shipped configurations are seeds.
fuzz:
	@scripts/setup.sh build train exchange test fuzz
	cmake --preset fuzz -DCMAKE_CXX_COMPILER=$$(command -v clang++-16 >/dev/null && echo clang++-16 || echo clang++-19)
	cmake --build --preset fuzz
	@mkdir -p build/fuzz/corpus
	for name in $$(cd build/fuzz/tests/fuzz && find . -maxdepth 1 -name 'fuzz_*' -type f); do \
		mkdir -p build/fuzz/corpus/$$name && \
		build/fuzz/tests/fuzz/$$name -max_total_time=$(FUZZ_SECONDS) -artifact_prefix=build/fuzz/ \
			build/fuzz/corpus/$$name configs || exit 1; \
	done
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(PYTHON) -m pytest -n 2 tests/python/test_reader_fuzz.py \
		tests/python/test_reader_properties.py tests/python/test_site_properties.py \
		tests/python/test_core_fuzz.py

# The tests that `make test` leaves out.
test-nightly: build
	@scripts/setup.sh train exchange test bench
	ctest --preset dev --no-tests=error -R 'nightly_'
	$(PYTHON) -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m nightly

# Kills, full disks and damaged files; as root, or without the disks. Some minutes.
attack: build
	@scripts/setup.sh train exchange test
	$(PYTHON) tests/python/attack.py

# The slow checks that CI leaves out, one after the other.
nightly: lint-cpp sanitize fuzz bench test-nightly attack

clean:
	rm -rf build docs/examples pyinfra/_core*.so
