# The tables and reports that are a recipe each. The Makefile includes this file and describes the targets.
#
# A target is a recipe of its name, or of RECIPE_target. GOAL_target is another goal than the recipe's first one;
# WITH_target sets parameters of the recipe from variables.

HELD_OUT_WEIGHTS ?= small-free
HELD_OUT_WINDOWS ?= 40
RIGS   ?= stages/shared/clips
LATENT_WEIGHTS ?= tiny
SOLVE_CLIPS    ?= 40
BUDGET ?= 12
WINDOWS ?= 40
GOAL   ?=
TABLE3_STEPS   ?= 400
TABLE4_STEPS   ?= 300
TABLE4_WINDOWS ?= 20

WITH_table1 = --with 'minutes=$(BUDGET)' --with 'half=$(shell awk 'BEGIN { print $(BUDGET) / 2 }')' --with 'windows=$(WINDOWS)'
GOAL_table1 = $(GOAL)
WITH_table3 = --with 'steps=$(TABLE3_STEPS)' --with 'half=$(shell expr $(TABLE3_STEPS) / 2)'
WITH_table4 = --with 'steps=$(TABLE4_STEPS)' --with 'windows=$(TABLE4_WINDOWS)'
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

table1 table2 table3 table4 latent-report solve-report solve-pages held-out unseen-rigs lifter: install
	$(call made,$(or $(RECIPE_$@),$@),$(GOAL_$@),$(WITH_$@),$(UNTIL_SLICE))
pcmrl-table1 pcmrl-table2 pcmrl-table3 rig-report: install
	$(call made,pcmrl,$(patsubst pcmrl-%,%,$(@:rig-report=rigs)))
