# Three commands do all their own set-up: `make demo` (a simulated drive in a window), `make run`
# (the main job) and `make test`.
PYTHON ?= python3
BIN := .venv/bin
OUT := out
TESTS ?= tests
STAMP := .venv/.stamp

# Python keeps what it has compiled, whatever the environment says: without that every process of a
# test compiles the package anew, and each worker every assertion, a quarter of the whole.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo run test pytest search fuzz docs figures bench test-ci test-platforms test-slow proof style check setup setup-run clean

demo:
	@sh .ci/setup "$(PYTHON)" demo
	@$(BIN)/esea-host demo

run: setup-run
	@$(BIN)/esea-gen build elbow --out $(OUT)/elbow
	@$(BIN)/esea-gen identify tests/data/hdrb/hdrb.toml --out $(OUT)/hdrb --json $(OUT)/hdrb/identification.json
	@$(BIN)/esea-gen build $(OUT)/hdrb/hdrb.toml --out $(OUT)/hdrb/generated
	@$(BIN)/esea-gen report $(OUT)/hdrb/hdrb.toml --recording tests/data/hdrb/hdrb.toml --out $(OUT)/report.html --json $(OUT)/report.json
	@$(BIN)/esea-gen report elbow --recording tests/data/hdrb/hdrb.toml --out $(OUT)/elbow.html --json $(OUT)/elbow.json
	@rm -f $(OUT)/demo.png $(OUT)/demo.mcap $(OUT)/wrist.png $(OUT)/wrist.mcap $(OUT)/wrist.toml
	@$(BIN)/esea-host demo --headless --seconds 8 --report $(OUT)/demo.png
	@$(BIN)/esea-host wrist sim:wrist_drive --headless --record $(OUT)/wrist.mcap --calibration $(OUT)/wrist.toml --screenshot $(OUT)/wrist.png
	@echo "Open $(OUT)/report.html (the recorded rubber), $(OUT)/elbow.html (the published elbow) and"
	@echo "$(OUT)/demo.png (the controlled elbow on a simulated board, recorded in $(OUT)/demo.mcap and replayed to the bit),"
	@echo "$(OUT)/wrist.png (the display of a simulated wrist, constrained and normalised, recorded in $(OUT)/wrist.mcap)."

# The type checker is one process: beside the tests, so that no core waits for it.
test: setup
	@$(MAKE) --no-print-directory -j 3 style check pytest

pytest: setup
	@$(BIN)/python -m pytest -n 2 --dist loadfile

# Other examples at each run; SEED=n repeats one, TESTS=tests/twin/test_plant.py narrows it.
search: setup
	@seed=$${SEED:-$$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')}; again="make search SEED=$$seed TESTS='$(TESTS)'"; \
	echo "Random search. To repeat: $$again"; \
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "hypothesis and not slow" \
		--hypothesis-profile=search --hypothesis-seed=$$seed $(TESTS) || { echo "To repeat: $$again"; exit 1; }

docs:
	@sh .ci/setup "$(PYTHON)" docs
	@$(BIN)/python docs/made_pages.py
	@$(BIN)/zensical build --strict --clean
	@echo "Open $(OUT)/site/index.html"

# The pages' tables of figures that are not current; TABLES="laws off" names some.
figures: setup
	@$(BIN)/python docs/figures.py $(TABLES)

bench: setup
	@$(BIN)/python -m tests.benchmarks --json bench.json

# Other hostile files, bytes and texts at each run: 5 minutes for each kind, or FUZZ_S seconds.
fuzz: setup
	@for target in mcap tables toml mavlink strings; do \
		$(BIN)/python -m tests.fuzz.hostile $$target --seconds $${FUZZ_S:-300} \
			--seed $${SEED:-$$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')}; done

# What takes longer than a change should wait for, and a fixed sample of the slow tests: CI runs it.
test-ci: setup
	@$(BIN)/python -m pytest -n 2 --dist loadfile -m "ci and not slow or slow_sample"

# Other systems, as far as this one can stand in for them: docs/platforms.md.
test-platforms: setup
	@$(BIN)/python -m pytest -n 2 --dist loadfile -m platforms

test-slow: setup
	@$(BIN)/python -m pytest -m slow

# Frama-C, Gappa and z3 on the emitted C; its set-up installs them too.
proof: export ESEA_PROOF = 1
proof: setup
	@ESEA_REQUIRE_TOOLS=1 $(BIN)/python -m pytest -n 2 -m "slow or not slow" tests/proof/test_fixed_proof.py tests/proof/test_limits_proof.py tests/proof/test_firmware_proof.py

check: setup
	@$(BIN)/esea-gen check

style: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

setup:
	@sh .ci/setup "$(PYTHON)"

# A C compiler, one for the board, its emulator, and the Python packages that run here.
setup-run:
	@sh .ci/setup "$(PYTHON)" run

clean:
	rm -rf .venv $(OUT) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
