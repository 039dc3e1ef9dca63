# make demo        everything, on the embedded clips: install, train for a few minutes, fill, measure, report
# make reproduce   the same on your own data: DATA='a.zip b/ c.bvh' PRESET=tiny RUN=mine
#                  optional: SPLITS=splits.json  FPS_OVERRIDE='*salsa*=60'  SET='train-ae.steps=500 train-ae.seed=1'
#                  COMPARE='tiny' measures shipped weights beside those trained
# make test        linters, types, import directions, tests
# make lint | bench | clean-run RUN=mine | help
#
# A run's files are targets: a second call does only what is out of date, and a killed one goes on where it was.

PYTHON ?= python3
VENV   ?= .venv
PUMPS  ?= $(VENV)/bin/pumps
RUNS   ?= runs
RUN    ?= mine
PRESET ?= tiny
DATA   ?=
SET    ?=
COMPARE  ?=
FPS_OVERRIDE ?=

# The splits beside the data, where there are some.
SPLITS ?= $(firstword $(wildcard $(addsuffix /splits.json,$(DATA)) $(addsuffix splits.json,$(dir $(DATA)))))

SHIPPED := $(patsubst stages/weights/%/ae/manifest.json,%,$(wildcard stages/weights/*/ae/manifest.json))

R := $(RUNS)/$(RUN)
C := $(R)/config

.PHONY: help demo reproduce configure picked dag fill test lint bench install install-dev clean-run
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
	@$(MAKE) --no-print-directory fill RUN=demo PRESET=demo DATA=stages/clips COMPARE='$(SHIPPED)'

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

CLIPS  := $(basename $(notdir $(wildcard $(R)/pick-clips/*.bvh)))
FILLED := $(CLIPS:%=$(R)/infill/%.bvh)

.PRECIOUS: $(R)/%/manifest.json $(R)/infill/%.bvh $(R)/pick-clips/%.bvh

# The recipes that do nothing keep make from saying that there was nothing to do.
picked: $(R)/pick-clips/clips.txt
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

$(R)/pick-clips/clips.txt: $(C)/pick-clips.toml $(R)/ingest/manifest.json
	$(PUMPS) pick-clips --config $< --motion $(R)/ingest -o $(@D)

$(FILLED): $(R)/infill/%.bvh: $(C)/infill.toml $(R)/pick-clips/clips.txt $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json
	@mkdir -p $(@D)
	$(PUMPS) infill $(R)/pick-clips/$*.bvh --config $< --weights $(R) --overwrite -o $@

$(R)/decode/manifest.json: $(C)/decode.toml $(R)/ingest/manifest.json $(R)/train-ae/manifest.json $(R)/encode/manifest.json
	$(PUMPS) decode --config $< --latent $(R)/encode --ae $(R)/train-ae --motion $(R)/ingest -o $(@D)

$(R)/evaluate/manifest.json: $(C)/evaluate.toml $(R)/ingest/manifest.json $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json $(foreach each,$(COMPARE),$(wildcard stages/weights/$(each)/*/manifest.json))
	$(PUMPS) evaluate --config $< --motion $(R)/ingest --weights pumps=$(R) $(addprefix --weights ,$(COMPARE)) -o $(@D)

$(R)/report/report.html: $(C)/report.toml $(R)/evaluate/manifest.json $(R)/train-ae/manifest.json $(R)/train-lms/manifest.json $(FILLED)
	@mkdir -p $(@D)
	$(PUMPS) report --config $< --metrics $(R)/evaluate --checkpoints $(R)/train-ae --checkpoints $(R)/train-lms \
	  $(foreach clip,$(CLIPS),--motions '$(clip)/truth=$(R)/pick-clips/$(clip).bvh' --motions '$(clip)/PUMPS=$(R)/infill/$(clip).bvh') -o $@

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

bench: install-dev
	@for script in $(wildcard benchmarks/*.py); do echo "== $$script"; $(VENV)/bin/python "$$script" || exit 1; done
