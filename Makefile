# Two commands do everything, set-up included: `make table1` and `make test`. `make help` lists the rest.

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

# A sweep of other code or of another size must not be resumed, hence the commit and the size in the name.
SCENES ?=
OUT ?= results/table1-$(shell git rev-parse --short HEAD 2>/dev/null || echo local)$(if $(SCENES),-$(SCENES)-scenes)
WORKERS ?=
TEST_WORKERS ?= 2
PYTEST_ARGS ?=
PYTHON ?=

SWEEP_OPTIONS := $(if $(SCENES),--scenes $(SCENES)) $(if $(WORKERS),--workers $(WORKERS))

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules --no-print-directory

# A sourced robotics workspace puts its own packages and pytest plugins in front of the environment's.
unexport PYTHONPATH PYTHONHOME

# Shell functions shared by recipes.
#   may_install: succeeds when packages can be installed without a password; sets `sudo`.
#   apt_install PACKAGES: installs them quietly; on failure shows apt's own words and fails.
define APT
sudo=
may_install() {
    command -v apt-get >/dev/null || return 1
    [ "$$(id -u)" = 0 ] && return 0
    command -v sudo >/dev/null && sudo -n true 2>/dev/null && sudo="sudo -n"
}
apt_install() {
    local log; log=$$(mktemp)
    echo "Installing $$* (apt) ..."
    $$sudo apt-get update -q </dev/null >"$$log" 2>&1 || true  # one unreachable source must not stop the others
    if ! $$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "$$@" \
            </dev/null >>"$$log" 2>&1; then
        tail -n 15 "$$log" >&2; rm -f "$$log"; return 1
    fi
    rm -f "$$log"
}
endef

.PHONY: help install gl browser table1 test mutants smoke other-machine bench lint clean

help:  ## Show this list
	@echo "focalpick: make table1 and make test need no set-up; they create $(VENV) and install by themselves."
	echo
	awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
	echo
	echo "  OUT=DIR SCENES=N WORKERS=N change table1; TEST_WORKERS=N PYTEST_ARGS='-k ellipse' change test;"
	echo "  PYTHON=/path/to/python3.12 chooses the interpreter for $(VENV) (3.11 or newer)."

table1: install gl  ## Run the whole benchmark (resumes where it stopped) and print Table 1 and Fig. 10
	@status=0
	$(BIN)/focalpick sweep --preset table1 --out "$(OUT)" $(SWEEP_OPTIONS) || status=$$?
	[ $$status -le 1 ] || exit $$status  # 1: some episodes did not finish; the table counts the others
	$(BIN)/focalpick table "$(OUT)" --figures "$(OUT)"
	exit $$status

test: install gl browser  ## Run all tests
	@$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal $(PYTEST_ARGS)

mutants: install gl  ## Make small mistakes in a copy of the code, one by one, and see which of them no fast test notices
	@$(BIN)/python -m tests.mutants.run

smoke: install gl  ## Run a sweep of a few scenes and hold it against its thresholds, as CI does
	@out=$$(mktemp -d)
	trap 'rm -rf "$$out"' EXIT
	$(BIN)/focalpick sweep --preset smoke --out "$$out/smoke" $(SWEEP_OPTIONS)
	$(BIN)/focalpick table "$$out/smoke"
	$(BIN)/focalpick check "$$out/smoke" --thresholds benchmark/thresholds/smoke.toml

# Long tests are left out, and files of tests that neither draw nor calculate; all others are played, new files too.
ELSEWHERE := $(addprefix --ignore=tests/benchmark/test_,child_processes.py cli.py mesh_file.py mesh_part.py store_attacks.py \
    sweep.py sweep_deaths.py sweep_inputs.py)
# Another processor is imitated by telling each library to take this one for less than it is: Mesa and numpy for one
# without AVX, OpenCV for one without AVX2, Numba for any of the family, OpenBLAS for the oldest one with AVX2. Numba
# keeps the kernels for each processor apart by itself.
other-machine: install gl  ## Play a plainer processor, then OSMesa: tests, and a sweep held to this machine's
	@$(APT)
	out=$$(mktemp -d)
	trap 'rm -rf "$$out"' EXIT
	simd=$$($(BIN)/python -c 'import numpy; print(*numpy.show_config(mode="dicts")["SIMD Extensions"].get("found", []))')
	play() {  # NAME TESTS VARIABLE=VALUE...: the tests there, and how far its poses are from those of this machine
	    local name=$$1 tests=$$2; shift 2
	    echo "Playing another machine: $$*"
	    env "$$@" $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal -m "not browser and not slow and not sweep" $(PYTEST_ARGS) \
	        $(ELSEWHERE) $$tests
	    env "$$@" $(BIN)/focalpick sweep --preset smoke --out "$$out/$$name"
	    $(BIN)/focalpick compare "$$out/here" "$$out/$$name"
	}
	$(BIN)/focalpick sweep --preset smoke --out "$$out/here"
	play processor "tests/vision tests/robot tests/benchmark" LP_NATIVE_VECTOR_WIDTH=128 GALLIUM_OVERRIDE_CPU_CAPS=sse4.1 \
	    NUMBA_CPU_NAME=generic OPENBLAS_CORETYPE=Haswell OPENCV_CPU_DISABLE=AVX2,AVX512-SKX \
	    NPY_DISABLE_CPU_FEATURES="$$simd"
	osmesa() { MUJOCO_GL=osmesa $(BIN)/python -m benchmark.world.gl >/dev/null 2>&1; }
	if ! osmesa && may_install; then apt_install libosmesa6 || true; fi  # recent distributions no longer carry it
	if osmesa; then play osmesa tests/benchmark MUJOCO_GL=osmesa; else echo "OSMesa is not here: left out."; fi

bench: install gl  ## Measure the ellipse detector on drawn pictures, and the time of the vision step by stages
	@$(BIN)/python -m benchmark.detector.evaluate
	$(BIN)/python -m benchmark.timing.vision_step

lint: install  ## Check style and types
	@$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

install: $(INSTALLED)  ## Create .venv and install focalpick into it (done by the others when needed)

$(INSTALLED): pyproject.toml constraints.txt
	@$(APT)
	find_python() {  # prints the first interpreter that is new enough; succeeds if it can also make environments
	    local candidate found=
	    for candidate in $(PYTHON) $(if $(PYTHON),,python3 python3.13 python3.12 python3.11 python3.14); do
	        "$$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || continue
	        if "$$candidate" -c 'import ensurepip, venv' 2>/dev/null; then echo "$$candidate"; return 0; fi
	        found=$${found:-$$candidate}
	    done
	    echo "$$found"; return 1
	}
	if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then
	    if ! python=$$(find_python); then
	        if [ -z "$$python" ]; then
	            echo "make: focalpick needs Python 3.11 or newer and found none." >&2
	            echo "      Install one (Debian 12, Ubuntu 22.04: sudo apt-get install python3.11 python3.11-venv;" >&2
	            echo "      newer ones: sudo apt-get install python3 python3-venv)," >&2
	            echo "      or name it: make PYTHON=/path/to/python3.12 ..." >&2
	            exit 1
	        fi
	        package=$$("$$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
	        if ! { may_install && apt_install "$$package" && python=$$(find_python); }; then
	            echo "make: $$python cannot create virtual environments: its ensurepip module is missing." >&2
	            echo "      Run: sudo apt-get install $$package" >&2
	            exit 1
	        fi
	    fi
	    echo "Creating $(VENV) with $$("$$python" --version) ..."
	    "$$python" -m venv --clear $(VENV)
	fi
	echo "Installing focalpick and its dependencies into $(VENV) (once; a few minutes) ..."
	pip_install() {  # shows errors only
	    $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input "$$@" </dev/null
	}
	if $(BIN)/python -c 'import sys; sys.exit(sys.version_info >= (3, 13))'; then
	    pip_install -c constraints.txt -e '.[dev]'
	else  # dm-control asks for labmaze, which nothing here uses and which has no wheel after Python 3.12
	    grep -v '^labmaze==' constraints.txt >$(VENV)/pins.txt
	    pip_install --no-deps -r $(VENV)/pins.txt
	    pip_install --no-deps -e .
	fi
	touch $@

gl: install
	@$(APT)
	probe() { $(BIN)/python -m benchmark.world.gl; }
	if probe 2>/dev/null; then exit 0; fi
	if ! may_install; then
	    probe || true
	    echo "make: to render without a graphics card, run this line and repeat:" >&2
	    echo "      sudo apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri libosmesa6" >&2
	    exit 1
	fi
	apt_install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri || true
	if probe 2>/dev/null; then exit 0; fi
	apt_install libosmesa6 || true  # the fallback; recent distributions no longer carry it
	probe

browser:  # for the tests of the teaching page, which are skipped without one
	@$(APT)
	for name in chromium chromium-browser google-chrome; do
	    if command -v "$$name" >/dev/null; then exit 0; fi
	done
	if may_install; then apt_install chromium || true; fi

clean:  ## Remove .venv and all caches; results stay
	@rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
