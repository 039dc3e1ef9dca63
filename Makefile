# make demo        everything, on the clips that come with pumps: install, train for minutes, fill, measure, report
# make reproduce   the same on your own data: DATA='a.zip b/ c.bvh' PRESET=tiny RUN=mine
#                  optional: SPLITS=splits.json  FPS_OVERRIDE='*walk*=60'  SET='train-ae.steps=500 train-ae.seed=1'
#                  COMPARE='small' measures and plays shipped weights beside those trained
# make table1      PUMPS Table 1: eight methods trained on each of two rigs, BUDGET=12 minutes each, WINDOWS=30 of each kind of
#                  motion; `make -j2 table1 GOAL=g1` for one rig; `make table1 GOAL=curve`: error against training time
# make figures     table1 as one page for each rig: error against gap, spectra, film strips, all methods in sync
# make table2      PUMPS Table 2: the autoencoder and six that differ from it in one thing each
# make table3      PUMPS Table 3: motion from 2D keypoints, by the synthesiser and by other networks; TABLE3_STEPS=400
# make table4      PUMPS Table 4: noisy motion cleaned, by filters, priors, networks and the synthesiser; TABLE4_STEPS=300 TABLE4_WINDOWS=20
# make table-trackers  head and two hands in, motion out; TRACKERS_STEPS=300. GOAL=curve of it, table3, table4: error against CURVE_MINUTES=8
# make spectral-tables | spectral-pages  SpecTrHuMS' tables on bodies and cloth, and what its networks predict, as pages and
#                  film strips: SPECTRAL_STEPS=400 PRESET=spectral-small SPECTRAL_CLOTHS=64 SPECTRAL_WINDOWS=60 SPECTRAL_IDENTITIES=8 (docs/meshes.md)
# make body-parts-table1 | body-parts-table2 | body-parts-table3   autoencoders of body parts: sixteen bodies, seen and unseen data,
#                  noise; BODY_PARTS_STEPS=6000 each, BODY_PARTS_WINDOWS=200 of each data set; make -j2 trains two at a time
# make concepts-tables   motion concepts: generated motions refined, beside real ones; CONCEPTS_SET=hdm05|bandai-namco-1|bandai-namco-2
#                  CONCEPTS_STEPS=2000 of each training, CONCEPTS_COUNT=200 motions of each action; GOAL=main for Tables 1 and 8, methods for 9 and 10, fills for gaps
# make pcmrl-table1 | pcmrl-table2 | pcmrl-table3   PC-MRL's tables, Bandai Namco to CMU and back
# make rig-report  the rig networks of these tables on the rigs' own test motions, beside the truth
# make latent-report  how far latents move when points, sigma, body or skeleton change; LATENT_WEIGHTS=small-free
# make solve-report   how well skeletons follow true, noisy, larger and smaller clouds; SOLVE_CLIPS=40
# make solve-pages    truth, slerp, solve and networks side by side in 3D: runs/solve/solve.html; SOLVE_NETWORKS=NAME=FOLDER
# make held-out | unseen-rigs  weights on whole archives, or on rigs (RIGS='rigs.zip a.bvh'), that they were not trained on;
#                  HELD_OUT_WEIGHTS=small HELD_OUT_WINDOWS=40
# make weights-report  measures the weights that ship, and writes docs/results.md; HELD_OUT_WINDOWS=10 is faster
# make pretrain    weights from the archives: RECIPE=small|small-free SLICE=9 (minutes; 0 to the end); the same command goes
#                  on (docs/pretraining.md). INITIAL=, AE=: weights to start from; ROUNDS=: trainings in rounds; CALIBRATE=:
#                  further recordings for the trust in them; TRAIN_FLAGS='--workers 8'. Parts: pretrain-data, -measure, -bundle TO=
# make lifter      trains the network that `pumps estimate` uses by default, on free archives; SLICE=9, INITIAL=
# make gallery | first-animation | first-picture  a page of clips, an SVG of three rigs, a picture of one gap, filled by GALLERY_WEIGHTS=small, by each of ANIMATED='small-free mine', by each of PICTURED='small-free small'
# make retarget-report  motions on other rigs: how near hands and feet come to their places
# make any-humanoid   how often bodies are found on rigs without names, into docs/formats.md; DATA='a.zip b.zip'
# make bench-train    times training steps, into docs/performance.md; PRESET, DEVICE=cuda, BATCH=40, AUTHORS=adapter.py
# make bench       all benchmarks that guard a figure (PAGE=docs/performance.md writes them there); make bench-compare BASE=COMMIT fails if one takes over 1.1 times as long
# make bench-ingest   times reading, beside other libraries, into docs/performance.md; DATA='a.zip b.zip'
# make test        linters, types, import directions, tests
# make fuzz        coverage-guided fuzzing of every reader and of the artefact reader; MINUTES=10 each, TARGETS='bvh urdf'
# make docs        the documentation as a site that opens offline, runs/site/html; also make install | lint | clean-run RUN=mine | help
#
# All of them take RUN, PRESET, DATA and SET. Tables read archives in SHARED_DATA (../shared/data), which `pumps data list`
# names with their sources. What a run makes lies in runs/RUN; `pumps config write` writes its settings and its makefile
# runs/RUN/run.mk, from the stages' registry or from a recipe (`pumps config recipes`). Files are targets: a second call
# does only what is out of date, and a killed one goes on where it was.

# Threads that wait sleep soon, as in pumps itself. OMP_WAIT_POLICY=active is faster where no other work shares the cores.
export OMP_WAIT_POLICY ?= passive
ifeq ($(OMP_WAIT_POLICY),passive)
export GOMP_SPINCOUNT ?= 2000
endif
export KMP_BLOCKTIME ?= 0

PYTHON ?= python3
VENV   ?= .venv
PUMPS  ?= $(VENV)/bin/pumps
RUNS   ?= runs
SHARED_DATA ?= ../shared/data
PICTURED ?= small-free small
RECIPE  ?= small
SLICE   ?= 0
TRAIN_FLAGS ?=
TO      ?= $(RUNS)/$(or $(RUN),$(RECIPE))/bundle

.PHONY: help install install-dev docs demo reproduce fill table1 figures table2 table3 table4 table-trackers spectral-tables spectral-pages body-parts-table1 body-parts-table2 body-parts-table3 concepts-tables pcmrl-table1 pcmrl-table2 pcmrl-table3 rig-report latent-report solve-report solve-pages held-out unseen-rigs weights-report pretrain pretrain-data pretrain-measure pretrain-bundle lifter gallery first-animation first-picture retarget-report any-humanoid bench bench-compare bench-train bench-ingest lint test fuzz clean-run
.SUFFIXES:

help:
	@awk '/^#/ { sub(/^# ?/, ""); print; next } { exit }' Makefile

# ---- installing ------------------------------------------------------------------------------------------------

install: $(VENV)/installed
install-dev: $(VENV)/installed-dev
docs: $(VENV)/installed-docs ; $(VENV)/bin/python docs/site/build.py -o '$(RUNS)/site'
$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("pumps needs Python 3.10 or newer, this is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(VENV)/bin/python -m pip install --quiet -c constraints.txt -e .
	@touch $@

$(VENV)/installed-dev $(VENV)/installed-bench $(VENV)/installed-fuzz $(VENV)/installed-mesh $(VENV)/installed-docs: $(VENV)/installed%: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(VENV)/bin/python -m pip install --quiet -c constraints.txt -e '.[dev$(patsubst -%,$(comma)%,$(filter -bench -fuzz -mesh -docs,$*))]'
	@touch $(VENV)/installed $@
comma := ,

# ---- runs ------------------------------------------------------------------------------------------------------

# $(1): the recipe, which names the run unless RUN does; `mine` is the stages' own pipeline. $(2): a goal of the recipe, or
# nothing for its first. $(3): further flags for its settings. $(4): variables for its makefile.
define made
	@$(PUMPS) config write --run '$(RUNS)/$(or $(RUN),$(1))' $(patsubst %,--recipe % --data '$(SHARED_DATA)',$(filter-out mine,$(1))) \
	  $(PRESET:%=--preset '%') $(foreach each,$(DATA),--source '$(each)') $(SPLITS:%=--set 'ingest.splits=%') \
	  $(foreach each,$(FPS_OVERRIDE),--set 'ingest.fps_override=$(each)') $(foreach each,$(SET),--set '$(each)') $(3)
	+@$(MAKE) --no-print-directory run$(2:%=-%) RUN='$(or $(RUN),$(1))' $(4)
endef

R := $(RUNS)/$(or $(RUN),mine)
ifneq (,$(wildcard $(R)/run.mk))
include $(R)/run.mk
else
run run-data run-measure run-pages run-rigs run-bandai run-g1 run-curve run-figures run-bandai-figures run-g1-figures run-table1 run-table2 run-table3 run-table4 run-main run-methods run-fills:
	@test -f $(R)/run.mk || { echo '$(R)/run.mk is not there; the target that makes the run writes it.' >&2; exit 2; }
endif

demo: install
	@$(MAKE) --no-print-directory fill RUN=demo PRESET=demo DATA=stages/shared/clips COMPARE='small small-free'

reproduce: install
	@test -n '$(DATA)' || { echo "make reproduce needs recordings: DATA='recordings/ more.zip'." >&2; exit 2; }
	@$(MAKE) --no-print-directory fill

fill:
	$(call made,mine,,--with 'weights=$(COMPARE)')

# Tables and reports: each a recipe (stages/shared/presets/recipes), with parameters from make's variables.
include tables.mk

weights-report: install-dev
	$(call made,weights,,--with 'windows=$(HELD_OUT_WINDOWS)')
	$(VENV)/bin/python benchmarks/weights_tables.py '$(RUNS)/$(or $(RUN),weights)' --page docs/results.md

# Where PUMPS is given, nothing is installed. A run whose motions are not there trains all the same, and is not measured.
UNTIL_SLICE = $(if $(filter-out 0,$(SLICE)),UNTIL=$$(awk "BEGIN { print int($$(date +%s) + 60 * $(SLICE)) }"))
pretrain pretrain-data pretrain-measure: $(if $(filter file,$(origin PUMPS)),install)
	$(call made,$(RECIPE),$(filter data measure,$(@:pretrain-%=%)),--with 'initial=$(INITIAL)' --with 'ae=$(AE)' --with 'rounds=$(ROUNDS)' --with 'calibrate=$(CALIBRATE)',$(UNTIL_SLICE))
	@$(if $(filter pretrain,$@),test ! -d '$(RUNS)/$(or $(RUN),$(RECIPE))/ingest' || $(MAKE) --no-print-directory run-measure RUN='$(or $(RUN),$(RECIPE))')

# A few files under 16 MiB; `cat FOLDER/small.tar.* | tar x` gives the folder of weights back.
pretrain-bundle:
	@mkdir -p '$(TO)' && rm -f '$(TO)'/$(RECIPE).tar.*
	tar -C '$(RUNS)/$(or $(RUN),$(RECIPE))/packed' -cf - $(RECIPE) | split -b 15m - '$(TO)/$(RECIPE).tar.'
	@ls -l '$(TO)'

clean-run:
	rm -rf '$(R)'

gallery: install
	@$(VENV)/bin/python benchmarks/gallery.py '$(SHARED_DATA)' '$(RUNS)/gallery' --picture docs/pictures/gallery.svg $(GALLERY_WEIGHTS:%=--weights '%')

first-animation: install ; $(VENV)/bin/python benchmarks/first_animation.py '$(RUNS)/$@' $(ANIMATED:%=--weights '%')
first-picture: install
	$(foreach each,$(PICTURED),$(PUMPS) infill stages/shared/clips/dance_b.bvh --keyframes every:15 -o '$(RUNS)/gallery/$(each).bvh' --overwrite --weights '$(each)' &&) true
	$(PUMPS) report --motions truth=stages/shared/clips/dance_b.bvh $(foreach each,$(PICTURED),--motions '$(each)=$(RUNS)/gallery/$(each).bvh') --keyframes every:15 -o '$(RUNS)/gallery/filled.html' --overwrite --picture docs/pictures/first-fill.svg

retarget-report: install-dev
	$(VENV)/bin/python benchmarks/retargeting.py --archives '$(SHARED_DATA)' --page docs/results.md

any-humanoid: install-dev
	$(VENV)/bin/python benchmarks/any_humanoid.py $(DATA) --most 160 --page docs/formats.md

# ---- times and tests -------------------------------------------------------------------------------------------

DEVICE  ?= cpu
BATCH   ?= 2
MINUTES ?= 1

bench bench-compare: install-dev
	OMP_NUM_THREADS=1 $(VENV)/bin/python benchmarks/$(if $(filter bench,$@),guards.py $(PAGE:%=--page '%'),two_versions.py --base '$(BASE)')

bench-train: install-dev
	$(VENV)/bin/python benchmarks/training_step.py --device $(DEVICE) --batch $(BATCH) $(AUTHORS:%=--authors '%') --preset $(or $(PRESET),paper) --page docs/performance.md

bench-ingest: $(VENV)/installed-bench
	$(VENV)/bin/python benchmarks/reading.py $(DATA) --page docs/performance.md

lint: install-dev
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/pyright --pythonpath $(VENV)/bin/python
	$(VENV)/bin/lint-imports

# One thread a process: two processes whose libraries each take both cores wait for each other most of the time.
test: lint
	OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n 2 $(PYTEST_FLAGS)

# Corpora and failing inputs are written to runs/fuzz. atheris has no wheels for some systems: only this target installs it.
fuzz: $(VENV)/installed-fuzz
	OMP_NUM_THREADS=1 $(VENV)/bin/python -m tests.fuzz.run --minutes $(MINUTES) --folder '$(RUNS)/fuzz' $(TARGETS)
