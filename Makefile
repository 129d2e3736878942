# Two commands on a fresh machine with Python 3.11+, gcc and make:
#   make demo     a simulated arm, live, corrected for temperature
#   make test     format, lint, types, import layers, tests
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: install demo test test-slow test-long lint bench clean hidden hidden-sweep outsider interim interim-reliability soak fuzz system-test deb paper real so101 so101-live circle page browser picture
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

# One worker for what reads wires, one for what waits, one for what computes (tests/conftest.py);
# the few that fail for want of a processor run once more, alone (tests/twice.py).
TWICE := $(BIN)/python tests/twice.py
WORKERS := OPENBLAS_NUM_THREADS=1 $(TWICE) -n 3

test: lint
	@echo "armd: the tests take about ten minutes on two cores"
	$(WORKERS) -m "not slow" $(TEST_ARGS)

test-slow: install
	@echo "armd: the slow tests take about half an hour on two cores"
	$(WORKERS) --timeout 900 -m "slow and not crowd and not long" --ignore tests/deploy/test_system.py $(TEST_ARGS)
	$(TWICE) -m "crowd and not long" $(TEST_ARGS)

# Minutes each: many more cases of what the slow tests have a few of, and another processor
test-long: install
	@echo "armd: the long tests take about half an hour on two cores"
	$(WORKERS) --timeout 1800 -m "long and not crowd" $(TEST_ARGS)
	$(TWICE) -m "crowd and long" $(TEST_ARGS)

# A fresh Monte Carlo of effects hidden by the simulator: make hidden CASES=100 SEED=7
CASES ?= 40
SEED ?= 1
hidden: install
	PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/hidden/montecarlo.py --cases $(CASES) --seed $(SEED) $(HIDDEN_ARGS)

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

# A million damaged packets through the serial decoder: make fuzz FUZZ_SEED=7
fuzz: install
	$(BIN)/python -m pytest -m slow -s tests/drivers/serial/test_fuzz.py

# A Debian package for controllers with this Python or another: make deb FOR=3.13
FOR ?= $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
deb: install
	PYTHON=$(BIN)/python deploy/package.sh --python $(FOR) out

# Installs armd on a Debian booted as a guest, under User-Mode Linux or, MACHINE=qemu, in software;
# fails with BROKEN=1, as a broken daemon must.
system-test: install
	$(BIN)/python -m pytest tests/deploy/test_system.py -m slow -s

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
