# make demo        everything, on the embedded clips: install, train for a few minutes, fill, measure, report
# make reproduce   the same on your own data: DATA='a.zip b/ c.bvh' PRESET=tiny RUN=mine
#                  optional: SPLITS=splits.json  FPS_OVERRIDE='*salsa*=60'  SET='train-ae.steps=500 train-ae.seed=1'
#                  COMPARE='tiny' measures shipped weights beside those trained
# make table2      PUMPS Table 2: the autoencoder and six changed in one thing each, trained and measured alike
#                  optional: DATA, SPLITS, RUN, PRESET, SET as above
# make solve-report   how well skeletons follow true, noisy, larger and smaller clouds; SOLVE_CLIPS=40
# make solve-pages    truth, slerp, solve and networks side by side in 3D, on every archive's rig: runs/solve/solve.html
# make latent-report  how far latents move when points, sigma, body or skeleton change; LATENT_WEIGHTS=tiny
# make pcmrl-table1 | pcmrl-table2 | pcmrl-table3
#                  PC-MRL's tables, Bandai Namco to CMU and back; SHARED_DATA, BANDAI, CMU name the archives;
#                  optional: RUN (pcmrl), PRESET (pcmrl), SET='train-citl.steps=20000', another RUN for other settings
# make pretrain    weights from the archives, in slices: RECIPE=small|small-free SLICE=9 (minutes; 0 to the end); again
#                  goes on; docs/pretraining.md. Its parts: pretrain-data, pretrain-measure, pretrain-bundle TO=folder
# make held-out    weights on whole archives that they never saw, with feel; HELD_OUT_WEIGHTS=small-free
#                  HELD_OUT_WINDOWS=40 (for each archive and task); DATA names other recordings
# make unseen-rigs  test clips put on rigs that weights never saw, and measured there; RIGS='rigs.zip a.bvh'
# make weights-report  measures the weights that ship, as above and on their own archives, and writes docs/results.md
# make gallery     twelve clips on six rigs, filled: truth, slerp and pumps side by side in runs/gallery/gallery.html, and
#                  the picture docs/pictures/gallery.svg; GALLERY_WEIGHTS=small (default: those that infill takes)
# make first-picture  the picture of the README's first example
# make rig-report  the same tables' rig networks on the rigs' own test motions, beside the truth
# make retarget-report  motions on other rigs, how near hands and feet come to their places
# make test        linters, types, import directions, tests
# make fuzz        20 times as many damaged files for every reader as the tests give them; TIMES=200 for more
# make bench-train   times training steps at the paper's sizes and writes docs/performance.md; PRESET, DEVICE=cuda,
#                  BATCH=40, AUTHORS=adapter.py (another implementation's step, timed beside ours)
# make bench-ingest  times reading, beside other libraries, and writes docs/performance.md; DATA='a.zip b.zip'
# make any-humanoid  how often bodies are found on rigs without names, and writes docs/formats.md; DATA='a.zip b.zip'
# make lint | bench | clean-run RUN=mine | help
#
# A run's files are targets: a second call does only what is out of date, and a killed one goes on where it was.

# Threads that wait soon sleep, as in pumps itself, so that scripts beside it do the same: spinning they wait for one
# another where other work shares the cores. OMP_WAIT_POLICY=active is faster where none does.
OMP_WAIT_POLICY ?= passive
export OMP_WAIT_POLICY
ifeq ($(OMP_WAIT_POLICY),passive)
export GOMP_SPINCOUNT ?= 2000
endif
export KMP_BLOCKTIME ?= 0

PYTHON ?= python3
VENV   ?= .venv
PUMPS  ?= $(VENV)/bin/pumps
RUNS   ?= runs
# The two recipes of weights that ship; a run is called by its recipe.
RECIPE ?= small
PRETRAIN_small      := bandai-namco-1 bandai-namco-2 cmu-dance cmu-asfamc lafan1-g1
PRETRAIN_small-free := cmu-dance cmu-asfamc
ifneq (,$(filter pretrain%,$(MAKECMDGOALS)))
RUN    ?= $(RECIPE)
PRESET ?= small
DATA   ?= $(foreach name,$(PRETRAIN_$(RECIPE)),$(SHARED_DATA)/$(name).zip)
FPS_OVERRIDE ?= *salsa*=60
endif
RUN    ?= mine
PRESET ?= tiny
DATA   ?=
SET    ?=
COMPARE  ?=
FPS_OVERRIDE ?=
# Where the archives of public data lie that the tables are made from, unless DATA names others.
SHARED_DATA ?= ../shared/data

# The splits beside the data, where there are some.
SPLITS ?= $(firstword $(wildcard $(addsuffix /splits.json,$(DATA)) $(addsuffix splits.json,$(dir $(DATA)))))

SHIPPED := $(patsubst stages/shared/weights/%/ae/manifest.json,%,$(wildcard stages/shared/weights/*/ae/manifest.json))

EMPTY :=
SPACE := $(EMPTY) $(EMPTY)

R := $(RUNS)/$(RUN)
C := $(R)/config

.PHONY: pretrain-rounds gallery first-picture weights-report weights-measured held-out held-out-measured unseen-rigs unseen-rigs-measured pretrain pretrain-run pretrain-sampled pretrain-train pretrain-data pretrain-pack pretrain-measure pretrain-bundle help demo reproduce configure picked dag fill table2 table2-rows latent-report latents solve-report solve-measured solve-pages solve-played solve-page test lint bench bench-train bench-ingest retarget-report any-humanoid install install-dev clean-run pcmrl-table1 pcmrl-table2 pcmrl-table3 fuzz
.SUFFIXES:

help:
	@awk '/^#/ { sub(/^# ?/, ""); print; next } { exit }' Makefile

# ---- installing ------------------------------------------------------------------------------------------------

install: $(VENV)/installed
install-dev: $(VENV)/installed-dev

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("pumps needs Python 3.10 or newer, this is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(VENV)/bin/python -m pip install --quiet -c constraints.txt -e .
	@touch $@

$(VENV)/installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(VENV)/bin/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	@touch $(VENV)/installed $@

# ---- running ---------------------------------------------------------------------------------------------------

demo: install
	@$(MAKE) --no-print-directory fill RUN=demo PRESET=demo DATA=stages/shared/clips COMPARE='$(filter small small-free,$(SHIPPED))'

reproduce: install
	@test -n '$(DATA)' || { echo "make reproduce needs DATA, for example DATA='recordings/ more.zip'" >&2; exit 2; }
	@$(MAKE) --no-print-directory fill

# Settings first: they are written only where they changed. Then which clips to fill, which the data says. Then all.
fill: configure
	@$(MAKE) --no-print-directory picked
	@$(MAKE) --no-print-directory dag
	@$(PUMPS) results $(R)/evaluate
	@echo
	@echo 'Report: $(abspath $(R)/report/report.html)'

configure:
	@$(PUMPS) config write --preset $(PRESET) --run $(R) $(foreach each,$(DATA),--source '$(each)') \
	  $(if $(SPLITS),--set 'ingest.splits=$(SPLITS)') $(foreach each,$(FPS_OVERRIDE),--set 'ingest.fps_override=$(each)') \
	  $(foreach each,$(SET),--set '$(each)')

# ---- the stages ------------------------------------------------------------------------------------------------

CLIPS  := $(basename $(notdir $(wildcard $(R)/data-pick/*.bvh)))
FILLED := $(CLIPS:%=$(R)/infill/%.bvh)

.PRECIOUS: $(R)/%/manifest.json $(R)/infill/%.bvh $(R)/data-pick/%.bvh

# The recipes that do nothing keep make from saying that there was nothing to do.
picked: $(R)/data-pick/clips.txt
	@:

dag: $(R)/report/report.html $(R)/decode/manifest.json
	@:

$(R)/ingest/manifest.json: $(C)/ingest.toml $(C)/sources.txt
	$(PUMPS) ingest auto --config $< -o $(@D)

$(R)/sample-tpc/manifest.json: $(C)/sample-tpc.toml $(R)/ingest/manifest.json
	$(PUMPS) sample-tpc --config $< --motion $(R)/ingest -o $(@D)

$(R)/train-ae/manifest.json: $(C)/train-ae.toml $(R)/sample-tpc/manifest.json
	$(PUMPS) train ae --config $< --tpc $(R)/sample-tpc -o $(@D)
	@test -f $@ || { echo '$(@D): training stopped before its end; run make again to go on.' >&2; exit 1; }

$(R)/encode/manifest.json: $(C)/encode.toml $(R)/sample-tpc/manifest.json $(R)/train-ae/manifest.json
	$(PUMPS) encode --config $< --tpc $(R)/sample-tpc --ae $(R)/train-ae -o $(@D)

$(R)/train-lms/manifest.json: $(C)/train-lms.toml $(R)/sample-tpc/manifest.json $(R)/train-ae/manifest.json $(R)/encode/manifest.json
	$(PUMPS) train lms --config $< --tpc $(R)/sample-tpc --ae $(R)/train-ae --latent $(R)/encode -o $(@D)
	@test -f $@ || { echo '$(@D): training stopped before its end; run make again to go on.' >&2; exit 1; }

$(R)/data-pick/clips.txt: $(C)/data-pick.toml $(R)/ingest/manifest.json
	$(PUMPS) data pick --config $< --motion $(R)/ingest -o $(@D)

$(FILLED): $(R)/infill/%.bvh: $(C)/infill.toml $(R)/data-pick/clips.txt $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json
	@mkdir -p $(@D)
	$(PUMPS) infill $(R)/data-pick/$*.bvh --config $< --weights $(R) --overwrite -o $@

$(R)/decode/manifest.json: $(C)/decode.toml $(R)/ingest/manifest.json $(R)/train-ae/manifest.json $(R)/encode/manifest.json
	$(PUMPS) decode --config $< --latent $(R)/encode --ae $(R)/train-ae --motion $(R)/ingest -o $(@D)

$(R)/evaluate/manifest.json: $(C)/evaluate.toml $(R)/ingest/manifest.json $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json $(foreach each,$(COMPARE),$(wildcard stages/shared/weights/$(each)/*/manifest.json))
	$(PUMPS) evaluate --config $< --motion $(R)/ingest --weights pumps=$(R) $(addprefix --weights ,$(COMPARE)) -o $(@D)

$(R)/report/report.html: $(C)/report.toml $(R)/evaluate/manifest.json $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json $(FILLED)
	@mkdir -p $(@D)
	$(PUMPS) report --config $< --metrics $(R)/evaluate --checkpoints $(R)/train-ae --checkpoints $(R)/train-lms \
	  $(foreach clip,$(CLIPS),--motions '$(clip)/truth=$(R)/data-pick/$(clip).bvh' --motions '$(clip)/PUMPS=$(R)/infill/$(clip).bvh') -o $@

# ---- PUMPS Table 2 ---------------------------------------------------------------------------------------------

# Each row is the preset's autoencoder with one setting changed; `skinning`, our own head, is no row of the paper.
TABLE2_ROWS := full element-dropout sinusoidal chamfer vae-codes grid-codes skinning
ROW_element-dropout := --decoder.dropout-kind element
ROW_sinusoidal      := --decoder.positions sinusoidal
ROW_chamfer         := --loss chamfer
ROW_vae-codes       := --decoder.identities vae
ROW_grid-codes      := --decoder.identities grid
ROW_skinning        := --decoder.head skinning

TABLE2_DATA ?= $(foreach name,bandai-namco-1 cmu-dance lafan1-g1,$(SHARED_DATA)/$(name).zip)
# A table's own value, unless the user has given one.
unless_given = $(if $(filter file undefined,$(origin $(1))),$(2),$($(1)))

table2: install
	@$(MAKE) --no-print-directory table2-rows RUN='$(call unless_given,RUN,table2)' \
	  PRESET='$(call unless_given,PRESET,table2)' DATA='$(or $(DATA),$(TABLE2_DATA))' \
	  FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

table2-rows: configure
	@$(MAKE) --no-print-directory $(R)/measure-ae/manifest.json
	@$(PUMPS) results $(R)/measure-ae

.PRECIOUS: $(R)/rows/%/manifest.json
$(R)/rows/%/manifest.json: $(C)/train-ae.toml $(R)/sample-tpc/manifest.json
	$(PUMPS) train ae --config $< --tpc $(R)/sample-tpc $(ROW_$*) -o $(@D)
	@test -f $@ || { echo '$(@D): training stopped before its end; run make again to go on.' >&2; exit 1; }

$(R)/measure-ae/manifest.json: $(TABLE2_ROWS:%=$(R)/rows/%/manifest.json)
	$(PUMPS) measure ae --tpc $(R)/sample-tpc $(foreach row,$(TABLE2_ROWS),--weights $(row)=$(R)/rows/$(row)) -o $(@D)

# ---- how far latents move --------------------------------------------------------------------------------------

LATENT_WEIGHTS ?= tiny
LATENT_DATA ?= $(foreach name,bandai-namco-1 bandai-namco-2 cmu-dance lafan1-g1,$(SHARED_DATA)/$(name).zip)
# The embedded clips serve where there is nothing else; no weights saw them, so that all of them count as held out.
LATENT_HAVE = $(or $(DATA),$(wildcard $(LATENT_DATA)),stages/shared/clips)

latent-report: install
	@$(MAKE) --no-print-directory latents RUN='$(call unless_given,RUN,latents)' DATA='$(LATENT_HAVE)' \
	  FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

latents: configure
	@$(MAKE) --no-print-directory $(R)/latents-$(notdir $(LATENT_WEIGHTS))/manifest.json
	@$(PUMPS) results $(R)/latents-$(notdir $(LATENT_WEIGHTS))

$(R)/latents-$(notdir $(LATENT_WEIGHTS))/manifest.json: $(R)/ingest/manifest.json
	$(PUMPS) measure latents --motion $(R)/ingest --weights $(LATENT_WEIGHTS) -o $(@D) \
	  $(if $(filter stages/shared/clips,$(DATA)),--splits train --splits val --splits test)

# ---- weights that ship -----------------------------------------------------------------------------------------

# Two recipes of one preset: `small` learns from all archives, most of them non-commercial; `small-free` from CMU's
# alone, free for any use. A run may be copied to another machine and goes on there: what is done is told by what lies
# in it, not by the files' times. Without its motions (ingest) a copy trains all the same, and is measured at home.
#   SLICE        minutes until it stops with a checkpoint; 0: until all is done
#   INITIAL      folder of weights to start from, when slices lie on machines that keep nothing
#   AE           an autoencoder's checkpoint to take instead of training one
#   ROUNDS       so many trainings of the synthesiser, each from the mean of the last one's end and beginning; that mean
#                ships. 0: one training, and its end
#   CALIBRATE    further recordings whose validation clips say how far to trust the weights; two archives are few
#   TRAIN_FLAGS  for both trainings: '--workers 8 --cache-mb 2000'
SLICE       ?= 0
INITIAL     ?=
AE          ?=
ROUNDS      ?= 0
TRAIN_FLAGS ?=
CALIBRATE   ?= $(if $(filter small-free,$(RECIPE)),stages/shared/clips)
TO          ?= $(R)/bundle


pretrain: $(if $(filter file,$(origin PUMPS)),install)
	@$(MAKE) --no-print-directory pretrain-run UNTIL=$$(awk "BEGIN { print int($$(date +%s) + 60 * $(SLICE)) }")

pretrain-run:
	@test -f $(R)/sample-tpc/manifest.json || $(MAKE) --no-print-directory pretrain-data
	@$(MAKE) --no-print-directory pretrain-train
	@test ! -d $(R)/ingest || $(MAKE) --no-print-directory pretrain-measure

# The archives become one packed artefact: it is all that the trainings read.
pretrain-data: configure
	@$(MAKE) --no-print-directory pretrain-sampled
	@du -sh $(R)/sample-tpc
pretrain-sampled: $(R)/sample-tpc/manifest.json
	@:

# $(1): ae or lms. $(2): the folder. $(3): further flags. All may be words of the shell.
define trained
test -f $(2)/manifest.json || { \
	  left=$$(( $(UNTIL) - $$(date +%s) )); \
	  if test $(SLICE) != 0 && test $$left -le 0; then echo 'The time is over; run make again to go on.' >&2; exit 1; fi; \
	  $(PUMPS) train $(1) --config $(C)/train-$(1).toml --tpc $(R)/sample-tpc -o $(2) $(3) $(TRAIN_FLAGS) \
	    $(if $(filter-out 0,$(SLICE)),--max-time $$(awk "BEGIN { print $$left / 60 }")) && \
	  { test -f $(2)/manifest.json || { echo "$(2): stopped before its end; run make again to go on." >&2; exit 1; }; }; }
endef

# A stage's part of INITIAL, as a flag: $(1) is ae or lms.
begun_with = $(firstword $(wildcard $(INITIAL)/$(1) $(INITIAL)/train-$(1)))
initially  = $(if $(INITIAL),--initial $(call begun_with,$(1)))

pretrain-train:
	@test -z '$(AE)' || test -d $(R)/train-ae || cp -R '$(AE)' $(R)/train-ae
	@$(call trained,ae,$(R)/train-ae,$(call initially,ae))
	@$(call trained,lms,$(R)/train-lms,--ae $(R)/train-ae $(call initially,lms))
	@$(if $(filter-out 0,$(ROUNDS)),$(MAKE) --no-print-directory pretrain-rounds)
	@$(MAKE) --no-print-directory pretrain-pack

# Every further round begins with the mean of the last round's end and beginning, and draws other windows. What the
# first began with is none where nothing was given: its end then is its mean.
pretrain-rounds:
	@begin='$(if $(INITIAL),$(call begun_with,lms))'; end=$(R)/train-lms; \
	mean() { test -f "$$1/manifest.json" || $(PUMPS) weights average "$$end" $${begin:-"$$end"} -o "$$1"; }; \
	for round in $$(seq 2 $(ROUNDS)); do \
	  mean $(R)/round-$$round/begin || exit 1; \
	  begin=$(R)/round-$$round/begin; end=$(R)/round-$$round/train-lms; \
	  { $(call trained,lms,$$end,--ae $(R)/train-ae --initial $$begin --seed $$round); } || exit 1; \
	done; \
	mean $(R)/averaged/train-lms && { test -d $(R)/averaged/train-ae || cp -R $(R)/train-ae $(R)/averaged/; }

pretrain-pack:
	@$(PUMPS) weights pack $(R)$(if $(filter-out 0,$(ROUNDS)),/averaged) --name $(RECIPE) -o $(R)/packed/$(RECIPE)

# How far to trust them, by validation clips; then test clips of the run's own archives. The card then says what the
# weights are good and bad at.
pretrain-measure:
	@test -z '$(CALIBRATE)' || test -f $(R)/calibrate/manifest.json || $(PUMPS) ingest auto $(CALIBRATE) -o $(R)/calibrate
	@test -f $(R)/packed/$(RECIPE)/confidence.json || $(PUMPS) weights calibrate $(R)/packed/$(RECIPE) --motion $(R)/ingest \
	  $(if $(CALIBRATE),--motion $(R)/calibrate)
	@test -f $(R)/evaluate/manifest.json || \
	  $(PUMPS) evaluate --config $(C)/evaluate.toml --motion $(R)/ingest --weights pumps=$(R)/packed/$(RECIPE) -o $(R)/evaluate
	@$(PUMPS) results $(R)/evaluate
	@$(PUMPS) weights pack $(R)/packed/$(RECIPE) --name $(RECIPE) --measured $(R)/evaluate -o $(R)/measured/$(RECIPE)

# A few files under 16 MiB; `cat FOLDER/small.tar.* | tar x` gives the folder of weights back.
pretrain-bundle:
	@mkdir -p '$(TO)' && rm -f '$(TO)'/$(RECIPE).tar.* && tar -C $(R)/packed -cf - $(RECIPE) | split -b 15m - '$(TO)/$(RECIPE).tar.'
	@ls -l '$(TO)'

# ---- skeletons held out of training ----------------------------------------------------------------------------

# Of all archives at hand, those that no weights named here were trained on, with all their clips. Interpolation and
# transitions: predictions are not what the weights are for. Where there is no archive, the embedded clips serve.
HELD_OUT_WEIGHTS ?= $(firstword $(foreach each,small-free small tiny,$(filter $(each),$(SHIPPED))))
HELD_OUT_WINDOWS ?= 40
HELD_OUT_DATA    ?= $(foreach name,bandai-namco-1 bandai-namco-2 cmu-dance cmu-asfamc lafan1-g1,$(SHARED_DATA)/$(name).zip)
HELD_OUT_AT := evaluate-$(subst $(SPACE),-,$(notdir $(HELD_OUT_WEIGHTS)))-$(HELD_OUT_WINDOWS)

held-out: install
	@$(MAKE) --no-print-directory held-out-measured RUN='$(call unless_given,RUN,held-out)' \
	  DATA='$(or $(DATA),$(wildcard $(HELD_OUT_DATA)) stages/shared/clips)' \
	  FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

held-out-measured: configure
	@$(MAKE) --no-print-directory $(R)/$(HELD_OUT_AT)/manifest.json
	@$(PUMPS) results $(R)/$(HELD_OUT_AT)

$(R)/$(HELD_OUT_AT)/manifest.json: $(C)/evaluate.toml $(R)/ingest/manifest.json $(foreach each,$(HELD_OUT_WEIGHTS),$(wildcard stages/shared/weights/$(each)/*/manifest.json))
	$(PUMPS) evaluate --config $< --motion $(R)/ingest --unseen --tasks interpolation --tasks transition \
	  --max-windows $(HELD_OUT_WINDOWS) $(addprefix --weights ,$(HELD_OUT_WEIGHTS)) -o $(@D)

# The same archives' test clips, put on rigs that the weights never saw: how well they cross skeletons, told apart from
# kinds of motion that they do not know. RIGS are the recordings that lend their rigs.
RIGS ?= stages/shared/clips

unseen-rigs: install
	@$(MAKE) --no-print-directory unseen-rigs-measured RUN='$(call unless_given,RUN,unseen-rigs)' \
	  DATA='$(or $(DATA),$(wildcard $(HELD_OUT_DATA)))' FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

unseen-rigs-measured: configure
	@$(MAKE) --no-print-directory $(R)/on-rigs/$(HELD_OUT_AT)/manifest.json
	@$(PUMPS) results $(R)/on-rigs/$(HELD_OUT_AT)

# Other RIGS want another RUN.
$(R)/rigs/manifest.json:
	$(PUMPS) ingest auto $(RIGS) -o $(@D)

$(R)/on-rigs/clips/manifest.json: $(R)/ingest/manifest.json $(R)/rigs/manifest.json
	$(PUMPS) data rerig --motion $(R)/ingest --rigs $(R)/rigs -o $(@D)

$(R)/on-rigs/$(HELD_OUT_AT)/manifest.json: $(C)/evaluate.toml $(R)/on-rigs/clips/manifest.json $(foreach each,$(HELD_OUT_WEIGHTS),$(wildcard stages/shared/weights/$(each)/*/manifest.json))
	$(PUMPS) evaluate --config $< --motion $(R)/on-rigs/clips --tasks interpolation --tasks transition \
	  --max-windows $(HELD_OUT_WINDOWS) $(addprefix --weights ,$(HELD_OUT_WEIGHTS)) -o $(@D)

# The tables of docs/results.md about the weights that ship: each on the test clips of its own archives, part by part and
# with loose feet; and what held-out and unseen-rigs measure. Cores that are free want `make -j2` and OMP_NUM_THREADS=1.
WEIGHTS_MEASURED := own-small own-small-free parts-small loose-small evaluate-small-free-20 on-rigs/evaluate-small-20

weights-report: install-dev
	@$(MAKE) --no-print-directory weights-measured RUN='$(call unless_given,RUN,weights)' PRESET=laptop \
	  DATA='$(HELD_OUT_DATA) stages/shared/clips' SPLITS='$(wildcard $(SHARED_DATA)/splits.json)' FPS_OVERRIDE='*salsa*=60'
	$(VENV)/bin/python benchmarks/weights_tables.py '$(RUNS)/$(call unless_given,RUN,weights)' --page docs/results.md

weights-measured: configure
	@$(MAKE) --no-print-directory $(patsubst %,$(R)/%/manifest.json,$(filter own-% parts-% loose-%,$(WEIGHTS_MEASURED)))
	@$(MAKE) --no-print-directory $(R)/evaluate-small-free-20/manifest.json HELD_OUT_WEIGHTS=small-free HELD_OUT_WINDOWS=20
	@$(MAKE) --no-print-directory $(R)/on-rigs/evaluate-small-20/manifest.json HELD_OUT_WEIGHTS=small HELD_OUT_WINDOWS=20

WEIGHTS_MANIFESTS := $(wildcard stages/shared/weights/*/*/manifest.json)
on_own_archives = $(PUMPS) evaluate --config $(C)/evaluate.toml --weights $* --motion $(R)/ingest \
  --where 'archive in ($(foreach name,$(PRETRAIN_$*),"$(name).zip",))' -o $(@D)

$(R)/own-%/manifest.json: $(R)/ingest/manifest.json $(WEIGHTS_MANIFESTS)
	$(on_own_archives)

$(R)/parts-%/manifest.json: $(R)/ingest/manifest.json $(WEIGHTS_MANIFESTS)
	$(on_own_archives) --breakdown --tasks interpolation --max-windows 8

$(R)/loose-%/manifest.json: $(R)/ingest/manifest.json $(WEIGHTS_MANIFESTS)
	$(on_own_archives) --no-foot-lock --tasks interpolation --intervals 15 --intervals 30 --max-windows 12

# ---- to look at ------------------------------------------------------------------------------------------------

GALLERY_WEIGHTS ?=
FIRST_CLIP := dance_b

# The page holds recordings that may not be handed on; its picture is of a few poses.
gallery: install
	@$(VENV)/bin/python benchmarks/gallery.py '$(SHARED_DATA)' '$(RUNS)/gallery' --picture docs/pictures/gallery.svg \
	  $(if $(GALLERY_WEIGHTS),--weights '$(GALLERY_WEIGHTS)')

# The two commands of the README's first example.
first-picture: install
	@mkdir -p '$(RUNS)/gallery'
	$(PUMPS) infill stages/shared/clips/$(FIRST_CLIP).bvh --keyframes every:15 -o '$(RUNS)/gallery/filled.bvh' --overwrite \
	  $(if $(GALLERY_WEIGHTS),--weights '$(GALLERY_WEIGHTS)')
	$(PUMPS) report --motions truth=stages/shared/clips/$(FIRST_CLIP).bvh --motions 'pumps=$(RUNS)/gallery/filled.bvh' \
	  --keyframes every:15 -o '$(RUNS)/gallery/filled.html' --picture docs/pictures/first-fill.svg

# ---- any cloud to any skeleton ---------------------------------------------------------------------------------

# SOLVE_CLIPS: clips of each archive with true clouds, 0 for all. SOLVE_NETWORKS: NAME=FOLDER of networks of rigs.
SOLVE_CLIPS    ?= 40
SOLVE_NETWORKS ?=

solve-report: install
	@$(MAKE) --no-print-directory solve-measured RUN='$(call unless_given,RUN,solve)' DATA='$(LATENT_HAVE)' \
	  FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

solve-measured: configure
	@$(MAKE) --no-print-directory $(R)/measure-solve/manifest.json
	@$(PUMPS) results $(R)/measure-solve

# A page that plays truth, slerp, the solve and SOLVE_NETWORKS side by side on the rigs of all archives.
solve-pages: install
	@$(MAKE) --no-print-directory solve-played RUN='$(call unless_given,RUN,solve)' DATA='$(LATENT_HAVE)' \
	  FPS_OVERRIDE='$(or $(FPS_OVERRIDE),$(if $(DATA),,*salsa*=60))'

solve-played: configure
	@$(MAKE) --no-print-directory $(R)/solve-few/manifest.json
	@$(MAKE) --no-print-directory solve-page

SOLVE_MADE = $(patsubst $(R)/solve-made/%/manifest.json,%,$(wildcard $(R)/solve-made/*/*/manifest.json))
solve-page:
	$(PUMPS) report --title 'Any cloud to any skeleton' --no-slerp --keyframes every:30 \
	  $(foreach each,$(foreach name,truth slerp solve,$(filter %/$(name),$(SOLVE_MADE))) $(sort $(filter-out %/truth %/slerp %/solve,$(SOLVE_MADE))),--motions '$(each)=$(R)/solve-made/$(each)') \
	  --metrics $(R)/solve-few -o $(R)/solve.html

# Written only where they change, so that other networks or clips are measured anew.
$(R)/solve-settings.txt: always
	@mkdir -p $(@D)
	@echo '$(SOLVE_CLIPS) $(SOLVE_NETWORKS)' | cmp -s - $@ || echo '$(SOLVE_CLIPS) $(SOLVE_NETWORKS)' > $@
.PHONY: always

$(R)/solve-few/manifest.json: $(R)/ingest/manifest.json $(R)/solve-settings.txt
	$(PUMPS) measure solve --motion $(R)/ingest --conditions true --intervals 30 --clips 2 --made $(R)/solve-made \
	  $(foreach each,$(SOLVE_NETWORKS),--networks '$(each)') -o $(@D) \
	  $(if $(filter stages/shared/clips,$(DATA)),--splits train --splits val --splits test)

$(R)/measure-solve/manifest.json: $(R)/ingest/manifest.json $(R)/solve-settings.txt
	$(PUMPS) measure solve --motion $(R)/ingest --clips $(SOLVE_CLIPS) -o $(@D) \
	  $(foreach each,$(SOLVE_NETWORKS),--networks '$(each)') \
	  $(if $(filter stages/shared/clips,$(DATA)),--splits train --splits val --splits test)

# ---- PC-MRL's tables -------------------------------------------------------------------------------------------

# Motions of one data set are adapted to the skeleton of the other, an interpolator learns from them, and fills that
# skeleton's own test motions. Both ways: the rigs are clips of the training splits.
BANDAI      ?= $(SHARED_DATA)/bandai-namco-1.zip
CMU         ?= $(SHARED_DATA)/cmu-dance.zip
PCMRL_SOURCES_bandai := $(BANDAI)
PCMRL_SOURCES_cmu    := $(CMU)
PCMRL_RIG_bandai     := $(firstword $(BANDAI))!bandai-namco-1/dataset-1_walk_active_001.bvh
PCMRL_RIG_cmu        := $(firstword $(CMU))!cmu-dance/indian/06.bvh
PCMRL_CATEGORY_bandai := --category 'Walking=*_walk*' --category 'Running=*_dash_*' --category 'Gestures, punches=*'
PCMRL_CATEGORY_cmu    := --category 'Salsa=*salsa*' --category 'Indian dance=*indian*'

Q := $(RUNS)/$(if $(filter file,$(origin RUN)),pcmrl,$(RUN))
Q_PRESET := $(if $(filter file,$(origin PRESET)),pcmrl,$(PRESET))
# A stage's preset, and what SET says of it as flags.
of_stage = --preset $(Q_PRESET) $(foreach each,$(filter $(1).%,$(SET)),--$(subst _,-,$(patsubst $(1).%,%,$(firstword $(subst =, ,$(each))))) '$(word 2,$(subst =, ,$(each)))')
unfinished = @test -f $@ || { echo '$(@D): training stopped before its end; run make again to go on.' >&2; exit 1; }

.PHONY: rig-report
rig-report: install $(Q)/bandai-to-cmu/own/manifest.json $(Q)/cmu-to-bandai/own/manifest.json
	@cat $(Q)/*/own/data-*/summary.md
define both_ways
	@echo 'From Bandai Namco to CMU:'
	@$(PUMPS) results $(Q)/bandai-to-cmu/$(1)
	@echo 'From CMU to Bandai Namco:'
	@$(PUMPS) results $(Q)/cmu-to-bandai/$(1)
endef
pcmrl-table1: install $(Q)/bandai-to-cmu/table1/manifest.json $(Q)/cmu-to-bandai/table1/manifest.json
	$(call both_ways,table1)
pcmrl-table2: install $(Q)/bandai-to-cmu/table2/manifest.json $(Q)/cmu-to-bandai/table2/manifest.json
	$(call both_ways,table2)
pcmrl-table3: install $(Q)/bandai-to-cmu/table3/manifest.json $(Q)/cmu-to-bandai/table3/manifest.json
	$(call both_ways,table3)

.PRECIOUS: $(Q)/%/ingest/manifest.json $(Q)/%/tpc/manifest.json $(Q)/%/citl/manifest.json
$(Q)/%/ingest/manifest.json:
	$(PUMPS) ingest bvh $(PCMRL_SOURCES_$*) $(call of_stage,ingest) --splits $(SHARED_DATA)/splits.json --fps-override '*salsa*=60' -o $(@D)
$(Q)/%/tpc/manifest.json: $(Q)/%/ingest/manifest.json
	$(PUMPS) sample-tpc $(call of_stage,sample-tpc) --motion $(<D) -o $(@D)
$(Q)/%/citl/manifest.json: $(Q)/%/tpc/manifest.json
	$(PUMPS) train citl $(call of_stage,train-citl) --rest-pose-m 0 --tpc $(<D) -o $(@D)
	$(unfinished)

# $(1) is adapted to the skeleton of $(2): by the network, and (`solved`) by the network and the solve from there.
define pcmrl_direction
$(Q)/$(1)-to-$(2)/skeleton/manifest.json: $(Q)/$(1)/tpc/manifest.json
	$$(PUMPS) train skeleton $$(call of_stage,train-skeleton) --skeleton '$$(PCMRL_RIG_$(2))' --tpc $$(<D) -o $$(@D)
	$$(unfinished)
$(foreach way,network both,$(foreach part,train test,
$(Q)/$(1)-to-$(2)/$(way)-$(part)/manifest.json: $(Q)/$(1)/tpc/manifest.json $(Q)/$(1)-to-$(2)/skeleton/manifest.json
	$$(PUMPS) decode --method $(way) --tpc $$(<D) --network $(Q)/$(1)-to-$(2)/skeleton $(if $(filter train,$(part)),--splits train --splits val,--splits test) -o $$(@D)
$(Q)/$(1)-to-$(2)/$(way)-$(part)-tpc/manifest.json: $(Q)/$(1)-to-$(2)/$(way)-$(part)/manifest.json
	$$(PUMPS) sample-tpc $$(call of_stage,sample-tpc) --motion $$(<D) -o $$(@D)
))
$(foreach each,rpa=network no-rpa=network solved=both,
$(Q)/$(1)-to-$(2)/citl-$(firstword $(subst =, ,$(each)))/manifest.json: $(Q)/$(1)-to-$(2)/$(lastword $(subst =, ,$(each)))-train-tpc/manifest.json
	$$(PUMPS) train citl $$(call of_stage,train-citl) $(if $(filter no-rpa=%,$(each)),--rest-pose-m 0) --tpc $$(<D) -o $$(@D)
	$$(unfinished)
)
$(foreach way,network both,
$(Q)/$(1)-to-$(2)/$(way)-own/manifest.json: $(Q)/$(2)/tpc/manifest.json $(Q)/$(1)-to-$(2)/skeleton/manifest.json
	$$(PUMPS) decode --method $(way) --tpc $$(<D) --network $(Q)/$(1)-to-$(2)/skeleton -o $$(@D)
)
$(Q)/$(1)-to-$(2)/own/manifest.json: $(foreach way,network both,$(Q)/$(1)-to-$(2)/$(way)-own/manifest.json)
	$$(PUMPS) measure motions --truth $(Q)/$(2)/ingest $(foreach way,network both,--made $(way)=$(Q)/$(1)-to-$(2)/$(way)-own) -o $$(@D)
$(Q)/$(1)-to-$(2)/table1/manifest.json: $(Q)/$(2)/citl/manifest.json $(foreach each,no-rpa rpa,$(Q)/$(1)-to-$(2)/citl-$(each)/manifest.json)
	$$(PUMPS) measure pcmrl $$(call of_stage,measure-pcmrl) $$(PCMRL_CATEGORY_$(2)) --truth $(Q)/$(2)/tpc --weights 'CITL, native=$(Q)/$(2)/citl' --weights 'PC-MRL w/o RPA=$(Q)/$(1)-to-$(2)/citl-no-rpa' --weights 'PC-MRL=$(Q)/$(1)-to-$(2)/citl-rpa' -o $$(@D)
$(Q)/$(1)-to-$(2)/table2/manifest.json: $(foreach each,network both,$(Q)/$(1)-to-$(2)/$(each)-test-tpc/manifest.json)
	$$(PUMPS) measure pcmrl $$(call of_stage,measure-pcmrl) --source $(Q)/$(1)/tpc --adapted 'PC-MRL=$(Q)/$(1)-to-$(2)/network-test-tpc' --adapted 'PC-MRL and solve=$(Q)/$(1)-to-$(2)/both-test-tpc' -o $$(@D)
$(Q)/$(1)-to-$(2)/table3/manifest.json: $(Q)/$(2)/citl/manifest.json $(foreach each,rpa solved,$(Q)/$(1)-to-$(2)/citl-$(each)/manifest.json)
	$$(PUMPS) measure pcmrl $$(call of_stage,measure-pcmrl) --truth $(Q)/$(2)/tpc --weights 'CITL, native=$(Q)/$(2)/citl' --weights 'CITL, network and solve=$(Q)/$(1)-to-$(2)/citl-solved' --weights 'PC-MRL=$(Q)/$(1)-to-$(2)/citl-rpa' -o $$(@D)
endef
$(eval $(call pcmrl_direction,bandai,cmu))
$(eval $(call pcmrl_direction,cmu,bandai))

clean-run:
	rm -rf '$(R)'

# ---- testing ---------------------------------------------------------------------------------------------------

lint: install-dev
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/pyright --pythonpath $(VENV)/bin/python
	$(VENV)/bin/lint-imports

# One thread a process: two processes whose libraries each take both cores wait for each other most of the time.
test: lint
	OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n 2 $(PYTEST_FLAGS)

# How much more than the tests give: each of them is 2,000 damaged files for every format, 500 for every archive.
TIMES ?= 20
fuzz: install-dev
	PUMPS_FUZZ=$(TIMES) OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n 2 -q tests/shared/formats/test_fuzz_readers.py

bench: install-dev
	@for script in $(filter-out benchmarks/training_step.py benchmarks/gallery.py,$(wildcard benchmarks/*.py)); do \
	  echo "== $$script"; $(VENV)/bin/python "$$script" || exit 1; done

# The paper's sizes, unless PRESET is given in the call; all cores, so nothing else should be running.
DEVICE  ?= cpu
BATCH   ?= 2
AUTHORS ?=

# Reading motion files, beside other libraries that read them; DATA='a.zip b.zip', else the embedded clips.
bench-ingest: $(VENV)/installed-bench
	$(VENV)/bin/python benchmarks/reading.py $(DATA) --page docs/performance.md

# Bodies on rigs whose names are gone; DATA='a.zip b.zip' of BVH beside the embedded clips.
any-humanoid: install-dev
	$(VENV)/bin/python benchmarks/any_humanoid.py $(DATA) --most 160 --page docs/formats.md

$(VENV)/installed-bench: $(VENV)/installed-dev
	$(VENV)/bin/python -m pip install --quiet -c constraints.txt -e '.[dev,bench]'
	@touch $@

# One motion of each rig on every other; the archives of SHARED_DATA where they are, else the embedded clips.
retarget-report: install-dev
	$(VENV)/bin/python benchmarks/retargeting.py $(if $(wildcard $(SHARED_DATA)/bandai-namco-1.zip),\
	  'Bandai Namco=$(SHARED_DATA)/bandai-namco-1.zip!bandai-namco-1/dataset-1_kick_normal_001.bvh' \
	  'CMU dance=$(SHARED_DATA)/cmu-dance.zip!cmu-dance/indian/08.bvh' \
	  'LaFAN1 G1=$(SHARED_DATA)/lafan1-g1.zip!lafan1-g1/fight1_subject2.bvh' \
	  'embedded=stages/shared/clips/run.bvh') --page docs/results.md

bench-train: install-dev
	$(VENV)/bin/python benchmarks/training_step.py --device $(DEVICE) --batch $(BATCH) $(if $(AUTHORS),--authors '$(AUTHORS)') \
	  --preset $(if $(filter command environment,$(origin PRESET)),$(PRESET),paper) --page docs/performance.md
