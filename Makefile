# Two commands on a fresh machine with Python 3.11+, gcc and make:
#   make demo     a simulated arm, live, corrected for temperature
#   make test     format, lint, types, import layers, tests
# make test-all then runs everything else.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# A program of tests/: it may import what stands there
SCRIPT := PYTHONPATH=tests $(BIN)/python
# Hundreds of tests start a process each; without these files each would compile all of armd
export PYTHONDONTWRITEBYTECODE :=

.PHONY: install demo test test-parallel test-serial test-all test-slow test-long lint bench clean hidden hidden-freeze hidden-compare hidden-reliability hidden-ablation hidden-sensitivity hidden-predictive mutants outsider interim interim-reliability soak fuzz scale system-test deb paper real so101 so101-live circle page browser picture
.PHONY: develop notebooks docs
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
# A command, and after it what it did and the seconds it took: $(call timed,WHAT,COMMAND)
timed = @from=$$(date +%s); $(2) && echo "armd: $(1): $$(($$(date +%s) - from)) s"

install: $(VENV)/.installed

$(VENV)/.made:
	$(call timed,virtual environment,$(PYTHON) -m venv $(VENV))
	@touch $@

# All that runs, development tools not among it
$(VENV)/.installed: requirements.txt pyproject.toml | $(VENV)/.made
	rm -rf build
	@echo "armd: installing into $(VENV): 0.7 GB on disk, some 200 MB to fetch"
	$(call timed,packages,$(PIP) install -r requirements.txt)
	$(call timed,armd itself,$(PIP) install --no-build-isolation --no-deps --editable .)
	@echo "armd: compiling the kernel for this machine and any arm: a minute, once"
	$(call timed,kernel,$(BIN)/python -I -m armd.compiled.ahead --anew)
	@touch $@

# Development tools, beside them
develop: $(VENV)/.dependencies
$(VENV)/.dependencies: requirements-dev.txt | $(VENV)/.installed
	@echo "armd: development tools into $(VENV): 0.9 GB on disk, some 230 MB to fetch"
	$(call timed,development tools,$(PIP) install -r requirements.txt -r requirements-dev.txt)
	@# which otherwise every one of the tests' workers compiles for itself
	$(call timed,bytecode of the tests,$(BIN)/python -m pytest --collect-only --quiet > $(VENV)/tests.txt || \
	    { tail -20 $(VENV)/tests.txt; false; })
	@touch $@

# A demo starts within a minute: its packages are installed without the compiler (0.2 GB), which
# meanwhile compiles, from a folder of its own, for the demo's arm alone. Where no C++ compiler links
# that, the daemon compiles when it starts. Other arms want all of `make install`.
COMPILES := numba llvmlite
IMPORTS := annotated-types cobs fastcrc numpy platformdirs pydantic pydantic_core pyserial setuptools \
           typing-inspection typing_extensions
COMPILER := $(VENV)/compiler
demo: $(if $(wildcard $(VENV)/.installed)$(filter --can --servo% --joints%,$(DEMO_ARGS)),install,$(VENV)/.demo)
	$(BIN)/armd demo $(DEMO_ARGS)

$(VENV)/.demo: requirements.txt pyproject.toml | $(VENV)/.made
	@echo "armd: installing into $(VENV) what the demo needs: 0.5 GB on disk, some 200 MB to fetch"
	@$(MAKE) --no-print-directory -j3 demo-packages demo-live demo-sessions
	@if [ -e $(COMPILER)/.cannot ]; then $(PIP) install --no-deps -c requirements.txt $(COMPILES); fi
	@rm -rf $(COMPILER)
	@touch $@

# The kernel's two halves beside each other; the packages take what two processors have left
.PHONY: demo-packages demo-compiler demo-live demo-sessions
AHEAD = PYTHONPATH=$(COMPILER) $(BIN)/python -m armd.compiled.ahead --into $(VENV)/share/armd --demo $(1) \
    || touch $(COMPILER)/.cannot
demo-packages:
	$(call timed,packages,grep -v $(COMPILES:%=-e '^%=') requirements.txt > $(VENV)/demo.txt && \
	    nice $(PIP) install --no-compile --no-deps -r $(VENV)/demo.txt)
	$(call timed,armd itself,nice $(PIP) install --no-build-isolation --no-deps --editable .)

demo-compiler:
	$(call timed,compiler,$(PIP) install --no-compile --no-deps -c requirements.txt --upgrade \
	    --target $(COMPILER) $(COMPILES) $(IMPORTS))
	@# which otherwise each half compiles for itself
	-@$(BIN)/python -m compileall -q -j 2 -x '/(tests|cuda)/' $(COMPILER)/numba $(COMPILER)/llvmlite

demo-live: demo-compiler
	$(call timed,kernel for the demo's live points,$(call AHEAD,live))

demo-sessions: demo-compiler
	$(call timed,kernel for the demo's sessions,$(call AHEAD,sessions))

lint: develop
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Three workers for two processors, because many tests wait (five took 376 s where three took 332);
# then those marked serial, which wait most of the time, two at once. The slow tests wait more: five.
# A choice of tests (TEST_ARGS="-k wire") may leave one of the two parts empty: pytest's code 5.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --durations=20
WORKERS := $(PYTEST) -n 5 --dist loadfile
SERIAL  := $(PYTEST) -n 2 --dist loadfile
EMPTY_IS_FINE := $(if $(TEST_ARGS),|| [ $$? = 5 ])
# Where serial tests are: to collect all others takes longer than to run some of these
SERIAL_IN := $(if $(TEST_ARGS),,$$(grep -rl --include='test_*.py' 'mark\.serial' tests))

# Lint runs beside the serial tests, which wait most of the time, and is shown after them
test:
	@echo "armd: lint and tests take five minutes on two cores, once armd is installed"
	@$(MAKE) --no-print-directory develop
	@began=$$(date +%s); $(MAKE) --no-print-directory test-parallel; parallel=$$?; \
	    nice $(MAKE) --no-print-directory lint > $(VENV)/lint.log 2>&1 & lint=$$!; \
	    $(MAKE) --no-print-directory test-serial; serial=$$?; \
	    wait $$lint; lint=$$?; cat $(VENV)/lint.log; \
	    echo "armd: make test took $$(($$(date +%s) - began)) s"; exit $$((parallel | serial | lint))

test-parallel: develop
	$(PYTEST) -n 3 --dist loadfile --no-loadscope-reorder -m "not slow and not serial" \
	    $(TEST_ARGS) $(EMPTY_IS_FINE)

test-serial: develop
	$(SERIAL) -m "serial and not slow" $(SERIAL_IN) $(TEST_ARGS) $(EMPTY_IS_FINE)

# What make test leaves out, save make test-long
test-all:
	@echo "armd: everything else has 75 minutes on two cores"
	@$(MAKE) --no-print-directory develop
	@began=$$(date +%s); \
	    for part in paper real browser test-slow scale docs "soak MINUTES=2" \
	        "fuzz MINUTES=10" system-test; do \
	        $(MAKE) --no-print-directory $$part || exit; \
	    done; \
	    echo "armd: make test-all took $$(($$(date +%s) - began)) s"

SLOW := slow and not long
test-slow: develop
	@echo "armd: the slow tests take about half an hour on two cores"
	$(WORKERS) --timeout 900 -m "$(SLOW) and not crowd and not serial" \
	    --ignore tests/deploy/test_system.py $(TEST_ARGS) $(EMPTY_IS_FINE)
	$(PYTEST) --timeout 900 -m "$(SLOW) and (crowd or serial)" \
	    --ignore tests/deploy/test_system.py $(TEST_ARGS) $(EMPTY_IS_FINE)

# Minutes each: many more cases of what the slow tests have a few of, and another processor
test-long: develop
	@echo "armd: the long tests take about half an hour on two cores"
	$(WORKERS) --timeout 1800 -m "long and not crowd and not serial" $(TEST_ARGS) $(EMPTY_IS_FINE)
	$(PYTEST) --timeout 1800 -m "long and (crowd or serial)" $(TEST_ARGS) $(EMPTY_IS_FINE)

# A fresh Monte Carlo of effects hidden by the simulator: make hidden CASES=100 SEED=7
CASES ?= 40
SEED ?= 1
hidden: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/hidden/montecarlo.py --cases $(CASES) --seed $(SEED) $(HIDDEN_ARGS)

# The frozen cases, which two revisions are compared on (CONTRIBUTING.md). hidden-freeze draws those
# of a seed into .cache/hidden and checks their SHA-256; RECORD=1 keeps it, ANEW=1 draws again.
# make hidden-compare BASE=f83ffbf [KIND='*thermal*,clean'] [CASES=2] [HEAD=main]
FROZEN := PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 nice -n 15 $(BIN)/python -m hidden.frozen.
# 421 and all cases, unless the command line says otherwise
FROZEN_SEED = $(if $(filter file,$(origin SEED)),421,$(SEED))
CASES_ASKED = $(if $(filter file,$(origin CASES)),,$(CASES))
hidden-freeze: develop
	$(FROZEN)freeze --seed $(FROZEN_SEED) --kinds "$(or $(KIND),*)" \
	    $(if $(CASES_ASKED),--cases $(CASES_ASKED)) $(if $(RECORD),--record) $(if $(ANEW),--anew)

hidden-compare: develop
	$(FROZEN)compare --seed $(FROZEN_SEED) --base "$(BASE)" --head "$(or $(HEAD),HEAD)" \
	    --kinds "$(or $(KIND),*)" $(if $(CASES_ASKED),--cases $(CASES_ASKED)) $(COMPARE_ARGS)

# Whether probabilities, intervals and promised gains hold, over the frozen cases of some seeds:
# make hidden-reliability SEEDS=421 [CASES=2] [HEAD=main]
hidden-reliability: develop
	$(FROZEN)reliability --seeds "$(or $(SEEDS),421)" --head "$(or $(HEAD),HEAD)" \
	    $(if $(CASES_ASKED),--cases $(CASES_ASKED))

# What each rule of the diagnosis is good for: the frozen cases in which it changes something, without
# it. make hidden-ablation SEEDS=421,301126 [CASES=2] [ABLATION_ARGS="--most 8"]
hidden-ablation: develop
	$(FROZEN)ablation --seeds "$(or $(SEEDS),421)" \
	    $(if $(CASES_ASKED),--cases $(CASES_ASKED)) $(ABLATION_ARGS)

# Each constant that decides, halved and doubled, in frozen cases in which a rule decided (by the
# ablation of the same commit), 12 in all or CASES: make hidden-sensitivity SEEDS=421,301126 [CASES=8]
hidden-sensitivity: develop
	$(FROZEN)sensitivity --seeds "$(or $(SEEDS),421)" \
	    $(if $(CASES_ASKED),--most $(CASES_ASKED)) $(SENSITIVITY_ARGS)

# Cases of a generator that shares nothing with armd, n of each kind, through the commands:
# make outsider CASES=2 SEED=7
outsider: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/outsider/run.py --cases $(CASES) --seed $(SEED) $(OUTSIDER_ARGS)

# Interim checks against an oracle, the table of docs/how-to/interim.md: make interim CASES=40 SEED=2
interim: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/interim/montecarlo.py --cases $(CASES) --seed $(SEED)

# Whether the probabilities of interim checks hold: make interim-reliability CASES=200 SEED=2
interim-reliability: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/interim/reliability.py --changes $(CASES) --seed $(SEED)

# Does the planted cause's own variable leave its band most? make hidden-predictive CASES=5 SEED=7
hidden-predictive: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/hidden/predictive_numbers.py --cases $(CASES) --seed $(SEED) $(HIDDEN_ARGS)

# Which fast test catches each of some drawn mutations of the sources: make mutants SEED=421 CASES=200
# and, once tests changed, whether each is still caught: make mutants BEFORE=FILE, the first run's
mutants: develop
	OPENBLAS_NUM_THREADS=1 $(SCRIPT) tests/mutants/run.py --head "$(or $(HEAD),HEAD)" \
	    --seed $(FROZEN_SEED) --cases $(or $(CASES_ASKED),200) $(if $(BEFORE),--before "$(BEFORE)") $(MUTANTS_ARGS)

# Simulator, daemon and subscribers under random faults, every point accounted for:
# make soak MINUTES=60 SEED=3
MINUTES ?= 2
soak: develop
	$(SCRIPT) tests/scenarios/soak.py --minutes $(MINUTES) --seed $(SEED)

# Damaged input at every door: files, wires, page, I++, messages. What breaks one is kept in
# out/fuzz: make fuzz MINUTES=60 SEED=3
fuzz: develop
	$(SCRIPT) tests/fuzz/run.py --minutes $(MINUTES) --seed $(SEED) $(FUZZ_ARGS)

# The programs of docs/how-to/scale.md on local clusters, Ray among them, which 240 MB come with
scale: develop
	$(PIP) install -r requirements.txt -r requirements-dev.txt -r requirements-scale.txt
	$(BIN)/python -m pytest --durations=20 --timeout 900 tests/public/test_public_scale.py

# The notebooks of docs/notebooks run from empty folders; with their outputs they go to out/notebooks
notebooks: develop
	$(PIP) install -r requirements.txt -r requirements-dev.txt -r requirements-docs.txt
	ARMD_NOTEBOOKS=$(CURDIR)/out/notebooks $(BIN)/python -m pytest --durations=20 --timeout 900 \
	    tests/public/test_public_notebooks.py

# A site of README.md, docs/, the notebooks with their outputs and the docstrings: out/site/index.html.
# Every warning is an error; then every link is followed, and every public name looked up.
docs: notebooks
	rm -rf out/site
	$(BIN)/python -m sphinx -q -E -W --keep-going -c docs/site -d .cache/site . out/site
	cp out/site/README.html out/site/index.html
	ARMD_SITE=$(CURDIR)/out/site $(BIN)/python -m pytest tests/public/test_public_site.py

# A Debian package for controllers with this Python or another: make deb FOR=3.13
FOR ?= $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
deb: install
	PYTHON=$(BIN)/python deploy/package.sh --python $(FOR) out

# Installs armd on a Debian booted as a guest, under User-Mode Linux or, MACHINE=qemu, in software;
# fails with BROKEN=1, as a broken daemon must.
system-test: develop
	$(BIN)/python -m pytest --durations=20 tests/deploy/test_system.py -m slow -s

# The founding paper's experiment, its tables beside ours
paper: install
	$(SCRIPT) tests/scenarios/paper.py

# From box to certificate on a simulated SO-101, each figure printed: make so101 SEED=3
so101: install
	$(SCRIPT) tests/scenarios/so101.py --seed $(SEED)

# The same over the wire: servo packets on a pseudo-terminal, armd run, armd measure
so101-live: install
	$(SCRIPT) tests/scenarios/so101_live.py --seed $(SEED)

# An arm goes wrong, is measured, diagnosed, mended and verified over the wire, figures printed
circle: install
	$(SCRIPT) tests/scenarios/circle.py --seed 5

# Real measured data; DATA=../shared/data for copies of your own
real: develop
	$(SCRIPT) tests/real/marks.py $(DATA)
	$(SCRIPT) tests/real/diagnosis_marks.py $(DATA)

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
picture: develop browser
	$(SCRIPT) tests/bridges/picture.py out/view.png && cp out/view.png docs/view.png

# docs/tutorials/gallery.md and its pictures anew
.PHONY: gallery
gallery: develop browser
	$(SCRIPT) tests/bridges/gallery.py docs/tutorials

# The recording of `make demo` for the README anew, on a machine that does nothing else
.PHONY: recording
recording: install
	$(SCRIPT) tests/scenarios/recording.py docs/demo.svg

# Figures and ratios measured in one run, as text and as out/bench.json; BENCH="kernel wire"
bench: develop
	$(SCRIPT) tests/benchmarks/run.py $(BENCH)

clean:
	rm -rf $(VENV) build .cache *.egg-info
