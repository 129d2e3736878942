# Two commands on a fresh machine with Python 3.11+, gcc and make:
#   make demo     a simulated arm, live, corrected for temperature
#   make test     format, lint, types, import layers, tests
# make test-all then runs everything else.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: install demo test test-default test-all test-slow test-long lint bench clean hidden hidden-freeze hidden-compare hidden-sweep outsider interim interim-reliability soak fuzz system-test deb paper real so101 so101-live circle page browser picture
install: $(VENV)/.installed

$(VENV)/.dependencies: requirements.txt
	@echo "armd: installing into $(VENV): 1.2 GB on disk, some 350 MB to fetch"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.txt
	touch $@

$(VENV)/.installed: $(VENV)/.dependencies pyproject.toml
	rm -rf build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@echo "armd: compiling the kernel for this machine: a minute, once"
	$(BIN)/python -I -m armd.daemon.ahead
	touch $@

demo: install
	$(BIN)/armd demo $(DEMO_ARGS)

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Three workers for two processors, because many tests wait; then, alone, those marked serial.
# A choice of tests (TEST_ARGS="-k wire") may leave one of the two parts empty: pytest's code 5.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --durations=20
WORKERS := $(PYTEST) -n 3 --dist loadfile
EMPTY_IS_FINE := $(if $(TEST_ARGS),|| [ $$? = 5 ])

test:
	@echo "armd: lint and tests take about four minutes on two cores, once armd is installed"
	@$(MAKE) --no-print-directory install
	@began=$$(date +%s); $(MAKE) --no-print-directory lint test-default; code=$$?; \
	    echo "armd: make test took $$(($$(date +%s) - began)) s"; exit $$code

test-default: install
	$(WORKERS) -m "not slow and not serial" $(TEST_ARGS) $(EMPTY_IS_FINE)
	$(PYTEST) -m "serial and not slow" $(TEST_ARGS) $(EMPTY_IS_FINE)

# What make test leaves out, save make test-long
test-all:
	@echo "armd: everything else takes about an hour on two cores"
	@$(MAKE) --no-print-directory install
	@began=$$(date +%s); \
	    for part in paper real browser test-slow "soak MINUTES=2" \
	        "fuzz MINUTES=10" system-test; do \
	        $(MAKE) --no-print-directory $$part || exit; \
	    done; \
	    echo "armd: make test-all took $$(($$(date +%s) - began)) s"

SLOW := slow and not long
test-slow: install
	@echo "armd: the slow tests take about half an hour on two cores"
	$(WORKERS) --timeout 900 -m "$(SLOW) and not crowd and not serial" \
	    --ignore tests/deploy/test_system.py $(TEST_ARGS) $(EMPTY_IS_FINE)
	$(PYTEST) --timeout 900 -m "$(SLOW) and (crowd or serial)" \
	    --ignore tests/deploy/test_system.py $(TEST_ARGS) $(EMPTY_IS_FINE)

# Minutes each: many more cases of what the slow tests have a few of, and another processor
test-long: install
	@echo "armd: the long tests take about half an hour on two cores"
	$(WORKERS) --timeout 1800 -m "long and not crowd and not serial" $(TEST_ARGS) $(EMPTY_IS_FINE)
	$(PYTEST) --timeout 1800 -m "long and (crowd or serial)" $(TEST_ARGS) $(EMPTY_IS_FINE)

# A fresh Monte Carlo of effects hidden by the simulator: make hidden CASES=100 SEED=7
CASES ?= 40
SEED ?= 1
hidden: install
	PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/hidden/montecarlo.py --cases $(CASES) --seed $(SEED) $(HIDDEN_ARGS)

# The frozen cases, which two revisions are compared on (CONTRIBUTING.md). hidden-freeze draws those
# of a seed into .cache/hidden and checks their SHA-256; RECORD=1 keeps it, ANEW=1 draws again.
# make hidden-compare BASE=f83ffbf [KIND='*thermal*,clean'] [CASES=2] [HEAD=main]
FROZEN := PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 nice -n 15 $(BIN)/python -m hidden.frozen.
# 421 and all cases, unless the command line says otherwise
FROZEN_SEED = $(if $(filter file,$(origin SEED)),421,$(SEED))
CASES_ASKED = $(if $(filter file,$(origin CASES)),,$(CASES))
hidden-freeze: install
	$(FROZEN)freeze --seed $(FROZEN_SEED) --kinds "$(or $(KIND),*)" \
	    $(if $(CASES_ASKED),--cases $(CASES_ASKED)) $(if $(RECORD),--record) $(if $(ANEW),--anew)

hidden-compare: install
	$(FROZEN)compare --seed $(FROZEN_SEED) --base "$(BASE)" --head "$(or $(HEAD),HEAD)" \
	    --kinds "$(or $(KIND),*)" $(if $(CASES_ASKED),--cases $(CASES_ASKED)) $(COMPARE_ARGS)

# Cases of a generator that shares nothing with armd, n of each kind, through the commands:
# make outsider CASES=2 SEED=7
outsider: install
	PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/outsider/run.py --cases $(CASES) --seed $(SEED) $(OUTSIDER_ARGS)

# Interim checks against an oracle, the table of docs/interim.md: make interim CASES=40 SEED=2
interim: install
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/interim/montecarlo.py --cases $(CASES) --seed $(SEED)

# Whether the probabilities of interim checks hold: make interim-reliability CASES=200 SEED=2
interim-reliability: install
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/interim/reliability.py --changes $(CASES) --seed $(SEED)

# How the marks move when each constant of the search is halved and doubled:
# make hidden-sweep CASES=4 SEED=7 SWEEP_ARGS="--only OFF ALPHA"
hidden-sweep: install
	PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/hidden/sweep.py --cases $(CASES) --seed $(SEED) $(SWEEP_ARGS)

# Simulator, daemon and subscribers under random faults, every point accounted for:
# make soak MINUTES=60 SEED=3
MINUTES ?= 2
soak: install
	PYTHONPATH=tests $(BIN)/python tests/scenarios/soak.py --minutes $(MINUTES) --seed $(SEED)

# Damaged input at every door: files, wires, page, I++, messages. What breaks one is kept in
# out/fuzz: make fuzz MINUTES=60 SEED=3
fuzz: install
	PYTHONPATH=tests $(BIN)/python tests/fuzz/run.py --minutes $(MINUTES) --seed $(SEED) $(FUZZ_ARGS)

# A Debian package for controllers with this Python or another: make deb FOR=3.13
FOR ?= $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
deb: install
	PYTHON=$(BIN)/python deploy/package.sh --python $(FOR) out

# Installs armd on a Debian booted as a guest, under User-Mode Linux or, MACHINE=qemu, in software;
# fails with BROKEN=1, as a broken daemon must.
system-test: install
	$(BIN)/python -m pytest --durations=20 tests/deploy/test_system.py -m slow -s

# The founding paper's experiment, its tables beside ours
paper: install
	$(BIN)/python tests/scenarios/paper.py

# From box to certificate on a simulated SO-101, each figure printed: make so101 SEED=3
so101: install
	$(BIN)/python tests/scenarios/so101.py --seed $(SEED)

# The same over the wire: servo packets on a pseudo-terminal, armd run, armd measure
so101-live: install
	$(BIN)/python tests/scenarios/so101_live.py --seed $(SEED)

# An arm goes wrong, is measured, diagnosed, mended and verified over the wire, figures printed
circle: install
	$(BIN)/python tests/scenarios/circle.py --seed 5

# Real measured data; DATA=../shared/data for copies of your own
real: install
	$(BIN)/python tests/real/marks.py $(DATA)
	$(BIN)/python tests/real/diagnosis_marks.py $(DATA)

# The libraries of the page of `armd view`, bundled anew from npm; the result is committed
PAGE := daemon/bridges/view
page:
	built=$$(mktemp -d) && cp $(PAGE)/recipe/* $$built && cd $$built \
	    && npm install --no-package-lock --no-audit --no-fund --silent && npm run --silent build \
	    && cp out/* $(CURDIR)/$(PAGE)/page/vendor/ && rm -r $$built

# A browser for the page's tests, where one may install it; without it they are skipped
browser:
	command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && apt-get update -qq \
	    && apt-get install -y -qq --no-install-recommends chromium; } \
	    || echo "no Chromium: the browser tests of the page will be skipped"

# The picture of the page anew, on a machine that does nothing else
picture: install browser
	PYTHONPATH=tests $(BIN)/python tests/bridges/picture.py out/view.png && cp out/view.png docs/view.png

# Figures and ratios measured in one run, as text and as out/bench.json; BENCH="kernel wire"
bench: install
	PYTHONPATH=tests $(BIN)/python tests/benchmarks/run.py $(BENCH)

clean:
	rm -rf $(VENV) build .cache *.egg-info
