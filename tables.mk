# The tables and reports that are a recipe each. The Makefile includes this file and describes the targets.
#
# A target is a recipe of its name, or of RECIPE_target. GOAL_target is another goal than the recipe's first one;
# WITH_target sets parameters of the recipe from variables.

HELD_OUT_WEIGHTS ?= small-free
HELD_OUT_WINDOWS ?= 40
RIGS   ?= stages/shared/clips
LATENT_WEIGHTS ?= small-free
SOLVE_CLIPS    ?= 40
BUDGET ?= 12
WINDOWS ?= 30
GOAL   ?=
TABLE3_STEPS   ?= 400
TABLE4_STEPS   ?= 300
TABLE4_WINDOWS ?= 20
TRACKERS_STEPS   ?= 300
TRACKERS_WINDOWS ?= 20
CURVE_MINUTES  ?= 8
SPECTRAL_STEPS ?= 60000
SPECTRAL_CLOTHS ?= 2000
SPECTRAL_WINDOWS ?= 0
SPECTRAL_IDENTITIES ?= 32
BODY_PARTS_STEPS   ?= 6000
BODY_PARTS_WINDOWS ?= 200
CONCEPTS_SET    ?= hdm05
CONCEPTS_STEPS  ?= 2000
CONCEPTS_COUNT  ?= 200
CONCEPTS_WINDOW ?= 60

WITH_table1 = --with 'minutes=$(BUDGET)' --with 'half=$(shell awk 'BEGIN { print $(BUDGET) / 2 }')' --with 'windows=$(WINDOWS)'
GOAL_table1 = $(GOAL)
RECIPE_figures = table1
GOAL_figures = $(GOAL:%=%-)figures
WITH_figures = $(WITH_table1)
# Curves of error against minutes of training: three trainings each, of a quarter, half and all of CURVE_MINUTES.
WITH_CURVE = $(shell awk 'BEGIN { printf "--with quarter-minutes=%g --with half-minutes=%g --with whole-minutes=%g", $(CURVE_MINUTES) / 4, $(CURVE_MINUTES) / 2, $(CURVE_MINUTES) }')
WITH_table3 = $(WITH_CURVE) --with 'steps=$(TABLE3_STEPS)' --with 'half=$(shell expr $(TABLE3_STEPS) / 2)'
GOAL_table3 = $(GOAL)
WITH_table4 = $(WITH_CURVE) --with 'steps=$(TABLE4_STEPS)' --with 'windows=$(TABLE4_WINDOWS)'
GOAL_table4 = $(GOAL)
WITH_table-trackers = $(WITH_CURVE) --with 'steps=$(TRACKERS_STEPS)' --with 'windows=$(TRACKERS_WINDOWS)'
RECIPE_table-trackers = trackers
GOAL_table-trackers = $(GOAL)
WITH_latent-report = --with 'weights=$(LATENT_WEIGHTS)'
RECIPE_latent-report = latents
WITH_solve-report = --with 'measured=$(SOLVE_CLIPS)' --with 'networks=$(SOLVE_NETWORKS)'
RECIPE_solve-report = solve
WITH_solve-pages = $(WITH_solve-report)
RECIPE_solve-pages = solve
GOAL_solve-pages = pages
WITH_held-out = --with 'weights=$(HELD_OUT_WEIGHTS)' --with 'windows=$(HELD_OUT_WINDOWS)'
WITH_unseen-rigs = $(WITH_held-out) --with 'rigs=$(RIGS)'
WITH_lifter = --with 'initial=$(INITIAL)'

table1 figures table2 table3 table4 table-trackers latent-report solve-report solve-pages held-out unseen-rigs lifter: install
	$(call made,$(or $(RECIPE_$@),$@),$(GOAL_$@),$(WITH_$@),$(UNTIL_SLICE))
pcmrl-table1 pcmrl-table2 pcmrl-table3 rig-report: install
	$(call made,pcmrl,$(patsubst pcmrl-%,%,$(@:rig-report=rigs)))

# A third of the steps for cloth and completion; the autoencoder trains alone for a twentieth.
SPECTRAL_PART = $(shell expr $(SPECTRAL_STEPS) / 20)
WITH_spectral-tables = --with 'steps=$(SPECTRAL_STEPS)' --with 'third=$(shell expr $(SPECTRAL_STEPS) / 3)' --with 'static=$(SPECTRAL_PART)' --with 'validate=$(SPECTRAL_PART)' --with 'cloths=$(SPECTRAL_CLOTHS)' --with 'windows=$(SPECTRAL_WINDOWS)' --with 'identities=$(SPECTRAL_IDENTITIES)'
spectral-tables spectral-pages: $(VENV)/installed-mesh
	$(call made,spectral,$(if $(filter spectral-pages,$@),pages),$(WITH_spectral-tables),$(UNTIL_SLICE))
body-parts-table1 body-parts-table2 body-parts-table3: install
	$(call made,body-parts,,--with 'steps=$(BODY_PARTS_STEPS)' --with 'windows=$(BODY_PARTS_WINDOWS)')
concepts-tables: install-dev
	$(call made,concepts,$(GOAL),--with 'set=$(CONCEPTS_SET)' --with 'steps=$(CONCEPTS_STEPS)' --with 'count=$(CONCEPTS_COUNT)' --with 'window=$(CONCEPTS_WINDOW)')
